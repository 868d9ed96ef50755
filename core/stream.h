/* 10 Streams: the range decoder, and integers of several sorts made of its symbols. */
#ifndef DFCGS_STREAM_H
#define DFCGS_STREAM_H

#include "models.h"

/* `ahead` is point less lower of 10.2: the two are never needed apart. */
typedef struct {
    const uint8_t *words;
    uint32_t num_words, next;
    uint64_t range, ahead;
    uint64_t num_symbols;
    int64_t offset; /* of the stream in the file */
    dfcgs_arena *arena;
    dfcgs_models *models;
    dfcgs_error *error;
} dfcgs_stream;

/* Starts to decode `size` bytes; `arena`, `models` and `error` of the stream are set. */
dfcgs_status dfcgs_start(dfcgs_stream *s, const uint8_t *bytes, size_t size, int64_t offset);
/* 10.3 */
dfcgs_status dfcgs_finish(dfcgs_stream *s);

/* `count` symbols with one model. */
dfcgs_status dfcgs_decode(dfcgs_stream *s, const dfcgs_model *model, uint32_t count, uint16_t *symbols);
/* One symbol of uniform(2**bits), bits 1 to 16. */
dfcgs_status dfcgs_choice(dfcgs_stream *s, int bits, uint32_t *symbol);
/* 10.7; width 0 to 63 */
dfcgs_status dfcgs_bits(dfcgs_stream *s, int width, uint32_t count, uint64_t *values);
/* 10.8 */
dfcgs_status dfcgs_escapes(dfcgs_stream *s, uint32_t count, uint64_t *values);
dfcgs_status dfcgs_count_value(dfcgs_stream *s, uint64_t limit, uint64_t *value);
dfcgs_status dfcgs_signed_value(dfcgs_stream *s, uint64_t limit, int64_t *value);

/* Rows in grouped order (10.9): `order` [count], by context, then by place; `first` [257]: where each context
 * begins. */
void dfcgs_group(const uint8_t *contexts, uint32_t count, uint32_t *order, uint32_t *first);
/* 10.9; models[c] of each context c that occurs. */
dfcgs_status dfcgs_grouped(dfcgs_stream *s, const uint8_t *contexts, uint32_t count,
                           const dfcgs_model *models, uint8_t *symbols);
/* 10.10; tables[c] of each context c that occurs. */
dfcgs_status dfcgs_residuals(dfcgs_stream *s, const uint8_t *contexts, uint32_t count,
                             const dfcgs_table *tables, int64_t *values);
dfcgs_status dfcgs_flat(dfcgs_stream *s, int table, uint32_t count, int64_t *values);

#endif
