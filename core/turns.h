/* 11.5 Turns of coded I-frames: frames that neighbours let expect, and quaternions from what tilts, spins and
   flips are worth.

   Axes of a Gaussian are nine integers, three directions in units of 2**-15. */
#ifndef DFCGS_TURNS_H
#define DFCGS_TURNS_H

#include "lod.h"
#include "rotation.h"

enum { DFCGS_NUM_SORT_CONTEXTS = 32, DFCGS_AXIS_BITS = 15, DFCGS_AXES = 9 };

/* Of the `rows` rows of a level: frames [rows][4], and half the squares of the angles, in 2**-36, that tilts
   and spins are expected to have. `axes` [count][9] and `needles` [count] are those of all rows; `weights`:
   see dfcgs_level_weights. */
DFCGS_EXPORT void dfcgs_expect_turns(const int32_t *axes, const uint8_t *needles, uint32_t count, int level,
                                     const int16_t *weights, int32_t *frames, int64_t *tilts, int64_t *spins);

/* Context of a tilt or spin beyond the base, where that is 31, or 63 for needles; step >= 1. */
DFCGS_INLINE int dfcgs_turn_context(int64_t expected, int64_t step, int needle) {
    int rung = dfcgs_ladder(dfcgs_quotient((expected << 5) >> 3, step * step), 2 * DFCGS_NUM_SORT_CONTEXTS);
    int context = (rung + 1) >> 1;
    if (context > DFCGS_NUM_SORT_CONTEXTS - 2) context = DFCGS_NUM_SORT_CONTEXTS - 2;
    return needle ? DFCGS_NUM_SORT_CONTEXTS + context : context;
}

/* Quaternions of the rows first::stride, `rows` of them, put into `rotations` [count][4], and their axes
   before flips into `axes` [count][9]. `frames` [rows][4]: NULL in the base; `tilts` [2][rows] and `spins`
   [rows]: what they are worth; `flips` [rows]: NULL for none. */
DFCGS_EXPORT void dfcgs_apply_turns(uint32_t first, uint32_t stride, uint32_t rows, const uint8_t *needles,
                                    const int32_t *frames, const int32_t *tilts, const int32_t *spins,
                                    const uint8_t *flips, int32_t *rotations, int32_t *axes);

#endif
