/* 8.4 Output process: a state as floats. Rows go to the places of `order` [count], NULL where they come as
 * they are. */
#ifndef DFCGS_OUTPUT_H
#define DFCGS_OUTPUT_H

#include "core.h"

/* Values [count][columns] times 2**exponent, exponent -60 to 60. */
DFCGS_EXPORT void dfcgs_floats(const int32_t *values, uint32_t count, int columns, int exponent,
                               const int32_t *order, float *floats);

/* Positions [count][3] about `origin`, within +-2**52, as float32 or float64. */
DFCGS_EXPORT void dfcgs_float_positions(const int32_t *positions, uint32_t count, const int64_t origin[3],
                                        int exponent, const int32_t *order, float *floats);
DFCGS_EXPORT void dfcgs_double_positions(const int32_t *positions, uint32_t count, const int64_t origin[3],
                                         int exponent, const int32_t *order, double *doubles);

/* Logits [count] of an OPACITY plane. */
DFCGS_EXPORT void dfcgs_float_logits(const int32_t *opacities, uint32_t count, int exponent,
                                     const int32_t *order, float *floats);

/* Coefficients [count][3][M] above degree 0, channel by channel, from the planes SH_1 to SH_<degree>; those
 * above are NULL. */
DFCGS_EXPORT void dfcgs_float_bands(const int32_t *first, const int32_t *second, const int32_t *third,
                                    uint32_t count, int exponent, const int32_t *order, float *floats);

#endif
