/* 10.6 Split tables, of integers of up to 448 bits. */
#include "models.h"

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

/* The model is the same from either end: weights of half of it are enough. */
static void fill_split(int bias, int count, uint32_t *cumulative) {
    int64_t shares[DFCGS_MAX_SPLIT_COUNT + 1];
    big weights[DFCGS_MAX_SPLIT_COUNT / 2 + 1], total = {{0}};
    for (int k = 0; k <= count / 2; k++) {
        weights[k] = split_weight(SPLIT_ALPHAS[bias], count, k);
        big_add(&total, &weights[k]);
        if (2 * k < count) big_add(&total, &weights[k]);
    }
    for (int k = 0; k <= count / 2; k++) shares[k] = shares[count - k] = share_of(weights[k], &total);
    dfcgs_from_weights(shares, (uint32_t)count + 1, cumulative);
}

const dfcgs_model *dfcgs_split_model(dfcgs_models *models, int bias, int count) {
    dfcgs_model *model = &models->split[bias][count];
    if (model->size == 0) {
        fill_split(bias, count, (uint32_t *)model->cumulative);
        model->size = (uint32_t)count + 1;
    }
    return model;
}
