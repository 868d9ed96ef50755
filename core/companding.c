#include "companding.h"

enum { KNOT_EXPONENT = -4, THIN_OCTAVE = 11, NUM_OPACITY_KNOTS = 8 };
static const int8_t opacity_knots[NUM_OPACITY_KNOTS] = {0, 28, 42, 54, 66, 77, 88, 99};

static void compand(dfcgs_knots *knots) {
    knots->companded[0] = 0;
    for (int i = 1; i < knots->count; i++)
        knots->companded[i] = knots->companded[i - 1] + ((knots->plain[i] - knots->plain[i - 1]) >> (i - 1));
}

dfcgs_knots dfcgs_opacity_knots(int exponent) {
    dfcgs_knots knots = {.count = NUM_OPACITY_KNOTS};
    for (int i = 0; i < knots.count; i++)
        knots.plain[i] = dfcgs_shift(opacity_knots[i], KNOT_EXPONENT - exponent);
    compand(&knots);
    return knots;
}

dfcgs_knots dfcgs_thin_knots(int exponent, int octaves) {
    dfcgs_knots knots = {.count = octaves + 1};
    for (int i = 0; i < knots.count; i++)
        knots.plain[i] = i * dfcgs_shift(THIN_OCTAVE, KNOT_EXPONENT - exponent);
    compand(&knots);
    return knots;
}

void dfcgs_expand_opacities(const int32_t *opacities, uint32_t count, int exponent, int64_t *logits) {
    dfcgs_knots knots = dfcgs_opacity_knots(exponent);
    for (uint32_t i = 0; i < count; i++) logits[i] = dfcgs_expand(&knots, opacities[i]);
}

void dfcgs_compress_logits(const int32_t *logits, uint32_t count, int exponent, int32_t *opacities) {
    dfcgs_knots knots = dfcgs_opacity_knots(exponent);
    for (uint32_t i = 0; i < count; i++) opacities[i] = (int32_t)dfcgs_compress(&knots, logits[i]);
}

dfcgs_status dfcgs_third_axis(const int32_t *second, const int32_t *thinness, uint32_t count, int exponent,
                              int octaves, int32_t *third) {
    dfcgs_knots knots = dfcgs_thin_knots(exponent, octaves);
    for (uint32_t i = 0; i < count; i++) {
        int64_t value = second[i] - dfcgs_expand(&knots, thinness[i]);
        if (value < -DFCGS_STATE_LIMIT || value > DFCGS_STATE_LIMIT) return DFCGS_CORRUPT;
        third[i] = (int32_t)value;
    }
    return DFCGS_OK;
}
