/* 8.2 Rotations: quaternions [4] in units of 2**-24, vectors [3] in units of 2**-18. */
#ifndef DFCGS_ROTATION_H
#define DFCGS_ROTATION_H

#include "exact.h"

#define DFCGS_ONE ((int64_t)1 << 24)
#define DFCGS_STEREO_ONE ((int64_t)1 << 18)

DFCGS_INLINE void dfcgs_from_stereo(const int64_t p[3], int64_t q[4]) {
    int64_t x = dfcgs_clip(p[0], -DFCGS_STEREO_ONE, DFCGS_STEREO_ONE);
    int64_t y = dfcgs_clip(p[1], -DFCGS_STEREO_ONE, DFCGS_STEREO_ONE);
    int64_t z = dfcgs_clip(p[2], -DFCGS_STEREO_ONE, DFCGS_STEREO_ONE);
    int64_t one = DFCGS_STEREO_ONE * DFCGS_STEREO_ONE, s = x * x + y * y + z * z, d = one + s;
    q[0] = dfcgs_round_quotient((one - s) * DFCGS_ONE, d);
    q[1] = dfcgs_round_quotient(dfcgs_shift(x, 43), d);
    q[2] = dfcgs_round_quotient(dfcgs_shift(y, 43), d);
    q[3] = dfcgs_round_quotient(dfcgs_shift(z, 43), d);
}

/* Hamilton product; `product` may be a factor. */
DFCGS_INLINE void dfcgs_multiply(const int64_t a[4], const int64_t b[4], int64_t product[4]) {
    int64_t w = a[0], x = a[1], y = a[2], z = a[3], s = b[0], i = b[1], j = b[2], k = b[3];
    product[0] = dfcgs_round_shift(w * s - x * i - y * j - z * k, 24);
    product[1] = dfcgs_round_shift(w * i + x * s + y * k - z * j, 24);
    product[2] = dfcgs_round_shift(w * j - x * k + y * s + z * i, 24);
    product[3] = dfcgs_round_shift(w * k + x * j - y * i + z * s, 24);
}

/* Components within +-2**25; `q` is changed. All that is divided is an integer below 2**53, and the correctly
   rounded quotient of such never is an integer that the quotient is below. */
DFCGS_INLINE void dfcgs_normalise(int64_t q[4]) {
    double length = (double)dfcgs_max(dfcgs_root(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), 1);
    for (int c = 0; c < 4; c++)
        q[c] = (int64_t)__builtin_floor(((double)(q[c] * (2 * DFCGS_ONE)) + length) / (2 * length));
}

#endif
