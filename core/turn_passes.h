/* 11.5 Rotations of a coded I-frame: the pole's tilt, then the turn about it. */
#ifndef DFCGS_TURN_PASSES_H
#define DFCGS_TURN_PASSES_H

#include "column.h"

/* What is known of the rows: steps of tilts and of spins, whether each [count] is a needle. */
typedef struct {
    dfcgs_levels levels;
    dfcgs_row_steps tilts, spins;
    const uint8_t *needles;
    int alternating;
} dfcgs_turn_shape;

/* The ROTATION plane [count][4]. */
dfcgs_status dfcgs_read_turns(dfcgs_stream *s, const dfcgs_turn_shape *shape, int32_t *rotations);

#endif
