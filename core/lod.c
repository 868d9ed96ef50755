#include "lod.h"

enum { MAX_DIFFERENCE = 1 << 20, WEIGHT_BITS = 8, EQUAL_WEIGHT = 32 };

typedef int32_t four __attribute__((vector_size(16)));
typedef int16_t four_short __attribute__((vector_size(8)));

int dfcgs_num_levels(uint32_t count) {
    int levels = 0;
    while (levels < DFCGS_MAX_LEVELS && count >> (levels + 1) >= DFCGS_MIN_BASE) levels++;
    return levels;
}

/* Coordinates of the coarse rows, one axis, with margins. All in binary64, which holds them exactly. */
static void coarse_axis(const int32_t *positions, uint32_t rows, size_t stride, double *axis) {
    for (uint32_t i = 0; i < rows; i++) axis[DFCGS_MARGIN + i] = positions[i * stride];
    for (int k = 0; k < DFCGS_MARGIN; k++) {
        axis[k] = axis[DFCGS_MARGIN];
        axis[DFCGS_MARGIN + rows + k] = axis[DFCGS_MARGIN + rows - 1];
    }
}

static double clipped_square(double a, double b) {
    double difference = __builtin_fabs(a - b);
    difference = difference < MAX_DIFFERENCE ? difference : MAX_DIFFERENCE;
    return difference * difference;
}

/* Weights of one row from the inverses of its neighbours' distances. Every quotient is one of integers below
   2**53, whose correctly rounded value never rounds up to an integer. */
static void weights_of_row(const double *inverse, int16_t *weights) {
    double total = 0;
    int nearest = 0, sum = 0;
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) total += inverse[k];
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++)
        weights[k] = (int16_t)(inverse[k] * (1 << WEIGHT_BITS) / total);
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) sum += weights[k];
    for (int k = 1; k < DFCGS_NEIGHBOURS; k++)
        if (inverse[k] > inverse[nearest]) nearest = k;
    weights[nearest] = (int16_t)(weights[nearest] + (1 << WEIGHT_BITS) - sum);
}

static void weights_of_level(const int32_t *positions, uint32_t count, int level, double *const axes[3],
                             int16_t *weights) {
    uint32_t rows = dfcgs_level_rows(count, level), coarse = dfcgs_coarse_rows(count, level);
    size_t stride = (size_t)6 << level;
    for (int a = 0; a < 3; a++) coarse_axis(positions + a, coarse, stride, axes[a]);
    const int32_t *own = positions + stride / 2;
    for (uint32_t i = 0; i < rows; i++, own += stride) {
        double inverse[DFCGS_NEIGHBOURS], x = own[0], y = own[1], z = own[2];
        const double *xs = axes[0] + i + 1, *ys = axes[1] + i + 1, *zs = axes[2] + i + 1;
        for (int k = 0; k < DFCGS_NEIGHBOURS; k++) {
            double squared = clipped_square(xs[k], x) + clipped_square(ys[k], y) + clipped_square(zs[k], z);
            inverse[k] = __builtin_floor(4294967296.0 / (__builtin_floor(__builtin_sqrt(squared)) + 1));
        }
        weights_of_row(inverse, weights + (size_t)DFCGS_NEIGHBOURS * i);
    }
}

dfcgs_status dfcgs_distance_weights(dfcgs_arena *arena, const int32_t *positions, uint32_t count,
                                    int16_t *weights) {
    size_t mark = arena->used;
    int levels = dfcgs_num_levels(count);
    double *axes[3];
    for (int a = 0; a < 3; a++)
        if (!(axes[a] = DFCGS_TAKE(arena, double, (size_t)count / 2 + 1 + DFCGS_NEIGHBOURS)))
            return DFCGS_MEMORY;
    for (int level = 0; level < levels; level++)
        weights_of_level(positions, count, level, axes,
                         weights + (size_t)DFCGS_NEIGHBOURS * dfcgs_coarse_rows(count, level));
    arena->used = mark;
    return DFCGS_OK;
}

int dfcgs_window(const int32_t *column, uint32_t count, int level, int32_t *window) {
    uint32_t rows = dfcgs_coarse_rows(count, level), largest = 0;
    size_t stride = (size_t)2 << level;
    int32_t *inner = window + DFCGS_MARGIN;
    for (uint32_t i = 0; i < rows; i++) {
        int32_t value = column[i * stride];
        uint32_t magnitude = value < 0 ? -(uint32_t)value : (uint32_t)value;
        inner[i] = value;
        largest = magnitude > largest ? magnitude : largest;
    }
    for (int k = 0; k < DFCGS_MARGIN; k++) {
        window[k] = inner[0];
        inner[rows + k] = inner[rows - 1];
    }
    return largest < DFCGS_NARROW;
}

static const int16_t equal_weights[DFCGS_NEIGHBOURS] = {EQUAL_WEIGHT, EQUAL_WEIGHT, EQUAL_WEIGHT,
                                                        EQUAL_WEIGHT, EQUAL_WEIGHT, EQUAL_WEIGHT,
                                                        EQUAL_WEIGHT, EQUAL_WEIGHT};

static four load(const int32_t *from) {
    four values;
    memcpy(&values, from, sizeof values);
    return values;
}

static four load_short(const int16_t *from) {
    four_short values;
    memcpy(&values, from, sizeof values);
    return __builtin_convertvector(values, four);
}

static int32_t sum_of(four values) { return values[0] + values[1] + values[2] + values[3]; }

static four magnitudes(four values) {
    four negative = values >> 31;
    return (values ^ negative) - negative;
}

static int32_t narrow_mean(const int32_t *v, const int16_t *w) {
    return sum_of(load(v) * load_short(w) + load(v + 4) * load_short(w + 4));
}

static int32_t narrow_deviation(const int32_t *v, const int16_t *w, int32_t rounded) {
    four center = {rounded, rounded, rounded, rounded};
    return sum_of(magnitudes(load(v) - center) * load_short(w) +
                  magnitudes(load(v + 4) - center) * load_short(w + 4));
}

static int64_t wide_mean(const int32_t *v, const int16_t *w) {
    int64_t total = 0;
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) total += (int64_t)v[k] * w[k];
    return total;
}

static int64_t wide_deviation(const int32_t *v, const int16_t *w, int64_t rounded) {
    int64_t total = 0;
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) total += dfcgs_abs(v[k] - rounded) * w[k];
    return total;
}

void dfcgs_means(const int32_t *window, int narrow, const int16_t *weights, uint32_t rows, int64_t *mean) {
    size_t stride = weights ? DFCGS_NEIGHBOURS : 0;
    const int16_t *w = weights ? weights : equal_weights;
    for (uint32_t i = 0; i < rows; i++, w += stride)
        mean[i] = narrow ? narrow_mean(window + i + 1, w) : wide_mean(window + i + 1, w);
}

void dfcgs_statistics(const int32_t *window, int narrow, const int16_t *weights, uint32_t rows, int64_t *mean,
                      int64_t *deviation) {
    size_t stride = weights ? DFCGS_NEIGHBOURS : 0;
    const int16_t *w = weights ? weights : equal_weights;
    for (uint32_t i = 0; i < rows; i++, w += stride) {
        const int32_t *v = window + i + 1;
        mean[i] = narrow ? narrow_mean(v, w) : wide_mean(v, w);
        int64_t rounded = dfcgs_round_shift(mean[i], WEIGHT_BITS);
        deviation[i] = narrow ? narrow_deviation(v, w, (int32_t)rounded) : wide_deviation(v, w, rounded);
    }
}
