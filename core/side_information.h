/* 11.2, 11.3 How symbols are coded, itself coded: weights, tables, histograms. */
#ifndef DFCGS_SIDE_INFORMATION_H
#define DFCGS_SIDE_INFORMATION_H

#include "stream.h"

enum { DFCGS_MAX_CONTEXTS = 64, DFCGS_WEIGHT_BITS = 8 };

/* `read_weights(count)` */
dfcgs_status dfcgs_read_weights(dfcgs_stream *s, uint32_t count, int64_t *weights);
/* `read_tables(num_contexts)` */
dfcgs_status dfcgs_read_tables(dfcgs_stream *s, int num_contexts, dfcgs_table *tables);
/* `read_histograms`: models[c] of each context c with used[c], of `size` symbols; others are left as they
   are. The models lie in the stream's arena. */
dfcgs_status dfcgs_read_histograms(dfcgs_stream *s, const uint8_t *used, int num_contexts, uint32_t size,
                                   dfcgs_model *models);
/* used[c] of the contexts that occur, 0 of all others below num_contexts. */
void dfcgs_occurring(const uint8_t *contexts, uint32_t count, int num_contexts, uint8_t *used);

#endif
