#include "verbatim_state.h"

#include "companding.h"
#include "rotation.h"

enum { EXPONENT_MASK = 255, BIAS = 150, MAX_SHIFT = 54 };
#define MANTISSA_MASK ((1u << 23) - 1)
/* what rounding gives beyond all that an origin could bring back */
#define FAR ((int64_t)1 << 60)

static int exponent_of(uint32_t pattern) { return pattern >> 23 & EXPONENT_MASK; }
static int is_nan(uint32_t pattern) {
    return exponent_of(pattern) == EXPONENT_MASK && (pattern & MANTISSA_MASK);
}
static int is_finite(uint32_t pattern) { return exponent_of(pattern) != EXPONENT_MASK; }

/* m / 2**n to the nearest integer, halves to even; m >= 0, n >= 1 */
static int64_t round_even(int64_t m, int n) {
    if (n > MAX_SHIFT) return 0;
    int64_t whole = m >> n, rest = m - (whole << n), half = (int64_t)1 << (n - 1);
    return whole + (rest > half || (rest == half && (whole & 1)));
}

/* The value of a pattern over 2**exponent to the nearest integer, halves to even; +-FAR where that is larger.
 */
static int64_t rounded(uint32_t pattern, int exponent) {
    int raw = exponent_of(pattern), shift = (raw ? raw : 1) - BIAS - exponent;
    int64_t mantissa = (pattern & MANTISSA_MASK) | (raw ? (int64_t)1 << 23 : 0), value;
    if (!is_finite(pattern)) value = FAR;
    else if (shift >= 0) value = mantissa == 0 ? 0 : shift > 36 ? FAR : mantissa << shift;
    else value = round_even(mantissa, -shift);
    return pattern >> 31 ? -value : value;
}

static int32_t to_grid(uint32_t pattern, int exponent, int64_t origin) {
    if (is_nan(pattern)) return 0;
    return (int32_t)dfcgs_clip(rounded(pattern, exponent) - origin, -DFCGS_STATE_LIMIT, DFCGS_STATE_LIMIT);
}

static void to_quaternion(const uint32_t *patterns, int32_t *rotation) {
    uint32_t largest = 0;
    int64_t q[4];
    int finite = 1;
    for (int c = 0; c < 4; c++) {
        uint32_t magnitude = patterns[c] & 0x7FFFFFFFu;
        finite &= is_finite(patterns[c]);
        largest = magnitude > largest ? magnitude : largest;
    }
    if (!finite || largest == 0) {
        rotation[0] = 1 << 24;
        rotation[1] = rotation[2] = rotation[3] = 0;
        return;
    }
    /* 2**(n - 1) <= largest < 2**n */
    int raw = exponent_of(largest);
    int n = raw ? raw - 126 : dfcgs_bit_length(largest) - 149;
    for (int c = 0; c < 4; c++) q[c] = rounded(patterns[c], n - 24);
    dfcgs_normalise(q);
    for (int c = 0; c < 4; c++) rotation[c] = (int32_t)q[c];
}

static int exponent_of_attribute(const dfcgs_sequence *sequence, int attribute) {
    switch (attribute) {
    case DFCGS_POSITION: return sequence->position_exponent;
    case DFCGS_SCALE: return sequence->scale_exponent;
    case DFCGS_OPACITY: return sequence->opacity_exponent;
    default: return sequence->color_exponent;
    }
}

static void grid_plane(const dfcgs_sequence *sequence, int attribute, const uint32_t *patterns,
                       uint32_t count, int32_t *plane) {
    int columns = dfcgs_columns(attribute), exponent = exponent_of_attribute(sequence, attribute);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < columns; c++) {
            size_t at = i * (size_t)columns + (size_t)c;
            plane[at] =
                to_grid(patterns[at], exponent, attribute == DFCGS_POSITION ? sequence->origin[c] : 0);
        }
}

void dfcgs_verbatim_state(const dfcgs_sequence *sequence, uint32_t *const *patterns, dfcgs_state *state) {
    for (int a = 0; a < state->num_attributes; a++) {
        if (a != DFCGS_ROTATION) grid_plane(sequence, a, patterns[a], state->count, state->planes[a]);
        else
            for (size_t i = 0; i < state->count; i++)
                to_quaternion(patterns[a] + 4 * i, state->planes[a] + 4 * i);
    }
    dfcgs_compress_logits(state->planes[DFCGS_OPACITY], state->count, sequence->opacity_exponent,
                          state->planes[DFCGS_OPACITY]);
}
