#include "models.h"

enum {
    ONE = 1 << DFCGS_FREQUENCY_BITS,
    NORMAL_SIZE = 9217,
    EXPONENTIAL_SIZE = 24577,
    SCALES_PER_OCTAVE = 6,
    MAX_MAGNITUDE = 511,
    SQRT_TWO = 1482910, /* 2**20 sqrt(2) */
    LINEAR = 8,         /* models of so few symbols are searched from the first one */
    STARTS = 256,
    START_SHIFT = DFCGS_FREQUENCY_BITS - 8
};

/* --- 10.4 -------------------------------------------------------------------------------------------------
 */

void dfcgs_from_weights(const int64_t *weights, uint32_t size, uint32_t *cumulative) {
    int64_t total = 0, sum = 0;
    for (uint32_t s = 0; s < size; s++) total += weights[s];
    for (uint32_t s = 0; s < size; s++) {
        cumulative[s] = (uint32_t)(sum * (ONE - (int64_t)size) / total + s);
        sum += weights[s];
    }
    cumulative[size] = ONE;
}

static void fill_starts(const uint32_t *cumulative, uint16_t *start) {
    uint16_t s = 0;
    for (uint32_t i = 0; i < STARTS; i++) {
        while (cumulative[s + 1] <= i << START_SHIFT) s++;
        start[i] = s;
    }
}

dfcgs_status dfcgs_make_model(dfcgs_arena *arena, uint32_t size, const uint32_t *cumulative,
                              dfcgs_model *model) {
    uint16_t *start = NULL;
    if (size > LINEAR) {
        DFCGS_GET(start, arena, uint16_t, STARTS);
        fill_starts(cumulative, start);
    }
    *model = (dfcgs_model){size, cumulative, start};
    return DFCGS_OK;
}

dfcgs_status dfcgs_model_of(dfcgs_arena *arena, uint32_t size, const int32_t *frequencies,
                            dfcgs_model *model) {
    uint32_t *cumulative;
    int64_t sum = 0;
    DFCGS_GET(cumulative, arena, uint32_t, (size_t)size + 1);
    cumulative[0] = 0;
    for (uint32_t s = 0; s < size; s++) {
        sum += frequencies[s];
        if (frequencies[s] < 1 || sum > ONE) return DFCGS_MISUSE;
        cumulative[s + 1] = (uint32_t)sum;
    }
    return sum == ONE ? dfcgs_make_model(arena, size, cumulative, model) : DFCGS_MISUSE;
}

/* --- 10.5: the two master tables, in 128 bits
 * ---------------------------------------------------------------- */

typedef struct {
    uint64_t high, low;
} wide;

static wide add(wide a, wide b) {
    wide sum = {a.high + b.high, a.low + b.low};
    sum.high += sum.low < a.low;
    return sum;
}

static wide subtract(wide a, wide b) { return (wide){a.high - b.high - (a.low < b.low), a.low - b.low}; }

static wide shift_right(wide a, int n) { return (wide){a.high >> n, a.low >> n | a.high << (64 - n)}; }

/* The product of two 64-bit integers. */
static wide product(uint64_t a, uint64_t b) {
    uint64_t a0 = (uint32_t)a, a1 = a >> 32, b0 = (uint32_t)b, b1 = b >> 32;
    uint64_t low = a0 * b0, middle = a1 * b0 + (low >> 32);
    __asm__(
        ""
        : "+r"(middle)); /* else clang makes one 128-bit product of this, which WebAssembly does not have */
    uint64_t other = a0 * b1 + (uint32_t)middle;
    return (wide){a1 * b1 + (middle >> 32) + (other >> 32), other << 32 | (uint32_t)low};
}

/* a * b >> 128 */
static wide high_product(wide a, wide b) {
    wide low = product(a.low, b.low), one = product(a.high, b.low), two = product(a.low, b.high);
    wide middle = add((wide){0, low.high}, one);
    wide carry = {0, middle.high};
    middle = add((wide){0, middle.low}, two);
    carry = add(carry, (wide){0, middle.high});
    return add(product(a.high, b.high), carry);
}

/* a * small // divisor, both below 2**34 */
static wide scaled(wide a, uint64_t small, uint64_t divisor) {
    uint64_t part[4] = {a.low & 0xFFFFFFFFu, a.low >> 32, a.high & 0xFFFFFFFFu, a.high >> 32}, carry = 0,
             limbs[5];
    for (int i = 0; i < 4; i++) {
        carry += part[i] * small; /* small is below 2**14 here */
        limbs[i] = (uint32_t)carry;
        carry >>= 32;
    }
    limbs[4] = carry;
    uint64_t rest = 0, quotient[5];
    for (int i = 4; i >= 0; i--) { /* divisor is 12 * 2**30, below 2**34: 16 bits at a time */
        uint64_t upper = rest << 16 | limbs[i] >> 16;
        uint64_t lower = (upper % divisor) << 16 | (limbs[i] & 0xFFFF);
        quotient[i] = (upper / divisor) << 16 | lower / divisor;
        rest = lower % divisor;
    }
    return (wide){quotient[3] << 32 | quotient[2], quotient[1] << 32 | quotient[0]};
}

static const wide ROUNDING = {(uint64_t)1 << 31, 0}; /* 2**95 */

/* value >> 96 of a value from 2**127 to a little above 2**128, of which 128 bits are left. */
static int64_t top_bits(wide value) {
    int64_t top = (int64_t)(value.high >> 32);
    return top >> 31 ? top : top + ((int64_t)1 << 32);
}

/* NORMAL[i] = 2**32 Phi(i / 1024) */
static void fill_normal(int64_t *normal) {
    wide density = {0x662114CF50D94234, 0x3F2CF1402EAE38BF}, ratio = {0xFFFFF800001FFFFF, 0xAAAAAB5555544444};
    const wide shrink = {0xFFFFF000007FFFFD, 0x55555FFFFFDDDDDE}, half = {(uint64_t)1 << 63, 0};
    wide total = {0, 0};
    uint32_t carried = 0; /* what of the total lies above 128 bits */
    normal[0] = (int64_t)1 << 31;
    for (uint32_t i = 1; i < NORMAL_SIZE; i++) {
        wide following = high_product(density, ratio), both = add(density, following), before = total;
        uint32_t carry = both.high < density.high || (both.high == density.high && both.low < density.low);
        ratio = high_product(ratio, shrink);
        total = add(total, both);
        carry += total.high < before.high || (total.high == before.high && total.low < before.low);
        carried += carry;
        wide area = shift_right(total, 11);
        area.high |= (uint64_t)carried << 53;
        wide value = add(add(half, area), add(scaled(following, i, (uint64_t)12 << 30), ROUNDING));
        normal[i] = top_bits(value);
        density = following;
    }
}

/* EXPONENTIAL[i] = 2**32 (1 - exp(-i / 1024) / 2) */
static void fill_exponential(int64_t *exponential) {
    wide tail = {(uint64_t)1 << 63, 0};
    const wide ratio = {0xFFC007FF555FFF77, 0x7D279E7B87ACECDF};
    for (uint32_t i = 0; i < EXPONENTIAL_SIZE; i++) {
        wide value = add(subtract((wide){0, 0}, tail), ROUNDING); /* 2**128 less the tail */
        exponential[i] = top_bits(value);
        tail = high_product(tail, ratio);
    }
}

/* --- 10.5: scale tables
 * ------------------------------------------------------------------------------------- */

static const uint32_t INVERSE_SIGMAS[DFCGS_NUM_BASE_SCALES] = {
    21137968, 18831788, 16777216, 14946800, 13316085, 11863283, 10568984, 9415894, 8388608, 7473400, 6658043,
    5931642,  5284492,  4707947,  4194304,  3736700,  3329021,  2965821,  2642246, 2353974, 2097152, 1868350,
    1664511,  1482910,  1321123,  1176987,  1048576,  934175,   832255,   741455,  660561,  588493,  524288,
    467088,   416128,   370728,   330281,   294247,   262144,   233544,   208064,  185364,  165140,  147123,
    131072,   116772,   104032,   92682,    82570,    73562,    65536,    58386,   52016,   46341,   41285,
    36781,    32768,    29193,    26008,    23170,    20643,    18390,    16384,   14596};
static const uint8_t TWICE_REACH[DFCGS_NUM_SHAPES] = {11, 16, 24};

typedef struct {
    int64_t normal[NORMAL_SIZE], exponential[EXPONENTIAL_SIZE];
} masters;

static int64_t interpolate(const int64_t *master, int64_t size, int64_t m) {
    int64_t i = dfcgs_min(m >> 10, size - 2), f = dfcgs_min(m - (i << 10), 1024);
    return master[i] + (((master[i + 1] - master[i]) * f) >> 10);
}

static int64_t cdf(const masters *tables, int shape, int scale, int64_t e) {
    int64_t magnitude = e < 0 ? -e : e, m, value;
    if (scale < 0) m = magnitude * INVERSE_SIGMAS[scale + SCALES_PER_OCTAVE] >> 1 << 1;
    else if (scale >= DFCGS_NUM_BASE_SCALES)
        m = magnitude * INVERSE_SIGMAS[scale - SCALES_PER_OCTAVE] >> 1 >> 1;
    else m = magnitude * INVERSE_SIGMAS[scale] >> 1;
    if (shape == DFCGS_GAUSSIAN) value = interpolate(tables->normal, NORMAL_SIZE, m);
    else value = interpolate(tables->exponential, EXPONENTIAL_SIZE, m * SQRT_TWO >> 20);
    return e > 0 ? value : ((int64_t)1 << 32) - value;
}

static int64_t shape_cdf(const masters *tables, int shape, int scale, int64_t e) {
    if (shape != DFCGS_HEAVY) return cdf(tables, shape, scale, e);
    return (cdf(tables, DFCGS_LAPLACE, scale - SCALES_PER_OCTAVE, e) +
            cdf(tables, DFCGS_LAPLACE, scale + SCALES_PER_OCTAVE, e)) >>
           1;
}

static int64_t reach_of(int shape, int scale) {
    return dfcgs_min(MAX_MAGNITUDE, 2 + ((int64_t)TWICE_REACH[shape] << 19) / INVERSE_SIGMAS[scale]);
}

static dfcgs_status make_scale_model(dfcgs_arena *arena, const masters *tables, int shape, int scale,
                                     dfcgs_model *model) {
    int64_t k = reach_of(shape, scale), size = 2 * k + 1;
    uint32_t *cumulative;
    DFCGS_GET(cumulative, arena, uint32_t, (size_t)size + 1);
    cumulative[0] = 0;
    for (int64_t s = 1; s < size; s++) {
        int64_t c = shape_cdf(tables, shape, scale, 2 * (s - k) - 1);
        cumulative[s] = (uint32_t)((c * (ONE - size) >> 32) + s);
    }
    cumulative[size] = ONE;
    return dfcgs_make_model(arena, (uint32_t)size, cumulative, model);
}

/* --- 10.6: split tables, of integers of up to 448 bits
 * ---------------------------------------------------------- */

static const uint16_t SPLIT_ALPHAS[DFCGS_NUM_BIASES] = {1,  2,  3,  4,  6,  8,   12,  16,
                                                        24, 32, 48, 64, 96, 128, 256, 1024};
enum { LIMBS = 16 };
typedef struct {
    uint32_t limb[LIMBS];
} big;

static void big_multiply(big *a, uint32_t by) {
    uint64_t carry = 0;
    for (int i = 0; i < LIMBS; i++) {
        carry += (uint64_t)a->limb[i] * by;
        a->limb[i] = (uint32_t)carry;
        carry >>= 32;
    }
}

static void big_divide(big *a, uint32_t by) {
    uint64_t rest = 0;
    for (int i = LIMBS - 1; i >= 0; i--) {
        rest = rest << 32 | a->limb[i];
        a->limb[i] = (uint32_t)(rest / by);
        rest %= by;
    }
}

static void big_add(big *a, const big *b) {
    uint64_t carry = 0;
    for (int i = 0; i < LIMBS; i++) {
        carry += (uint64_t)a->limb[i] + b->limb[i];
        a->limb[i] = (uint32_t)carry;
        carry >>= 32;
    }
}

static int big_less(const big *a, const big *b) {
    for (int i = LIMBS - 1; i >= 0; i--)
        if (a->limb[i] != b->limb[i]) return a->limb[i] < b->limb[i];
    return 0;
}

static void big_subtract(big *a, const big *b) {
    int64_t borrow = 0;
    for (int i = 0; i < LIMBS; i++) {
        borrow += (int64_t)a->limb[i] - b->limb[i];
        a->limb[i] = (uint32_t)borrow;
        borrow >>= 32;
    }
}

/* (w << 30) // total, w <= total */
static int64_t share_of(big w, const big *total) {
    int64_t share = 0;
    for (int i = 0; i <= 30; i++) {
        if (!big_less(&w, total)) {
            big_subtract(&w, total);
            share |= (int64_t)1 << (30 - i);
        }
        big_multiply(&w, 2);
    }
    return share;
}

/* binomial(count, k) * rising[k] * rising[count - k] */
static big split_weight(uint32_t alpha, int count, int k) {
    big w = {{1}};
    for (int i = 0; i < k; i++) {
        big_multiply(&w, (uint32_t)(count - i));
        big_divide(&w, (uint32_t)(i + 1));
    }
    for (int i = 0; i < k; i++) big_multiply(&w, alpha + 8 * (uint32_t)i);
    for (int i = 0; i < count - k; i++) big_multiply(&w, alpha + 8 * (uint32_t)i);
    return w;
}

static void fill_split(int bias, int count, uint32_t *cumulative) {
    int64_t weights[DFCGS_MAX_SPLIT_COUNT + 1];
    big total = {{0}};
    for (int k = 0; k <= count; k++) {
        big w = split_weight(SPLIT_ALPHAS[bias], count, k);
        big_add(&total, &w);
    }
    for (int k = 0; k <= count; k++)
        weights[k] = share_of(split_weight(SPLIT_ALPHAS[bias], count, k), &total);
    dfcgs_from_weights(weights, (uint32_t)count + 1, cumulative);
}

const dfcgs_model *dfcgs_split_model(dfcgs_models *models, int bias, int count) {
    dfcgs_model *model = &models->split[bias][count];
    if (model->size == 0) {
        fill_split(bias, count, (uint32_t *)model->cumulative);
        model->size = (uint32_t)count + 1;
    }
    return model;
}

/* -------------------------------------------------------------------------------------------------------------
 */

static dfcgs_status make_scale_models(dfcgs_arena *arena, const masters *tables, dfcgs_models *models) {
    for (int shape = 0; shape < DFCGS_NUM_SHAPES; shape++)
        for (int scale = 0; scale < DFCGS_NUM_BASE_SCALES; scale++)
            DFCGS_TRY(make_scale_model(arena, tables, shape, scale, &models->scale[shape][scale]));
    return DFCGS_OK;
}

static dfcgs_status take_split_models(dfcgs_arena *arena, dfcgs_models *models) {
    memset(models->split, 0, sizeof models->split);
    for (int bias = 0; bias < DFCGS_NUM_BIASES; bias++)
        for (int count = 2; count <= DFCGS_MAX_SPLIT_COUNT; count++)
            DFCGS_GET(models->split[bias][count].cumulative, arena, uint32_t, (size_t)count + 2);
    return DFCGS_OK;
}

dfcgs_status dfcgs_make_models(dfcgs_arena *arena, dfcgs_models *models) {
    /* the master tables are needed for a moment: they stand behind what stays */
    size_t sizes = 0;
    for (int shape = 0; shape < DFCGS_NUM_SHAPES; shape++)
        for (int scale = 0; scale < DFCGS_NUM_BASE_SCALES; scale++)
            sizes += 4 * (2 * (size_t)reach_of(shape, scale) + 2) + STARTS * sizeof(uint16_t) + 32;
    uint8_t *kept;
    DFCGS_TRY(take_split_models(arena, models));
    DFCGS_GET(kept, arena, uint8_t, sizes);
    size_t mark = arena->used;
    masters *tables;
    DFCGS_GET(tables, arena, masters, 1);
    fill_normal(tables->normal);
    fill_exponential(tables->exponential);
    dfcgs_arena own = {kept, sizes, 0, 0};
    DFCGS_TRY(make_scale_models(&own, tables, models));
    arena->used = mark;
    return DFCGS_OK;
}

dfcgs_table dfcgs_table_of(const dfcgs_models *models, int index) {
    int shape = index / DFCGS_NUM_SCALES, scale = index % DFCGS_NUM_SCALES,
        above = scale - DFCGS_NUM_BASE_SCALES;
    if (above < 0) return (dfcgs_table){&models->scale[shape][scale], 0};
    int base = DFCGS_NUM_BASE_SCALES - SCALES_PER_OCTAVE + above % SCALES_PER_OCTAVE;
    return (dfcgs_table){&models->scale[shape][base], above / SCALES_PER_OCTAVE + 1};
}
