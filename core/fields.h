/* 1.4 Fields and variable-length integers, of a payload or of a file.

   A reader goes over bytes that belong to somebody else. Each read that fails leaves its reason in `error`.
 */
#ifndef DFCGS_FIELDS_H
#define DFCGS_FIELDS_H

#include "core.h"

typedef struct {
    const uint8_t *data;
    size_t size, at;
    int64_t base; /* offset of data[0] in the file */
    dfcgs_status
        shortage; /* DFCGS_TRUNCATED in a file, DFCGS_CORRUPT in a payload whose checksum was right */
    dfcgs_error *error;
} dfcgs_reader;

DFCGS_INLINE int64_t dfcgs_offset(const dfcgs_reader *r) { return r->base + (int64_t)r->at; }
DFCGS_INLINE size_t dfcgs_left(const dfcgs_reader *r) { return r->size - r->at; }

/* `*bytes` points at the next `count` bytes. */
dfcgs_status dfcgs_raw(dfcgs_reader *r, uint64_t count, const uint8_t **bytes);
dfcgs_status dfcgs_u8(dfcgs_reader *r, uint8_t *value);
dfcgs_status dfcgs_u32(dfcgs_reader *r, uint32_t *value);
dfcgs_status dfcgs_uvarint(dfcgs_reader *r, uint64_t *value);
dfcgs_status dfcgs_svarint(dfcgs_reader *r, int64_t *value);

/* A field that is at most `limit`: else DFCGS_LIMIT at its offset. */
dfcgs_status dfcgs_u8_most(dfcgs_reader *r, uint8_t limit, uint8_t *value);
dfcgs_status dfcgs_uvarint_most(dfcgs_reader *r, uint64_t limit, uint64_t *value);
/* A byte below `count`: else DFCGS_UNSUPPORTED. */
dfcgs_status dfcgs_enum(dfcgs_reader *r, uint8_t count, uint8_t *value);
/* A step, 1 to DFCGS_STATE_LIMIT. */
dfcgs_status dfcgs_step_field(dfcgs_reader *r, int32_t *step);
/* `count` integers within +-`limit`, 2**62 at most: DFCGS_LIMIT at the first of them where one is not. */
dfcgs_status dfcgs_svarints_within(dfcgs_reader *r, int count, int64_t limit, int64_t *values);
/* Refuses bytes that no field claims. */
dfcgs_status dfcgs_expect_end(dfcgs_reader *r);

DFCGS_INLINE int64_t dfcgs_unfold(uint64_t u) { return (int64_t)(u >> 1) ^ -(int64_t)(u & 1); }

/* CRC-32 of section 1.4. */
uint32_t dfcgs_crc32(const uint8_t *data, size_t size);

#endif
