#include "prior_column.h"

/* A column under way; `column` [count] holds its values one after the other. */
typedef struct {
    dfcgs_stream *s;
    const dfcgs_component *component;
    const dfcgs_table *tables;
    int32_t *column;
    int64_t *residuals;
} walk;

static dfcgs_status keep(walk *w, uint32_t first, uint32_t stride, uint32_t rows, const int64_t *predictions,
                         const uint8_t *flipped, const int64_t *symbols) {
    for (uint32_t i = 0; i < rows; i++) {
        size_t row = first + (size_t)i * stride;
        int64_t residual = flipped[i] ? -symbols[i] : symbols[i], value = predictions[i] + residual;
        if (value != (int32_t)value)
            return dfcgs_corrupt(w->s->error, DFCGS_NO_OFFSET, "a symbol is too large for its step");
        w->residuals[row] = residual;
        w->column[row] = (int32_t)value;
    }
    return DFCGS_OK;
}

/* Rows first::stride; `mean` and `deviation` NULL in the base. */
static dfcgs_status code_pass(walk *w, uint32_t first, uint32_t stride, uint32_t rows, const int64_t *mean,
                              const int64_t *deviation) {
    dfcgs_arena *arena = w->s->arena;
    int64_t *predictions, *symbols;
    uint8_t *contexts, *flipped;
    DFCGS_GET(predictions, arena, int64_t, rows);
    DFCGS_GET(symbols, arena, int64_t, rows);
    DFCGS_GET(contexts, arena, uint8_t, rows);
    DFCGS_GET(flipped, arena, uint8_t, rows);
    dfcgs_pass(w->component, first, stride, rows, mean, deviation, predictions, contexts, flipped);
    DFCGS_TRY(dfcgs_residuals(w->s, contexts, rows, w->tables, symbols));
    return keep(w, first, stride, rows, predictions, flipped, symbols);
}

static dfcgs_status code_level(walk *w, const dfcgs_levels *levels, int level) {
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    uint32_t rows = dfcgs_level_rows(levels->count, level), coarse = dfcgs_coarse_rows(levels->count, level);
    int64_t *mean, *deviation;
    int32_t *window;
    DFCGS_GET(mean, arena, int64_t, rows);
    DFCGS_GET(deviation, arena, int64_t, rows);
    DFCGS_GET(window, arena, int32_t, (size_t)coarse + DFCGS_NEIGHBOURS);
    int narrow = dfcgs_window(w->column, levels->count, level, window);
    dfcgs_statistics(window, narrow, dfcgs_level_weights(levels, level), rows, mean, deviation);
    DFCGS_TRY(code_pass(w, 1u << level, 2u << level, rows, mean, deviation));
    arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_prior_column(dfcgs_stream *s, const dfcgs_levels *levels, const dfcgs_component *component,
                                const dfcgs_table *tables, int columns, int32_t *values, int64_t *residuals) {
    size_t mark = s->arena->used;
    walk w = {.s = s, .component = component, .tables = tables, .residuals = residuals};
    int num_levels = levels->num_levels < DFCGS_PRIOR_LEVELS ? levels->num_levels : DFCGS_PRIOR_LEVELS;
    DFCGS_GET(w.column, s->arena, int32_t, levels->count);
    size_t passes = s->arena->used;
    DFCGS_TRY(code_pass(&w, 0, 1u << num_levels, (levels->count + (1u << num_levels) - 1) >> num_levels, NULL,
                        NULL));
    s->arena->used = passes;
    for (int level = num_levels - 1; level >= 0; level--) DFCGS_TRY(code_level(&w, levels, level));
    for (uint32_t i = 0; i < levels->count; i++) values[(size_t)i * (size_t)columns] = w.column[i];
    s->arena->used = mark;
    return DFCGS_OK;
}
