/* 9.3, 9.4 Reconstruction of P-frames; 9.8 what symbols of I-frames are worth; positions of I-frames (11.4).
 */
#ifndef DFCGS_RECONSTRUCT_H
#define DFCGS_RECONSTRUCT_H

#include "rotation.h"
#include "visibility.h"

/* 9.3: `plane` [count][columns], that of the predicted frame, plus `coarser(symbols * step)`. `coarseness`
   [count]: NULL without the tool VISIBILITY. On failure the plane is of no use any more. */
DFCGS_EXPORT dfcgs_status dfcgs_reconstruct(int32_t *plane, const int32_t *symbols, uint32_t count,
                                            int columns, int step, const uint8_t *coarseness);

/* 9.4: the ROTATION plane [count][4], turned by `symbols` [count][3]. */
DFCGS_EXPORT dfcgs_status dfcgs_turn(int32_t *rotations, const int32_t *symbols, uint32_t count, int step,
                                     const uint8_t *coarseness);

enum { DFCGS_CHAIN_LENGTH = 128, DFCGS_FEWEST_SYMBOLS = 512 };
/* 9.8: whether each of the `symbols` [count] of a pass, count >= DFCGS_FEWEST_SYMBOLS, is of the second
 * quantiser. */
DFCGS_EXPORT void dfcgs_second_quantisers(const int32_t *symbols, uint32_t count, uint8_t *second);

/* What a symbol is worth with its step; abs(symbol) <= 2 * DFCGS_STATE_LIMIT // step, so that it fits 32
 * bits. */
DFCGS_INLINE int32_t dfcgs_worth(int32_t symbol, int64_t step, int second) {
    int64_t doubled = 2 * (int64_t)symbol - (second ? dfcgs_sign(symbol) : 0);
    return (int32_t)((doubled * step) >> 1);
}

/* The POSITION plane [count][3] of a coded I-frame, from `index` [count][3] with all of its bits and the
 * octaves [count]. */
DFCGS_EXPORT dfcgs_status dfcgs_intra_positions(const int32_t *index, uint32_t count, const uint8_t *octaves,
                                                int step, int32_t *positions);

/* Anchor positions [count][3]: round_divide(c, step) of each value of a POSITION plane. */
DFCGS_EXPORT void dfcgs_anchors(const int32_t *positions, uint32_t count, int step, int32_t *anchors);

#endif
