#include "inter.h"

#include "side_information.h"

enum {
    PRESENT_SHARE = 256,
    SYMBOL_WEIGHT = 256,
    MEMORY_WEIGHT = 16,
    SMALL = 16,
    MAX_KINDS = 4,
    MAX_COLUMNS = 21
};

/* The stream of an attribute under way: `rows` are those of blocks with symbols, `inputs` [num_rows][20]
 * theirs. */
typedef struct {
    dfcgs_stream *s;
    const dfcgs_inter_context *context;
    dfcgs_activity *activity;
    uint32_t count, num_blocks, num_rows;
    int columns;
    uint8_t *density, *magnitude, *inputs;
    uint32_t *rows;
} walk;

/* The coded rows: `rows` are Gaussians, `places` where they stand among those of the walk, `flagged` whether
 * they have a flag. */
typedef struct {
    uint32_t count;
    uint32_t *rows, *places;
    uint8_t *flagged;
} coded;

/* --- 12.2
 * ---------------------------------------------------------------------------------------------------------
 */

static dfcgs_status read_densities(walk *w) {
    uint8_t *contexts;
    DFCGS_GET(contexts, w->s->arena, uint8_t, w->num_blocks);
    for (uint32_t b = 0; b < w->num_blocks; b++)
        contexts[b] = (uint8_t)(DFCGS_NUM_DENSITIES * w->activity->density[b] + w->context->beside[b]);
    return dfcgs_grouped(w->s, contexts, w->num_blocks, w->context->model->densities, w->density);
}

static dfcgs_status read_magnitudes(walk *w) {
    uint8_t *contexts;
    int64_t *changes;
    uint32_t num = 0;
    DFCGS_GET(contexts, w->s->arena, uint8_t, w->num_blocks);
    DFCGS_GET(changes, w->s->arena, int64_t, w->num_blocks);
    for (uint32_t b = 0; b < w->num_blocks; b++)
        if (w->density[b])
            contexts[num++] =
                (uint8_t)(w->density[b] + (w->activity->magnitude[b] ? DFCGS_NUM_DENSITIES : 0));
    DFCGS_TRY(dfcgs_residuals(w->s, contexts, num, w->context->model->magnitudes, changes));
    num = 0;
    for (uint32_t b = 0; b < w->num_blocks; b++) {
        int64_t changed = w->density[b] ? w->activity->magnitude[b] + changes[num++] : 0;
        w->magnitude[b] = (uint8_t)dfcgs_clip(changed, 0, DFCGS_NUM_MAGNITUDES - 1);
    }
    return DFCGS_OK;
}

/* --- 12.3
 * ---------------------------------------------------------------------------------------------------------
 */

static dfcgs_status find_inputs(walk *w) {
    dfcgs_known known = w->context->known;
    known.density = w->density;
    known.magnitude = w->magnitude;
    DFCGS_GET(w->rows, w->s->arena, uint32_t, w->count);
    for (uint32_t i = 0; i < w->count; i++)
        if (w->density[i >> DFCGS_BLOCK_LOG2]) w->rows[w->num_rows++] = i;
    DFCGS_GET(w->inputs, w->s->arena, uint8_t, (size_t)w->num_rows *DFCGS_NUM_COMMON);
    dfcgs_common_inputs(&known, w->rows, w->num_rows, w->inputs);
    return DFCGS_OK;
}

/* --- 12.4
 * ---------------------------------------------------------------------------------------------------------
 */

/* What all passes over flags share: `share` [N] is s of 12.4, `place` [N] of each Gaussian among the rows. */
typedef struct {
    walk *w;
    int32_t *share;
    uint32_t *place;
    const int32_t *prepared;
} flags;

static int has_flag(const walk *w, uint32_t row) {
    uint8_t density = w->density[row >> DFCGS_BLOCK_LOG2];
    return density > 0 && density < DFCGS_DENSE;
}

/* Flags of the rows first::stride; `mean` of each of them, NULL in the base. */
static dfcgs_status flag_pass(flags *f, uint32_t first, uint32_t stride, uint32_t rows, const int64_t *mean) {
    walk *w = f->w;
    dfcgs_arena *arena = w->s->arena;
    uint32_t *gaussians, *places, num = 0;
    int64_t *means;
    uint8_t *classes, *found;
    DFCGS_GET(gaussians, arena, uint32_t, rows);
    DFCGS_GET(places, arena, uint32_t, rows);
    DFCGS_GET(means, arena, int64_t, rows);
    for (uint32_t i = 0; i < rows; i++) {
        uint32_t row = first + i * stride;
        if (!has_flag(w, row)) continue;
        gaussians[num] = row;
        places[num] = f->place[row];
        if (mean) means[num] = mean[i];
        num++;
    }
    DFCGS_GET(classes, arena, uint8_t, num);
    DFCGS_GET(found, arena, uint8_t, num);
    dfcgs_flag_classes(&w->context->model->flags, f->prepared, places, num, mean ? means : NULL, classes);
    DFCGS_TRY(dfcgs_grouped(w->s, classes, num, w->context->model->flag_models, found));
    for (uint32_t j = 0; j < num; j++) f->share[gaussians[j]] = found[j] ? PRESENT_SHARE : 0;
    return DFCGS_OK;
}

static dfcgs_status flag_level(flags *f, int level) {
    dfcgs_arena *arena = f->w->s->arena;
    size_t mark = arena->used;
    const dfcgs_levels *levels = &f->w->context->levels;
    uint32_t rows = dfcgs_level_rows(levels->count, level), coarse = dfcgs_coarse_rows(levels->count, level);
    int32_t *window;
    int64_t *mean;
    DFCGS_GET(window, arena, int32_t, (size_t)coarse + DFCGS_NEIGHBOURS);
    DFCGS_GET(mean, arena, int64_t, rows);
    int narrow = dfcgs_window(f->share, levels->count, level, window);
    dfcgs_means(window, narrow, dfcgs_level_weights(levels, level), rows, mean);
    DFCGS_TRY(flag_pass(f, 1u << level, 2u << level, rows, mean));
    arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status read_flags(walk *w, int32_t *share) {
    dfcgs_arena *arena = w->s->arena;
    size_t mark = arena->used;
    const dfcgs_levels *levels = &w->context->levels;
    const dfcgs_network *network = &w->context->model->flags;
    int num_levels = levels->num_levels < DFCGS_PRIOR_LEVELS ? levels->num_levels : DFCGS_PRIOR_LEVELS;
    flags f = {.w = w, .share = share};
    int32_t *prepared;
    DFCGS_GET(f.place, arena, uint32_t, w->count);
    DFCGS_GET(prepared, arena, int32_t, (size_t)w->num_rows *(size_t)dfcgs_prepared_width(network));
    for (uint32_t j = 0; j < w->num_rows; j++) f.place[w->rows[j]] = j;
    dfcgs_prepare(network, w->inputs, w->num_rows, prepared);
    f.prepared = prepared;
    size_t passes = arena->used;
    DFCGS_TRY(flag_pass(&f, 0, 1u << num_levels, (w->count + (1u << num_levels) - 1) >> num_levels, NULL));
    arena->used = passes;
    for (int level = num_levels - 1; level >= 0; level--) DFCGS_TRY(flag_level(&f, level));
    arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status find_coded(walk *w, coded *c) {
    dfcgs_arena *arena = w->s->arena;
    int32_t *share;
    int any = 0;
    DFCGS_GET_ZEROS(share, arena, int32_t, w->count);
    DFCGS_GET(c->rows, arena, uint32_t, w->num_rows);
    DFCGS_GET(c->places, arena, uint32_t, w->num_rows);
    DFCGS_GET(c->flagged, arena, uint8_t, w->num_rows);
    for (uint32_t j = 0; j < w->num_rows; j++) {
        int flagged = has_flag(w, w->rows[j]);
        any |= flagged;
        if (!flagged) share[w->rows[j]] = PRESENT_SHARE;
    }
    if (any) DFCGS_TRY(read_flags(w, share));
    for (uint32_t j = 0; j < w->num_rows; j++) {
        if (!share[w->rows[j]]) continue;
        c->rows[c->count] = w->rows[j];
        c->places[c->count] = j;
        c->flagged[c->count++] = (uint8_t)has_flag(w, w->rows[j]);
    }
    return DFCGS_OK;
}

/* --- 12.5
 * ---------------------------------------------------------------------------------------------------------
 */

/* Columns of the coded rows: symbols before and in this frame [count][columns], memory likewise, residuals of
 * each column. */
typedef struct {
    walk *w;
    const coded *rows;
    dfcgs_levels levels;
    const int32_t *before;
    const int64_t *memory;
    int32_t *symbols, *prepared;
    int64_t *residuals[MAX_COLUMNS];
    uint8_t *others, *kinds;
} columns;

static dfcgs_status gather_before(columns *c) {
    const walk *w = c->w;
    size_t width = (size_t)w->columns, count = c->rows->count;
    int32_t *before;
    int64_t *memory;
    c->before = w->activity->symbols;
    c->memory = w->activity->memory;
    if (count == w->count) return DFCGS_OK;
    DFCGS_GET(before, w->s->arena, int32_t, count *width);
    DFCGS_GET(memory, w->s->arena, int64_t, count *width);
    for (size_t j = 0; j < count; j++) {
        size_t row = c->rows->rows[j];
        memcpy(before + j * width, w->activity->symbols + row * width, width * sizeof *before);
        memcpy(memory + j * width, w->activity->memory + row * width, width * sizeof *memory);
    }
    c->before = before;
    c->memory = memory;
    return DFCGS_OK;
}

/* What the network makes of the inputs of the coded rows. */
static dfcgs_status prepare_columns(columns *c) {
    const walk *w = c->w;
    const dfcgs_network *network = &w->context->model->columns.network;
    uint8_t *inputs = w->inputs;
    for (uint32_t j = 0; j < c->rows->count; j++) /* places rise, so rows move down only */
        if (c->rows->places[j] != j)
            memcpy(inputs + (size_t)j * DFCGS_NUM_COMMON,
                   inputs + (size_t)c->rows->places[j] * DFCGS_NUM_COMMON, DFCGS_NUM_COMMON);
    DFCGS_GET(c->prepared, w->s->arena, int32_t,
              (size_t)c->rows->count *(size_t)dfcgs_prepared_width(network));
    dfcgs_prepare(network, inputs, c->rows->count, c->prepared);
    return DFCGS_OK;
}

static dfcgs_status take_columns(columns *c) {
    dfcgs_arena *arena = c->w->s->arena;
    size_t count = c->rows->count, width = (size_t)c->w->columns;
    c->levels = count == c->w->count ? c->w->context->levels : dfcgs_order_levels((uint32_t)count);
    DFCGS_TRY(gather_before(c));
    DFCGS_TRY(prepare_columns(c));
    DFCGS_GET(c->symbols, arena, int32_t, count *width);
    DFCGS_GET(c->others, arena, uint8_t, count *DFCGS_NUM_OTHERS);
    DFCGS_GET(c->kinds, arena, uint8_t, count);
    for (size_t k = 0; k < width; k++) DFCGS_GET(c->residuals[k], arena, int64_t, count);
    return DFCGS_OK;
}

/* Kinds of column k: flagged rows that have had no symbol other than 0 so far. */
static void find_kinds(columns *c, int k) {
    int left = c->w->columns - k, kind = MAX_KINDS - (left < MAX_KINDS - 1 ? left : MAX_KINDS - 1);
    const int32_t *row = c->symbols;
    for (uint32_t j = 0; j < c->rows->count; j++, row += c->w->columns) {
        int32_t any = 0;
        for (int i = 0; i < k; i++) any |= row[i];
        c->kinds[j] = c->rows->flagged[j] && !any ? (uint8_t)kind : 0;
    }
}

static dfcgs_status read_column(columns *c, int k) {
    dfcgs_stream *s = c->w->s;
    size_t mark = s->arena->used;
    uint32_t count = c->rows->count, width = (uint32_t)c->w->columns;
    int64_t weights[3 + MAX_COLUMNS], *own;
    int left = c->w->columns - k;
    DFCGS_TRY(dfcgs_read_weights(s, 3 + (uint32_t)k, weights));
    DFCGS_GET_ZEROS(own, s->arena, int64_t, count);
    for (int j = 0; j < k; j++)
        dfcgs_add_wide_feature(c->residuals[j], count, 1, (int)weights[1 + j] * SYMBOL_WEIGHT, own);
    dfcgs_add_feature(c->before + k, count, width, (int)weights[1 + k] * SYMBOL_WEIGHT, own);
    dfcgs_add_wide_feature(c->memory + k, count, width, (int)weights[2 + k] * MEMORY_WEIGHT, own);
    dfcgs_other_inputs(c->before, c->symbols, count, c->w->columns, k,
                       SMALL * (left < MAX_KINDS ? left : MAX_KINDS), c->others);
    find_kinds(c, k);
    const dfcgs_symbol_part *part = &c->w->context->model->columns;
    dfcgs_component component = {&part->network, c->prepared, c->others, c->kinds, own, (int32_t)weights[0]};
    DFCGS_TRY(dfcgs_prior_column(s, &c->levels, &component, part->tables, c->w->columns, c->symbols + k,
                                 c->residuals[k]));
    s->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status read_columns(walk *w, const coded *rows) {
    size_t width = (size_t)w->columns;
    columns c = {.w = w, .rows = rows};
    if (rows->count) {
        DFCGS_TRY(take_columns(&c));
        for (int k = 0; k < w->columns; k++) DFCGS_TRY(read_column(&c, k));
    }
    memset(w->activity->symbols, 0, w->count * width * sizeof *w->activity->symbols);
    for (size_t j = 0; j < rows->count; j++)
        memcpy(w->activity->symbols + rows->rows[j] * width, c.symbols + j * width,
               width * sizeof *c.symbols);
    return DFCGS_OK;
}

/* ------------------------------------------------------------------------------------------------------------------
 */

dfcgs_status dfcgs_inter_attribute(dfcgs_stream *s, const dfcgs_inter_context *context,
                                   dfcgs_activity *activity) {
    dfcgs_arena *arena = s->arena;
    size_t mark = arena->used;
    uint32_t count = context->levels.count, num_blocks = dfcgs_num_blocks(count);
    walk w = {.s = s,
              .context = context,
              .activity = activity,
              .count = count,
              .num_blocks = num_blocks,
              .columns = context->known.columns};
    coded rows = {0};
    DFCGS_GET(w.density, arena, uint8_t, num_blocks);
    DFCGS_GET(w.magnitude, arena, uint8_t, num_blocks);
    DFCGS_TRY(read_densities(&w));
    DFCGS_TRY(read_magnitudes(&w));
    DFCGS_TRY(find_inputs(&w));
    DFCGS_TRY(find_coded(&w, &rows));
    DFCGS_TRY(read_columns(&w, &rows));
    memcpy(activity->density, w.density, num_blocks);
    memcpy(activity->magnitude, w.magnitude, num_blocks);
    dfcgs_remember(activity->symbols, count, w.columns, activity->running, activity->memory);
    arena->used = mark;
    return DFCGS_OK;
}
