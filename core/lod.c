#include "lod.h"

#if defined(__wasm_simd128__)
#include <wasm_simd128.h>
#endif

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

/* Repeats the first and the last of the `rows` values in the margins. */
static void fill_margins(int32_t *window, uint32_t rows) {
    int32_t *inner = window + DFCGS_MARGIN;
    for (int k = 0; k < DFCGS_MARGIN; k++) {
        window[k] = inner[0];
        inner[rows + k] = inner[rows - 1];
    }
}

#if defined(__wasm_simd128__)
/* The values as 16 bits each; they move down only. */
static void halve(int32_t *window, size_t count) {
    for (size_t i = 0; i < count; i++) {
        int16_t value = (int16_t)window[i];
        memcpy((char *)window + sizeof value * i, &value, sizeof value);
    }
}
#endif

int dfcgs_window(const int32_t *column, uint32_t count, int level, int32_t *window) {
    uint32_t rows = dfcgs_coarse_rows(count, level), largest = 0;
    size_t stride = (size_t)2 << level;
    for (uint32_t i = 0; i < rows; i++) {
        int32_t value = column[i * stride];
        uint32_t magnitude = value < 0 ? -(uint32_t)value : (uint32_t)value;
        window[DFCGS_MARGIN + i] = value;
        largest = magnitude > largest ? magnitude : largest;
    }
    fill_margins(window, rows);
#if defined(__wasm_simd128__)
    if (largest < 1 << 14) {
        halve(window, (size_t)rows + DFCGS_NEIGHBOURS);
        return DFCGS_TINY;
    }
#endif
    return largest < 1 << 21 ? DFCGS_NARROW : DFCGS_WIDE;
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

#if defined(__wasm_simd128__)
/* The sums of four times four numbers. */
static v128_t four_sums(const v128_t v[4]) {
    v128_t a = wasm_i32x4_add(wasm_i32x4_shuffle(v[0], v[1], 0, 4, 1, 5),
                              wasm_i32x4_shuffle(v[0], v[1], 2, 6, 3, 7));
    v128_t b = wasm_i32x4_add(wasm_i32x4_shuffle(v[2], v[3], 0, 4, 1, 5),
                              wasm_i32x4_shuffle(v[2], v[3], 2, 6, 3, 7));
    return wasm_i32x4_add(wasm_i32x4_shuffle(a, b, 0, 1, 4, 5), wasm_i32x4_shuffle(a, b, 2, 3, 6, 7));
}

static void store_wide(v128_t values, int64_t *to) {
    wasm_v128_store(to, wasm_i64x2_extend_low_i32x4(values));
    wasm_v128_store(to + 2, wasm_i64x2_extend_high_i32x4(values));
}

/* Of four rows of a tiny window; `deviation`: NULL where nobody asks. */
static void tiny_four(const int16_t *v, const int16_t *w, size_t stride, int64_t *mean, int64_t *deviation) {
    v128_t values[4], weights[4], products[4];
    for (int r = 0; r < 4; r++) {
        values[r] = wasm_v128_load(v + r);
        weights[r] = wasm_v128_load(w + (size_t)r * stride);
        products[r] = wasm_i32x4_dot_i16x8(values[r], weights[r]);
    }
    v128_t means = four_sums(products);
    store_wide(means, mean);
    if (!deviation) return;
    v128_t rounded = wasm_i32x4_shr(wasm_i32x4_add(means, wasm_i32x4_const_splat(128)), WEIGHT_BITS);
    v128_t centers[4] = {wasm_i16x8_shuffle(rounded, rounded, 0, 0, 0, 0, 0, 0, 0, 0),
                         wasm_i16x8_shuffle(rounded, rounded, 2, 2, 2, 2, 2, 2, 2, 2),
                         wasm_i16x8_shuffle(rounded, rounded, 4, 4, 4, 4, 4, 4, 4, 4),
                         wasm_i16x8_shuffle(rounded, rounded, 6, 6, 6, 6, 6, 6, 6, 6)};
    for (int r = 0; r < 4; r++)
        products[r] = wasm_i32x4_dot_i16x8(wasm_i16x8_abs(wasm_i16x8_sub(values[r], centers[r])), weights[r]);
    store_wide(four_sums(products), deviation);
}

/* Of the rows of a tiny window, up to the last three; how many these are. */
static uint32_t tiny_rows(const int16_t *window, const int16_t *w, size_t stride, uint32_t rows,
                          int64_t *mean, int64_t *deviation) {
    uint32_t i = 0;
    for (; i + 4 <= rows; i += 4)
        tiny_four(window + i + 1, w + i * stride, stride, mean + i, deviation ? deviation + i : 0);
    return i;
}

/* The eight neighbours of a row of a tiny window. */
static void widen(const int16_t *from, int32_t *to) {
    wasm_v128_store(to, wasm_i32x4_load16x4(from));
    wasm_v128_store(to + 4, wasm_i32x4_load16x4(from + 4));
}
#else
static uint32_t tiny_rows(const int16_t *window, const int16_t *w, size_t stride, uint32_t rows,
                          int64_t *mean, int64_t *deviation) {
    (void)window, (void)w, (void)stride, (void)rows, (void)mean, (void)deviation;
    return 0;
}

static void widen(const int16_t *from, int32_t *to) {
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) to[k] = from[k];
}
#endif

static void narrow_row(const int32_t *v, const int16_t *w, int64_t *mean, int64_t *deviation) {
    int32_t sum = narrow_mean(v, w);
    *mean = sum;
    if (deviation) *deviation = narrow_deviation(v, w, (sum + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS);
}

static void wide_row(const int32_t *v, const int16_t *w, int64_t *mean, int64_t *deviation) {
    *mean = wide_mean(v, w);
    if (deviation) *deviation = wide_deviation(v, w, dfcgs_round_shift(*mean, WEIGHT_BITS));
}

static void statistics(const int32_t *window, int size, const int16_t *weights, uint32_t rows, int64_t *mean,
                       int64_t *deviation) {
    size_t stride = weights ? DFCGS_NEIGHBOURS : 0;
    const int16_t *w = weights ? weights : equal_weights, *tiny = (const int16_t *)(const void *)window;
    uint32_t i = size == DFCGS_TINY ? tiny_rows(tiny, w, stride, rows, mean, deviation) : 0;
    for (; i < rows; i++) {
        int64_t *deviations = deviation ? deviation + i : 0;
        int32_t few[DFCGS_NEIGHBOURS];
        if (size == DFCGS_TINY) widen(tiny + i + 1, few);
        if (size == DFCGS_WIDE)
            wide_row(window + i + 1, w + i * stride, mean + i, deviations);
        else
            narrow_row(size == DFCGS_TINY ? few : window + i + 1, w + i * stride, mean + i, deviations);
    }
}

void dfcgs_means(const int32_t *window, int size, const int16_t *weights, uint32_t rows, int64_t *mean) {
    statistics(window, size, weights, rows, mean, 0);
}

void dfcgs_statistics(const int32_t *window, int size, const int16_t *weights, uint32_t rows, int64_t *mean,
                      int64_t *deviation) {
    statistics(window, size, weights, rows, mean, deviation);
}
