#include "turn_passes.h"

#include "turns.h"

enum { NUM_CONTEXTS = 2 * DFCGS_NUM_SORT_CONTEXTS, NUM_FLIPS = 4 };

typedef struct {
    dfcgs_stream *s;
    const dfcgs_turn_shape *shape;
    dfcgs_table tilt_tables[NUM_CONTEXTS], spin_tables[NUM_CONTEXTS];
    uint32_t has_flips;
    dfcgs_model flips[1];
    int32_t *rotations, *axes; /* [count][4], [count][9] */
} walk;

/* Rows of a level, or of the base, where `frames` [rows][4] is NULL; `tilts` and `spins` [rows] are what is
 * expected. */
typedef struct {
    uint32_t first, stride, rows;
    const int32_t *frames;
    const int64_t *tilts, *spins;
} pass;

static int64_t step_of(const dfcgs_row_steps *steps, size_t row) { return steps->step[steps->class[row]]; }

static void find_contexts(const walk *w, const pass *p, const int64_t *expected, const dfcgs_row_steps *steps,
                          uint8_t *contexts) {
    for (uint32_t i = 0; i < p->rows; i++) {
        size_t row = p->first + (size_t)i * p->stride;
        int needle = w->shape->needles[row], base = DFCGS_NUM_SORT_CONTEXTS * (1 + needle) - 1;
        contexts[i] =
            (uint8_t)(expected ? dfcgs_turn_context(expected[i], step_of(steps, row), needle) : base);
    }
}

/* Symbols of a pass, in the order of the stream: tilts [2][rows], spins [rows], flips [rows]. */
typedef struct {
    int64_t *tilts, *spins;
    uint8_t *flips;
} symbols;

static dfcgs_status read_symbols(walk *w, const pass *p, symbols *found) {
    dfcgs_arena *arena = w->s->arena;
    size_t rows = p->rows;
    uint8_t *contexts;
    DFCGS_GET(found->tilts, arena, int64_t, 2 * rows);
    DFCGS_GET(found->spins, arena, int64_t, rows);
    DFCGS_GET(found->flips, arena, uint8_t, rows);
    DFCGS_GET(contexts, arena, uint8_t, 2 * rows);
    find_contexts(w, p, p->tilts, &w->shape->tilts, contexts);
    memcpy(contexts + rows, contexts, rows);
    DFCGS_TRY(dfcgs_residuals(w->s, contexts, 2 * p->rows, w->tilt_tables, found->tilts));
    find_contexts(w, p, p->spins, &w->shape->spins, contexts);
    DFCGS_TRY(dfcgs_residuals(w->s, contexts, p->rows, w->spin_tables, found->spins));
    if (!w->has_flips) return DFCGS_OK;
    memset(contexts, 0, rows);
    return dfcgs_grouped(w->s, contexts, p->rows, w->flips, found->flips);
}

static dfcgs_status code_pass(walk *w, const pass *p) {
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    symbols found;
    int32_t *tilts, *spins;
    int alternating = w->shape->alternating;
    DFCGS_TRY(read_symbols(w, p, &found));
    DFCGS_GET(tilts, arena, int32_t, 2 * (size_t)p->rows);
    DFCGS_GET(spins, arena, int32_t, p->rows);
    DFCGS_TRY(dfcgs_worths(w->s, found.tilts, 2 * p->rows, &w->shape->tilts, p->first, p->stride, p->rows,
                           alternating, tilts));
    DFCGS_TRY(dfcgs_worths(w->s, found.spins, p->rows, &w->shape->spins, p->first, p->stride, p->rows,
                           alternating, spins));
    dfcgs_apply_turns(p->first, p->stride, p->rows, w->shape->needles, p->frames, tilts, spins,
                      w->has_flips ? found.flips : NULL, w->rotations, w->axes);
    arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status code_level(walk *w, int level) {
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    const dfcgs_levels *levels = &w->shape->levels;
    uint32_t rows = dfcgs_level_rows(levels->count, level);
    int32_t *frames;
    int64_t *tilts, *spins;
    DFCGS_GET(frames, arena, int32_t, 4 * (size_t)rows);
    DFCGS_GET(tilts, arena, int64_t, rows);
    DFCGS_GET(spins, arena, int64_t, rows);
    dfcgs_expect_turns(w->axes, w->shape->needles, levels->count, level, dfcgs_level_weights(levels, level),
                       frames, tilts, spins);
    pass p = {1u << level, 2u << level, rows, frames, tilts, spins};
    DFCGS_TRY(code_pass(w, &p));
    arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_turns(dfcgs_stream *s, const dfcgs_turn_shape *shape, int32_t *rotations) {
    static const uint8_t used[1] = {1};
    size_t mark = s->arena->used;
    walk w = {.s = s, .shape = shape, .rotations = rotations};
    int num_levels = shape->levels.num_levels;
    uint32_t count = shape->levels.count;
    DFCGS_GET(w.axes, s->arena, int32_t, (size_t)count *DFCGS_AXES);
    DFCGS_TRY(dfcgs_read_tables(s, NUM_CONTEXTS, w.tilt_tables));
    DFCGS_TRY(dfcgs_read_tables(s, NUM_CONTEXTS, w.spin_tables));
    DFCGS_TRY(dfcgs_choice(s, 1, &w.has_flips));
    if (w.has_flips) DFCGS_TRY(dfcgs_read_histograms(s, used, 1, NUM_FLIPS, w.flips));
    pass base = {0, 1u << num_levels, (count + (1u << num_levels) - 1) >> num_levels, NULL, NULL, NULL};
    DFCGS_TRY(code_pass(&w, &base));
    for (int level = num_levels - 1; level >= 0; level--) DFCGS_TRY(code_level(&w, level));
    s->arena->used = mark;
    return DFCGS_OK;
}
