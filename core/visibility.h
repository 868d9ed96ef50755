/* 9.5 Steps that follow visibility; 9.6 steps of I-frames.

   A *weight* is in sixteenths of an octave, clipped to +-2**30: as all that is asked of it is how far it lies
   below a level of at most 2**29 in magnitude, clipped to a few octaves, that changes nothing. A
   *coarseness*, 0 to 16, is by how many quarter octaves a step is coarser. */
#ifndef DFCGS_VISIBILITY_H
#define DFCGS_VISIBILITY_H

#include "exact.h"

enum { DFCGS_MAX_COARSENESS = 16, DFCGS_NUM_COARSENESS = 17, DFCGS_MULTIPLIER_BITS = 8 };
enum { DFCGS_MAX_TURN_STEP = 1 << 16 };
extern const int32_t dfcgs_multipliers[DFCGS_NUM_COARSENESS];

/* What P-frames have weights of: `weights` [4][count], one of these after the other. */
enum { DFCGS_SHOWN_POSITION, DFCGS_SHOWN_OPACITY, DFCGS_SHOWN_ROTATION, DFCGS_SHOWN_REST, DFCGS_NUM_SHOWN };
/* Which of them is that of an attribute. */
DFCGS_INLINE int dfcgs_shown(int attribute) {
    return attribute == DFCGS_POSITION   ? DFCGS_SHOWN_POSITION
           : attribute == DFCGS_OPACITY  ? DFCGS_SHOWN_OPACITY
           : attribute == DFCGS_ROTATION ? DFCGS_SHOWN_ROTATION
                                         : DFCGS_SHOWN_REST;
}

/* Of the planes `scales` [count][3], `opacities` [count] and `cover` classes [count], NULL for zeros. */
DFCGS_EXPORT void dfcgs_visibility(const int32_t *scales, const int32_t *opacities, const uint8_t *cover,
                                   uint32_t count, int scale_exponent, int opacity_exponent,
                                   int32_t *weights);

/* What I-frames have weights of, each [count]. */
DFCGS_EXPORT void dfcgs_cover_weights(const uint8_t *cover, uint32_t count, int32_t *weights); /* SCALE */
DFCGS_EXPORT void dfcgs_area_weights(const int32_t *scales, const uint8_t *cover, uint32_t count,
                                     int scale_exponent, int32_t *weights); /* OPACITY */
DFCGS_EXPORT void dfcgs_alpha_weights(const int32_t *opacities, const uint8_t *cover, uint32_t count,
                                      int opacity_exponent, int32_t *weights); /* POSITION */
/* Of all colours, of tilts and of spins; and whether each Gaussian is a needle. */
DFCGS_EXPORT void dfcgs_seen_weights(const int32_t *scales, const int32_t *opacities, const uint8_t *cover,
                                     uint32_t count, int scale_exponent, int opacity_exponent, int32_t *seen,
                                     int32_t *tilts, int32_t *spins, uint8_t *needles);

/* clip((level - weight) >> shift, 0, most): with shift 3 and DFCGS_MAX_COARSENESS a coarseness, with 5
 * octaves of POSITION. */
DFCGS_EXPORT void dfcgs_coarseness(const int32_t *weights, uint32_t count, int level, int shift, int most,
                                   uint8_t *coarseness);

/* Steps of I-frames, `step_of`, by coarseness: up to 2**33. */
DFCGS_EXPORT void dfcgs_steps(int step, int64_t steps[DFCGS_NUM_COARSENESS]);
/* Those of turns: no larger than DFCGS_MAX_TURN_STEP. */
DFCGS_EXPORT void dfcgs_turn_steps(int step, int64_t steps[DFCGS_NUM_COARSENESS]);

#endif
