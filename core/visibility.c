#include "visibility.h"

#include "companding.h"

enum {
    OCTAVES_PER_LOG = 23637,
    OCTAVES_PER_LOG_BITS = 10,
    COVER_WEIGHT = 16,
    MAX_TURN_WEIGHT = 64,
    SPIN_WEIGHT = 16
};
enum { NUM_ALPHA_WEIGHTS = 64, NUM_ROUNDNESS_WEIGHTS = 16 };
#define MAX_WEIGHT ((int64_t)1 << 30)

const int32_t dfcgs_multipliers[DFCGS_NUM_COARSENESS] = {256,  304,  362,  431,  512,  609,  724,  861, 1024,
                                                         1218, 1448, 1722, 2048, 2435, 2896, 3444, 4096};
static const int16_t alpha_weights[NUM_ALPHA_WEIGHTS] = {
    -364, -352, -341, -329, -317, -306, -294, -283, -271, -260, -248, -237, -225, -214, -203, -191,
    -180, -169, -157, -146, -135, -124, -114, -103, -93,  -83,  -74,  -65,  -56,  -49,  -41,  -35,
    -29,  -24,  -20,  -16,  -13,  -10,  -8,   -7,   -5,   -4,   -3,   -3,   -2,   -2,   -1,   -1,
    -1,   -1,   0,    0,    0,    0,    0,    0,    0,    0,    0,    0,    0,    0,    0,    0};
static const int16_t roundness_weights[NUM_ROUNDNESS_WEIGHTS] = {-81, -30, -5, 12, 25, 37,  47,  56,
                                                                 66,  74,  83, 91, 99, 108, 116, 124};

static int32_t limited(int64_t weight) { return (int32_t)dfcgs_clip(weight, -MAX_WEIGHT, MAX_WEIGHT); }

static int shift_of(int scale_exponent) {
    return (int)dfcgs_clip(OCTAVES_PER_LOG_BITS - scale_exponent, 0, 63);
}

static int64_t axis_of(int32_t log_scale, int shift) {
    return ((int64_t)OCTAVES_PER_LOG * log_scale) >> shift;
}

static int64_t alpha_of(const dfcgs_knots *knots, int32_t opacity, int exponent) {
    int64_t quarter = dfcgs_expand(knots, opacity) >> (-2 - exponent);
    return alpha_weights[dfcgs_clip(quarter + NUM_ALPHA_WEIGHTS / 2, 0, NUM_ALPHA_WEIGHTS - 1)];
}

static int64_t roundness(int64_t ratio) {
    ratio = dfcgs_max(ratio, 0);
    return ratio >> 2 < NUM_ROUNDNESS_WEIGHTS ? roundness_weights[ratio >> 2] : 2 * ratio;
}

static int64_t hidden(const uint8_t *cover, uint32_t i) {
    return cover ? COVER_WEIGHT * (int64_t)cover[i] : 0;
}

void dfcgs_visibility(const int32_t *scales, const int32_t *opacities, const uint8_t *cover, uint32_t count,
                      int scale_exponent, int opacity_exponent, int32_t *weights) {
    dfcgs_knots knots = dfcgs_opacity_knots(opacity_exponent);
    int shift = shift_of(scale_exponent);
    int32_t *position = weights, *opacity = position + count, *rotation = opacity + count,
            *rest = rotation + count;
    for (uint32_t i = 0; i < count; i++) {
        int64_t x = axis_of(scales[3 * i], shift), y = axis_of(scales[3 * i + 1], shift),
                z = axis_of(scales[3 * i + 2], shift);
        int64_t low = dfcgs_min(x, y), high = dfcgs_max(x, y);
        int64_t longest = dfcgs_max(high, z), middle = dfcgs_max(low, dfcgs_min(high, z)),
                area = longest + middle;
        int64_t shown = alpha_of(&knots, opacities[i], opacity_exponent) - hidden(cover, i);
        position[i] = limited(shown);
        opacity[i] = limited(area - hidden(cover, i));
        rotation[i] = limited(shown + area + roundness(longest - middle));
        rest[i] = limited(shown + area);
    }
}

void dfcgs_cover_weights(const uint8_t *cover, uint32_t count, int32_t *weights) {
    for (uint32_t i = 0; i < count; i++) weights[i] = (int32_t)-hidden(cover, i);
}

/* The area of the two longest axes. */
static int64_t area_of(int64_t x, int64_t y, int64_t z) { return x + y + z - dfcgs_min(dfcgs_min(x, y), z); }

void dfcgs_area_weights(const int32_t *scales, const uint8_t *cover, uint32_t count, int scale_exponent,
                        int32_t *weights) {
    int shift = shift_of(scale_exponent);
    for (uint32_t i = 0; i < count; i++) {
        const int32_t *s = scales + 3 * (size_t)i;
        int64_t area = area_of(axis_of(s[0], shift), axis_of(s[1], shift), axis_of(s[2], shift));
        weights[i] = limited((area >> 1) - hidden(cover, i));
    }
}

void dfcgs_alpha_weights(const int32_t *opacities, const uint8_t *cover, uint32_t count, int opacity_exponent,
                         int32_t *weights) {
    dfcgs_knots knots = dfcgs_opacity_knots(opacity_exponent);
    for (uint32_t i = 0; i < count; i++)
        weights[i] = limited((alpha_of(&knots, opacities[i], opacity_exponent) >> 1) - hidden(cover, i));
}

void dfcgs_seen_weights(const int32_t *scales, const int32_t *opacities, const uint8_t *cover, uint32_t count,
                        int scale_exponent, int opacity_exponent, int32_t *seen, int32_t *tilts,
                        int32_t *spins, uint8_t *needles) {
    dfcgs_knots knots = dfcgs_opacity_knots(opacity_exponent);
    int shift = shift_of(scale_exponent);
    for (uint32_t i = 0; i < count; i++) {
        const int32_t *s = scales + 3 * (size_t)i;
        int64_t x = axis_of(s[0], shift), y = axis_of(s[1], shift), z = axis_of(s[2], shift);
        int needle = x - y > y - z;
        int64_t lengthened = roundness(x - y),
                flat = dfcgs_min(roundness(needle ? y - z : x - z), MAX_TURN_WEIGHT);
        int64_t shown =
            ((alpha_of(&knots, opacities[i], opacity_exponent) + area_of(x, y, z)) >> 1) - hidden(cover, i);
        seen[i] = limited(shown);
        tilts[i] = limited(shown + (needle ? lengthened : flat));
        spins[i] = limited(shown + (needle ? flat : lengthened) - SPIN_WEIGHT);
        needles[i] = (uint8_t)needle;
    }
}

void dfcgs_coarseness(const int32_t *weights, uint32_t count, int level, int shift, int most,
                      uint8_t *coarseness) {
    for (uint32_t i = 0; i < count; i++) {
        int32_t octaves = (level - weights[i]) >> shift; /* below 2**31: 2**29 + 2**30 at most */
        coarseness[i] = (uint8_t)(octaves < 0 ? 0 : octaves > most ? most : octaves);
    }
}

void dfcgs_steps(int step, int64_t steps[DFCGS_NUM_COARSENESS]) {
    for (int c = 0; c < DFCGS_NUM_COARSENESS; c++)
        steps[c] = dfcgs_round_shift((int64_t)step * dfcgs_multipliers[c], DFCGS_MULTIPLIER_BITS);
}

void dfcgs_turn_steps(int step, int64_t steps[DFCGS_NUM_COARSENESS]) {
    dfcgs_steps(step, steps);
    for (int c = 0; c < DFCGS_NUM_COARSENESS; c++) steps[c] = dfcgs_min(steps[c], DFCGS_MAX_TURN_STEP);
}
