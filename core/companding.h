/* 8.3, 9.7 Companded values: a unit is worth twice as much beyond each knot. */
#ifndef DFCGS_COMPANDING_H
#define DFCGS_COMPANDING_H

#include "exact.h"

enum { DFCGS_MAX_KNOTS = 9 };

/* Knots of a curve: `plain` and `companded` values at which the slope doubles, the first of which is 0. */
typedef struct {
    int count;
    int64_t plain[DFCGS_MAX_KNOTS], companded[DFCGS_MAX_KNOTS];
} dfcgs_knots;

/* Those of opacity; exponent -60 to -11. */
dfcgs_knots dfcgs_opacity_knots(int exponent);
/* Those of thin axes; exponent -60 to -11, octaves 1 to 8. */
dfcgs_knots dfcgs_thin_knots(int exponent, int octaves);

/* The number of knots but the first that are not above `magnitude`. */
DFCGS_INLINE int dfcgs_zone(const int64_t *knots, int count, int64_t magnitude) {
    int zone = 0;
    for (int i = 1; i < count; i++) zone += knots[i] <= magnitude;
    return zone;
}

DFCGS_INLINE int64_t dfcgs_expand(const dfcgs_knots *knots, int64_t c) {
    int64_t magnitude = dfcgs_abs(c);
    int zone = dfcgs_zone(knots->companded, knots->count, magnitude);
    int64_t plain = knots->plain[zone] + dfcgs_shift(magnitude - knots->companded[zone], zone);
    return c < 0 ? -plain : plain;
}

DFCGS_INLINE int64_t dfcgs_compress(const dfcgs_knots *knots, int64_t v) {
    int64_t magnitude = dfcgs_abs(v), half;
    int zone = dfcgs_zone(knots->plain, knots->count, magnitude);
    half = ((int64_t)1 << zone) >> 1;
    int64_t companded = knots->companded[zone] + ((magnitude - knots->plain[zone] + half) >> zone);
    return v < 0 ? -companded : companded;
}

/* Logits [count], in units of 2**exponent, of an OPACITY plane. */
DFCGS_EXPORT void dfcgs_expand_opacities(const int32_t *opacities, uint32_t count, int exponent,
                                         int64_t *logits);
/* OPACITY plane of logits [count] within +-DFCGS_STATE_LIMIT. */
DFCGS_EXPORT void dfcgs_compress_logits(const int32_t *logits, uint32_t count, int exponent,
                                        int32_t *opacities);

/* 9.7: column 2 of SCALE from column 1 and how thin axis 2 is beside it, [count] each. */
DFCGS_EXPORT dfcgs_status dfcgs_third_axis(const int32_t *second, const int32_t *thinness, uint32_t count,
                                           int exponent, int octaves, int32_t *third);

#endif
