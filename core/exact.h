/* Quotients and roots that are fast and exact: binary64 estimates, put right by integers (chapter 1.2).

   A result here does not depend on how an estimate was rounded, only on its being near. */
#ifndef DFCGS_EXACT_H
#define DFCGS_EXACT_H

#include "core.h"

/* a // b, 0 < b < 2**61, where the quotient's magnitude is below 2**50. */
DFCGS_INLINE int64_t dfcgs_quotient(int64_t a, int64_t b) {
    int64_t estimate = (int64_t)__builtin_floor((double)a / (double)b), rest = a - estimate * b;
    return estimate - (rest < 0) + (rest >= b);
}

/* round_divide(a, b), as dfcgs_quotient; 2 * abs(a) + b shall be below 2**63. */
DFCGS_INLINE int64_t dfcgs_round_quotient(int64_t a, int64_t b) { return dfcgs_quotient(2 * a + b, 2 * b); }

/* isqrt(a), 0 <= a < 2**52: the correctly rounded root of such an integer never rounds up to one. */
DFCGS_INLINE int64_t dfcgs_root(int64_t a) { return (int64_t)__builtin_sqrt((double)a); }

/* log(a) of 17.2, a >= 0: eighths of octaves, at most 199. */
DFCGS_INLINE uint8_t dfcgs_log(uint64_t a) {
    uint32_t limited = a < (1u << 24) ? (uint32_t)a : (1u << 24) - 1;
    if (limited == 0) return 0;
    int length = 32 - __builtin_clz(limited);
    return (uint8_t)(8 * (length - 1) + (int)((limited << 3) >> (length - 1)));
}

#endif
