#include "column.h"

#include "reconstruct.h"

enum { BASE_CONTEXT = 31, SIZE_SHIFT = 11, FRACTION_BITS = 16, MEAN_BITS = 8, BLOCK = 1024 };

/* A column under way. `learned`, `size` [count]: what features and sources add up to; NULL where all weights
 * are 0. */
typedef struct {
    dfcgs_stream *s;
    const dfcgs_column_shape *shape;
    int64_t center, weight, size_weights[2];
    const int64_t *learned, *size;
    dfcgs_table tables[DFCGS_COLUMN_CONTEXTS];
    int32_t *values, *residuals;
} walk;

/* Rows of a pass: `first`, first + stride, ...; NULL `mean` in passes without neighbours. */
typedef struct {
    size_t first, stride;
    uint32_t count;
    const int64_t *mean, *deviation;
} pass;

/* --- what earlier columns say ------------------------------------------------------------------------ */

static void add_features(int64_t *sum, const int32_t *feature, uint32_t count, int32_t weight) {
    for (uint32_t i = 0; i < count; i++) sum[i] += (int64_t)feature[i] * weight;
}

static void add_sources(int64_t *sum, const int32_t *source, uint32_t count, int32_t weight) {
    for (uint32_t i = 0; i < count; i++)
        sum[i] += (int64_t)(source[i] < 0 ? -source[i] : source[i]) * weight;
}

/* Sums [count] over all columns with weights other than 0, block by block, so that they stay in the cache. */
static dfcgs_status weighted_sums(dfcgs_stream *s, const dfcgs_column_shape *shape, const int64_t *weights,
                                  void (*add)(int64_t *, const int32_t *, uint32_t, int32_t),
                                  const int64_t **sums) {
    uint32_t count = shape->levels.count;
    int64_t *sum, any = 0;
    *sums = NULL;
    for (int j = 0; j < shape->num_earlier; j++) any |= weights[j];
    if (!any) return DFCGS_OK;
    DFCGS_GET_ZEROS(sum, s->arena, int64_t, count);
    for (uint32_t start = 0; start < count; start += BLOCK) {
        uint32_t rows = count - start < BLOCK ? count - start : BLOCK;
        for (int j = 0; j < shape->num_earlier; j++)
            if (weights[j]) add(sum + start, shape->earlier[j] + start, rows, (int32_t)weights[j]);
    }
    *sums = sum;
    return DFCGS_OK;
}

/* --- a pass ------------------------------------------------------------------------------------------ */

static void predict(const walk *w, const pass *p, int64_t *predictions) {
    int64_t center = w->center;
    for (uint32_t i = 0; i < p->count; i++) {
        int64_t t = w->learned ? dfcgs_shift(w->learned[p->first + i * p->stride], MEAN_BITS) : 0;
        if (p->mean) t += (p->mean[i] - dfcgs_shift(center, MEAN_BITS)) * w->weight;
        predictions[i] = center + dfcgs_round_shift(t, FRACTION_BITS);
    }
}

static inline int64_t step_of(const dfcgs_row_steps *steps, size_t row) {
    return steps->step[steps->class ? steps->class[row] : 0];
}

static void round_to_steps(const walk *w, const pass *p, int64_t *predictions) {
    const dfcgs_row_steps *steps = &w->shape->steps;
    for (uint32_t i = 0; i < p->count; i++) {
        int64_t step = step_of(steps, p->first + i * p->stride);
        if (step > 1) predictions[i] = dfcgs_round_quotient(predictions[i], step) * step;
    }
}

static void find_contexts(const walk *w, const pass *p, uint8_t *contexts) {
    const dfcgs_row_steps *steps = &w->shape->steps;
    for (uint32_t i = 0; i < p->count; i++) {
        size_t row = p->first + i * p->stride;
        int64_t step = step_of(steps, row), own = w->size_weights[1] * step + (w->size ? w->size[row] : 0);
        int64_t t = dfcgs_shift(own, MEAN_BITS) + (p->deviation ? p->deviation[i] * w->size_weights[0] : 0);
        contexts[i] = t <= 0 ? 0 : (uint8_t)dfcgs_ladder(dfcgs_quotient(t >> SIZE_SHIFT, step), BASE_CONTEXT);
    }
}

static dfcgs_status too_large(dfcgs_stream *s) {
    return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a symbol is too large for its step");
}

/* Symbols as 32 bits, which hold all that is not too large. */
static dfcgs_status limited(dfcgs_stream *s, const int64_t *symbols, uint32_t count,
                            const dfcgs_row_steps *steps, size_t first, size_t stride, uint32_t wrap,
                            int32_t *narrow) {
    int64_t limits[DFCGS_NUM_COARSENESS];
    for (int c = 0; c < DFCGS_NUM_COARSENESS; c++)
        limits[c] = steps->class || c == 0 ? 2 * (int64_t)DFCGS_STATE_LIMIT / steps->step[c] : 0;
    for (uint32_t i = 0; i < count; i++) {
        size_t row = first + (i < wrap ? i : i - wrap) * stride;
        int64_t limit = limits[steps->class ? steps->class[row] : 0];
        if (symbols[i] < -limit || symbols[i] > limit) return too_large(s);
        narrow[i] = (int32_t)symbols[i];
    }
    return DFCGS_OK;
}

dfcgs_status dfcgs_worths(dfcgs_stream *s, const int64_t *symbols, uint32_t count,
                          const dfcgs_row_steps *steps, size_t first, size_t stride, uint32_t wrap,
                          int alternating, int32_t *worth) {
    size_t mark = s->arena->used;
    uint8_t *second = NULL;
    DFCGS_TRY(limited(s, symbols, count, steps, first, stride, wrap, worth));
    if (alternating && count >= DFCGS_FEWEST_SYMBOLS) {
        DFCGS_GET(second, s->arena, uint8_t, count);
        dfcgs_second_quantisers(worth, count, second);
    }
    for (uint32_t i = 0; i < count; i++) {
        size_t row = first + (i < wrap ? i : i - wrap) * stride;
        worth[i] = dfcgs_worth(worth[i], step_of(steps, row), second ? second[i] : 0);
    }
    s->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status keep(walk *w, const pass *p, const int64_t *predictions, const int32_t *worth) {
    for (uint32_t i = 0; i < p->count; i++) {
        size_t row = p->first + i * p->stride;
        int64_t value = predictions[i] + worth[i];
        if (value < -DFCGS_STATE_LIMIT || value > DFCGS_STATE_LIMIT)
            return dfcgs_corrupt(w->s->error, DFCGS_NO_OFFSET,
                                 "a reconstructed value leaves the range of the state");
        w->values[row] = (int32_t)value;
        if (w->residuals) w->residuals[row] = worth[i];
    }
    return DFCGS_OK;
}

static dfcgs_status code_pass(walk *w, const pass *p, int is_base) {
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    const dfcgs_column_shape *shape = w->shape;
    int64_t *predictions, *symbols;
    int32_t *worth;
    uint8_t *contexts;
    DFCGS_GET(predictions, arena, int64_t, p->count);
    DFCGS_GET(symbols, arena, int64_t, p->count);
    DFCGS_GET(worth, arena, int32_t, p->count);
    DFCGS_GET(contexts, arena, uint8_t, p->count);
    predict(w, p, predictions);
    if (shape->in_steps) round_to_steps(w, p, predictions);
    if (is_base) memset(contexts, BASE_CONTEXT, p->count);
    else find_contexts(w, p, contexts);
    DFCGS_TRY(dfcgs_residuals(w->s, contexts, p->count, w->tables, symbols));
    DFCGS_TRY(dfcgs_worths(w->s, symbols, p->count, &shape->steps, p->first, p->stride, p->count,
                           shape->alternating, worth));
    DFCGS_TRY(keep(w, p, predictions, worth));
    arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status code_level(walk *w, int level) {
    const dfcgs_levels *levels = &w->shape->levels;
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    uint32_t rows = dfcgs_level_rows(levels->count, level), coarse = dfcgs_coarse_rows(levels->count, level);
    int64_t *mean, *deviation;
    int32_t *window;
    DFCGS_GET(mean, arena, int64_t, rows);
    DFCGS_GET(deviation, arena, int64_t, rows);
    DFCGS_GET(window, arena, int32_t, (size_t)coarse + DFCGS_NEIGHBOURS);
    int narrow = dfcgs_window(w->values, levels->count, level, window);
    dfcgs_statistics(window, narrow, dfcgs_level_weights(levels, level), rows, mean, deviation);
    pass p = {(size_t)1 << level, (size_t)2 << level, rows, mean, deviation};
    DFCGS_TRY(code_pass(w, &p, 0));
    arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status code_passes(walk *w) {
    const dfcgs_levels *levels = &w->shape->levels;
    int is_spatial = w->weight != 0 || w->size_weights[0] != 0;
    int num_levels = is_spatial ? levels->num_levels : 0;
    size_t stride = (size_t)1 << num_levels;
    pass base = {0, stride, (uint32_t)((levels->count + stride - 1) / stride), NULL, NULL};
    DFCGS_TRY(code_pass(w, &base, is_spatial));
    for (int level = num_levels - 1; level >= 0; level--) DFCGS_TRY(code_level(w, level));
    return DFCGS_OK;
}

/* ----------------------------------------------------------------------------------------------------- */

dfcgs_status dfcgs_column(dfcgs_stream *s, const dfcgs_column_shape *shape, int32_t *values,
                          int32_t *residuals) {
    size_t mark = s->arena->used;
    walk w = {.s = s, .shape = shape, .values = values, .residuals = residuals};
    int64_t weights[1 + DFCGS_MAX_EARLIER], size_weights[2 + DFCGS_MAX_EARLIER];
    uint32_t num_earlier = (uint32_t)shape->num_earlier;
    DFCGS_TRY(dfcgs_signed_value(s, DFCGS_STATE_LIMIT, &w.center));
    DFCGS_TRY(dfcgs_read_weights(s, 1 + num_earlier, weights));
    DFCGS_TRY(dfcgs_read_weights(s, 2 + num_earlier, size_weights));
    DFCGS_TRY(dfcgs_read_tables(s, DFCGS_COLUMN_CONTEXTS, w.tables));
    w.weight = weights[0];
    memcpy(w.size_weights, size_weights, sizeof w.size_weights);
    DFCGS_TRY(weighted_sums(s, shape, weights + 1, add_features, &w.learned));
    DFCGS_TRY(weighted_sums(s, shape, size_weights + 2, add_sources, &w.size));
    DFCGS_TRY(code_passes(&w));
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_column_shape dfcgs_plain_column(dfcgs_levels levels) {
    dfcgs_column_shape shape = {.levels = levels};
    shape.steps.step[0] = 1;
    return shape;
}
