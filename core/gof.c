#include "gof.h"

#include "reconstruct.h"

enum { POINT_BYTES = 240, POINTS_SLACK = 512 };

/* --- the block --------------------------------------------------------------------------------------- */

static void *place(uint8_t *base, size_t *at, size_t bytes) {
    uint8_t *found = base ? base + *at : NULL;
    *at += (bytes + 15) & ~(size_t)15;
    return found;
}

static void lay_activity(dfcgs_gof *g, uint8_t *base, size_t *at, int attribute) {
    size_t rows = g->capacity, blocks = dfcgs_num_blocks(g->capacity),
           columns = (size_t)dfcgs_inter_columns(attribute);
    dfcgs_activity *activity = &g->activity[attribute];
    activity->symbols = place(base, at, rows * columns * sizeof *activity->symbols);
    activity->memory = place(base, at, rows * columns * sizeof *activity->memory);
    activity->running = place(base, at, rows * sizeof *activity->running);
    activity->density = place(base, at, blocks);
    activity->magnitude = place(base, at, blocks);
}

/* Points all arrays into a block at `base`, NULL to know its size, which is returned. */
static size_t lay(dfcgs_gof *g, uint8_t *base) {
    size_t at = 0, rows = g->capacity;
    for (int a = 0; a < g->num_attributes; a++) {
        g->planes[a] = place(base, &at, rows * (size_t)dfcgs_columns(a) * sizeof(int32_t));
        if (g->has_patterns)
            g->patterns[a] = place(base, &at, rows * (size_t)dfcgs_columns(a) * sizeof(uint32_t));
    }
    g->order = place(base, &at, rows * sizeof *g->order);
    g->anchors = place(base, &at, 3 * rows * sizeof *g->anchors);
    g->cells = place(base, &at, 3 * rows * sizeof *g->cells);
    g->intra_positions = place(base, &at, 3 * rows * sizeof *g->intra_positions);
    g->cover = place(base, &at, rows);
    g->follows = place(base, &at, rows);
    g->modes = place(base, &at, dfcgs_num_blocks(g->capacity));
    g->bindings = place(base, &at, rows * sizeof *g->bindings);
    g->weights = place(base, &at, rows * DFCGS_NEIGHBOURS * sizeof *g->weights);
    for (int a = 0; a < g->num_attributes; a++) lay_activity(g, base, &at, a);
    return at;
}

dfcgs_status dfcgs_take_block(dfcgs_arena *arena, dfcgs_gof *g) {
    g->size = lay(g, NULL);
    DFCGS_GET(g->block, arena, uint8_t, g->size);
    lay(g, g->block);
    return DFCGS_OK;
}

dfcgs_status dfcgs_take_gof(dfcgs_arena *arena, int num_attributes, const dfcgs_intra_header *header,
                            dfcgs_gof *gof) {
    size_t points =
        (size_t)dfcgs_wanted_points(header->num_gaussians, &header->control) * POINT_BYTES + POINTS_SLACK;
    *gof = (dfcgs_gof){.num_attributes = num_attributes,
                       .count = header->num_gaussians,
                       .capacity = header->num_gaussians,
                       .control = header->control,
                       .has_patterns = header->kind == DFCGS_PLY,
                       .has_order = header->has_permutation,
                       .changed = ~0,
                       .touched = ~0};
    DFCGS_GET(gof->points.arena.base, arena, uint8_t, points);
    gof->points.arena.size = points;
    DFCGS_TRY(dfcgs_take_block(arena, gof));
    gof->home = gof->block;
    memset(gof->cover, 0, gof->count);
    memset(gof->follows, 0, gof->count);
    memset(gof->modes, 0, dfcgs_num_blocks(gof->count));
    return DFCGS_OK;
}

void dfcgs_begin_gof(dfcgs_gof *gof, int32_t anchor_step) {
    const int32_t *positions = gof->planes[DFCGS_POSITION];
    gof->anchor_step = anchor_step;
    memcpy(gof->center, positions + 3 * (size_t)(gof->count / 2), sizeof gof->center);
    memcpy(gof->intra_positions, positions, 3 * (size_t)gof->count * sizeof *positions);
    dfcgs_anchors(positions, gof->count, anchor_step, gof->anchors);
    gof->is_there = 1;
}

void dfcgs_settle_gof(dfcgs_gof *gof) {
    if (gof->block == gof->home) return;
    memmove(gof->home, gof->block, gof->size);
    gof->block = gof->home;
    lay(gof, gof->block);
}

dfcgs_status dfcgs_gof_levels(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_levels *levels) {
    if (!gof->has_weights) DFCGS_TRY(dfcgs_distance_weights(arena, gof->anchors, gof->count, gof->weights));
    gof->has_weights = 1;
    *levels = (dfcgs_levels){gof->count, dfcgs_num_levels(gof->count), gof->weights};
    return DFCGS_OK;
}

void dfcgs_clear_activity(dfcgs_gof *gof, int attribute) {
    dfcgs_activity *activity = &gof->activity[attribute];
    size_t values = (size_t)gof->count * (size_t)dfcgs_inter_columns(attribute);
    memset(activity->symbols, 0, values * sizeof *activity->symbols);
    memset(activity->memory, 0, values * sizeof *activity->memory);
    memset(activity->running, 0, gof->count * sizeof *activity->running);
    memset(activity->density, 0, dfcgs_num_blocks(gof->count));
    memset(activity->magnitude, 0, dfcgs_num_blocks(gof->count));
}

/* --- control points ---------------------------------------------------------------------------------- */

/* Ranks by the Gaussians' indices in the I-frame, of which `count` there are. */
static dfcgs_status order_points(dfcgs_arena *arena, dfcgs_points *points, uint32_t count) {
    size_t mark = arena->used;
    uint32_t *rank, at = 0;
    DFCGS_GET(rank, arena, uint32_t, count);
    memset(rank, 0xFF, count * sizeof *rank);
    for (uint32_t k = 0; k < points->field.count; k++) rank[points->chosen[k]] = k;
    for (uint32_t i = 0; i < count; i++)
        if (rank[i] != UINT32_MAX) points->order[at++] = rank[i];
    arena->used = mark;
    return DFCGS_OK;
}

/* The field of the points chosen, with `cells` of all Gaussians. */
static dfcgs_status bind_points(dfcgs_arena *arena, dfcgs_gof *gof, const int32_t *cells) {
    dfcgs_points *points = &gof->points;
    uint32_t count = points->field.count;
    size_t mark = arena->used;
    int32_t *chosen_cells;
    DFCGS_GET(chosen_cells, arena, int32_t, 3 * (size_t)count);
    DFCGS_TRY(dfcgs_take_field(&points->arena, count, &points->field));
    DFCGS_GET(points->order, &points->arena, uint32_t, count);
    DFCGS_GET_ZEROS(points->symbols, &points->arena, int32_t, (size_t)count *DFCGS_MOTION_COLUMNS);
    for (size_t k = 0; k < count; k++) {
        size_t row = points->chosen[k];
        memcpy(chosen_cells + 3 * k, cells + 3 * row, 3 * sizeof *cells);
        memcpy(points->field.pivots + 3 * k, gof->intra_positions + 3 * row, 3 * sizeof *cells);
    }
    DFCGS_TRY(order_points(arena, points, gof->count));
    DFCGS_TRY(dfcgs_bind_levels(arena, chosen_cells, &points->field));
    DFCGS_TRY(dfcgs_gather(arena, cells, gof->count, chosen_cells, count, gof->bindings));
    arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_need_points(dfcgs_arena *arena, dfcgs_gof *gof) {
    dfcgs_points *points = &gof->points;
    uint32_t wanted = dfcgs_wanted_points(gof->count, &gof->control);
    if (points->is_there) return DFCGS_OK;
    DFCGS_GET(points->chosen, &points->arena, uint32_t, wanted);
    dfcgs_control_cells(gof->intra_positions, gof->count, gof->center, gof->control.shift, gof->cells);
    DFCGS_TRY(
        dfcgs_farthest_points(arena, gof->cells, gof->count, wanted, points->chosen, &points->field.count));
    DFCGS_TRY(bind_points(arena, gof, gof->cells));
    points->is_there = 1;
    return DFCGS_OK;
}

/* --- 8.5 --------------------------------------------------------------------------------------------- */

static void refresh_digests(dfcgs_gof *gof) {
    for (int a = 0; a < gof->num_attributes; a++)
        if (gof->changed >> a & 1)
            dfcgs_digest(gof->planes[a], gof->count * (uint32_t)dfcgs_columns(a) * 4, gof->digests[a]);
    if (gof->has_order && gof->changed & DFCGS_ORDER_BIT)
        dfcgs_digest(gof->order, gof->count * 4, gof->digests[DFCGS_MAX_ATTRIBUTES]);
    gof->changed = 0;
}

void dfcgs_frame_hash(dfcgs_gof *gof, const uint8_t *escapes, size_t num_bytes,
                      uint8_t hash[DFCGS_HASH_BYTES]) {
    dfcgs_hash whole;
    refresh_digests(gof);
    dfcgs_hash_start(&whole);
    dfcgs_hash_add(&whole, gof->digests, (size_t)gof->num_attributes * DFCGS_HASH_BYTES);
    if (gof->has_order) dfcgs_hash_add(&whole, gof->digests[DFCGS_MAX_ATTRIBUTES], DFCGS_HASH_BYTES);
    if (gof->has_patterns)
        for (int a = 0; a < gof->num_attributes; a++)
            dfcgs_hash_add(&whole, gof->patterns[a], (size_t)gof->count * (size_t)dfcgs_columns(a) * 4);
    if (escapes) dfcgs_hash_add(&whole, escapes, num_bytes);
    dfcgs_hash_end(&whole, hash);
}
