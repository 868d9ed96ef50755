/* 12 Passes of a P-frame: the stream of one attribute. */
#ifndef DFCGS_INTER_H
#define DFCGS_INTER_H

#include "prior_column.h"

enum { DFCGS_BLOCK_LOG2 = 6, DFCGS_DENSE = 3, DFCGS_NUM_MAGNITUDES = 24 };

DFCGS_INLINE uint32_t dfcgs_num_blocks(uint32_t count) {
    return (count + (1u << DFCGS_BLOCK_LOG2) - 1) >> DFCGS_BLOCK_LOG2;
}
DFCGS_INLINE int dfcgs_inter_columns(int attribute) {
    return attribute == DFCGS_ROTATION ? 3 : dfcgs_columns(attribute);
}

/* What an attribute leaves behind from frame to frame (12.1): `symbols` and `memory` [N][columns], `running`
   [N], classes by block. */
typedef struct {
    int32_t *symbols, *running;
    int64_t *memory;
    uint8_t *density, *magnitude;
} dfcgs_activity;

/* What the stream of an attribute is decoded with. `known` lacks classes of this frame; `levels` are those of
   all N, with distance weights. */
typedef struct {
    const dfcgs_context_model *model;
    dfcgs_levels levels;
    dfcgs_known known;
    const uint8_t *beside; /* [blocks] */
} dfcgs_inter_context;

/* Replaces the activity of the frame before by that of this one. */
dfcgs_status dfcgs_inter_attribute(dfcgs_stream *s, const dfcgs_inter_context *context,
                                   dfcgs_activity *activity);

#endif
