/* 11.4 Passes of a coded I-frame, or of births; annex A, verbatim I-frames. */
#ifndef DFCGS_INTRA_H
#define DFCGS_INTRA_H

#include "streams.h"

/* Where the Gaussians of an I-frame, or births, go: `cover` [count], `order` [count]. */
typedef struct {
    dfcgs_state state;
    uint8_t *cover;
    int32_t *order;
} dfcgs_intra_frame;

/* Streams in the order of 11.4; `order` is written where there is a permutation. */
dfcgs_status dfcgs_coded_intra(dfcgs_streams *streams, const dfcgs_sequence *sequence,
                               const dfcgs_intra_coding *coding, int has_permutation,
                               dfcgs_intra_frame *frame);

/* A: `patterns` [count][columns] of each attribute. */
dfcgs_status dfcgs_verbatim_intra(dfcgs_streams *streams, int num_attributes, int has_permutation,
                                  uint32_t count, uint32_t *const *patterns, int32_t *order);

/* Refuses places [count] that are no permutation. */
dfcgs_status dfcgs_check_permutation(dfcgs_stream *s, const int32_t *places, uint32_t count);

#endif
