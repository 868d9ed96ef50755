#include "gof.h"

#include "reconstruct.h"

enum { POINT_BYTES = 240, POINTS_SLACK = 512, MAX_ROW_ARRAYS = 40 };

/* --- the block
 * ----------------------------------------------------------------------------------------------------- */

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

static dfcgs_status take_block(dfcgs_arena *arena, dfcgs_gof *g) {
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
    DFCGS_TRY(take_block(arena, gof));
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

/* --- control points
 * ------------------------------------------------------------------------------------------------ */

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

/* --- 15.2, 15.4: arrays of other Gaussians
 * -------------------------------------------------------------------------- */

/* Rows of an array, and those of births; NULL for zeros. */
typedef struct {
    uint8_t *rows;
    const uint8_t *births;
    size_t width;
} row_array;

typedef struct {
    int count;
    row_array arrays[MAX_ROW_ARRAYS];
} row_arrays;

static void add_rows(row_arrays *list, void *rows, const void *births, size_t width) {
    list->arrays[list->count++] = (row_array){rows, births, width};
}

/* All arrays that have a row for each Gaussian and are of use; `born` NULL where nobody is. */
static row_arrays all_rows(const dfcgs_gof *g, const dfcgs_births *born) {
    row_arrays list = {0};
    for (int a = 0; a < g->num_attributes; a++)
        add_rows(&list, g->planes[a], born ? born->state.planes[a] : NULL,
                 (size_t)dfcgs_columns(a) * sizeof(int32_t));
    if (g->has_order) add_rows(&list, g->order, born ? born->order : NULL, sizeof *g->order);
    add_rows(&list, g->anchors, born ? born->anchors : NULL, 3 * sizeof *g->anchors);
    add_rows(&list, g->cells, born ? born->cells : NULL, 3 * sizeof *g->cells);
    add_rows(&list, g->cover, born ? born->cover : NULL, 1);
    add_rows(&list, g->bindings, born ? born->bindings : NULL, sizeof *g->bindings);
    add_rows(&list, g->follows, NULL, 1);
    for (int a = 0; a < g->num_attributes; a++) {
        if (!(g->history >> a & 1)) continue;
        size_t columns = (size_t)dfcgs_inter_columns(a);
        add_rows(&list, g->activity[a].symbols, NULL, columns * sizeof(int32_t));
        add_rows(&list, g->activity[a].memory, NULL, columns * sizeof(int64_t));
        add_rows(&list, g->activity[a].running, NULL, sizeof(int32_t));
    }
    return list;
}

/* After Gaussians went or came: what is no longer true of blocks, planes and neighbours. */
static void forget_blocks(dfcgs_gof *g) {
    uint32_t blocks = dfcgs_num_blocks(g->count);
    memset(g->modes, 0, blocks);
    for (int a = 0; a < g->num_attributes; a++) {
        memset(g->activity[a].density, 0, blocks);
        memset(g->activity[a].magnitude, 0, blocks);
    }
    g->has_weights = 0;
    dfcgs_touch(g, ~0);
}

/* Places of the survivors become their ranks. */
static dfcgs_status rank_places(dfcgs_arena *arena, dfcgs_gof *g, const uint32_t *kept, uint32_t count) {
    size_t mark = arena->used;
    uint32_t *rank, next = 0;
    DFCGS_GET_ZEROS(rank, arena, uint32_t, g->count);
    for (uint32_t i = 0; i < count; i++) rank[g->order[kept[i]]] = 1;
    for (uint32_t p = 0; p < g->count; p++) {
        uint32_t is_kept = rank[p];
        rank[p] = next;
        next += is_kept;
    }
    for (uint32_t i = 0; i < count; i++) g->order[kept[i]] = (int32_t)rank[g->order[kept[i]]];
    arena->used = mark;
    return DFCGS_OK;
}

static void compact(const row_array *array, const uint32_t *kept, uint32_t count) {
    for (size_t i = 0; i < count; i++)
        if (kept[i] != i)
            memmove(array->rows + i * array->width, array->rows + kept[i] * array->width, array->width);
}

dfcgs_status dfcgs_keep_survivors(dfcgs_arena *arena, dfcgs_gof *gof, const uint32_t *kept, uint32_t count) {
    if (count == gof->count) return DFCGS_OK;
    DFCGS_TRY(dfcgs_need_points(arena, gof));
    if (gof->has_order) DFCGS_TRY(rank_places(arena, gof, kept, count));
    row_arrays list = all_rows(gof, NULL);
    for (int k = 0; k < list.count; k++) compact(&list.arrays[k], kept, count);
    gof->count = count;
    gof->points.has_moved = 1;
    forget_blocks(gof);
    return DFCGS_OK;
}

/* --- 15.3
 * ------------------------------------------------------------------------------------------------------------
 */

typedef struct {
    uint64_t key;
    uint32_t index;
} keyed;

/* Sorts by key, equals as they come; `room` [count]. */
static void sort_keyed(keyed *all, keyed *room, uint32_t count) {
    for (uint32_t width = 1; width < count; width *= 2) {
        for (uint32_t start = 0; start < count; start += 2 * width) {
            uint32_t middle = count - start < width ? count : start + width;
            uint32_t end = count - start < 2 * width ? count : start + 2 * width, a = start, b = middle;
            for (uint32_t i = start; i < end; i++)
                room[i] = b == end || (a < middle && all[a].key <= all[b].key) ? all[a++] : all[b++];
        }
        memcpy(all, room, count * sizeof *all);
    }
}

static dfcgs_status find_source(dfcgs_arena *arena, const dfcgs_gof *g, const dfcgs_births *births) {
    size_t mark = arena->used;
    uint32_t count = births->state.count, *source = births->source;
    uint64_t *keys, *birth_keys, rising = 0;
    keyed *sorted, *room;
    DFCGS_GET(keys, arena, uint64_t, g->count);
    DFCGS_GET(birth_keys, arena, uint64_t, count);
    DFCGS_GET(sorted, arena, keyed, count);
    DFCGS_GET(room, arena, keyed, count);
    dfcgs_cell_keys(g->cells, g->count, keys);
    dfcgs_cell_keys(births->cells, count, birth_keys);
    for (uint32_t j = 0; j < count; j++) sorted[j] = (keyed){birth_keys[j], j};
    sort_keyed(sorted, room, count);
    uint32_t next = 0, at = 0;
    for (uint32_t i = 0; i < g->count; i++) {
        rising = keys[i] > rising ? keys[i] : rising;
        while (next < count && sorted[next].key < rising) source[at++] = g->count + sorted[next++].index;
        source[at++] = i;
    }
    while (next < count) source[at++] = g->count + sorted[next++].index;
    arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_place_births(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_births *births) {
    const int32_t *positions = births->state.planes[DFCGS_POSITION];
    uint32_t count = births->state.count;
    DFCGS_TRY(dfcgs_need_points(arena, gof));
    DFCGS_GET(births->anchors, arena, int32_t, 3 * (size_t)count);
    DFCGS_GET(births->cells, arena, int32_t, 3 * (size_t)count);
    DFCGS_GET(births->order, arena, int32_t, count);
    DFCGS_GET(births->source, arena, uint32_t, (size_t)gof->count + count);
    dfcgs_anchors(positions, count, gof->anchor_step, births->anchors);
    dfcgs_control_cells(positions, count, gof->center, gof->control.shift, births->cells);
    for (uint32_t j = 0; j < count; j++) births->order[j] = (int32_t)(gof->count + j);
    return find_source(arena, gof, births);
}

/* From the last row on: a survivor never moves down. */
static void spread(const row_array *array, const uint32_t *source, uint32_t survivors, uint32_t count) {
    size_t width = array->width;
    for (size_t i = count; i-- > 0;) {
        uint8_t *to = array->rows + i * width;
        if (source[i] < survivors) memmove(to, array->rows + source[i] * width, width);
        else if (array->births) memcpy(to, array->births + (source[i] - survivors) * width, width);
        else memset(to, 0, width);
    }
}

/* A block with room for more. */
static dfcgs_status grow(dfcgs_arena *arena, dfcgs_gof *g, uint32_t count) {
    if (count <= g->capacity) return DFCGS_OK;
    row_arrays old = all_rows(g, NULL);
    g->capacity = count + count / 8;
    g->has_patterns = 0;
    DFCGS_TRY(take_block(arena, g));
    row_arrays new = all_rows(g, NULL);
    for (int k = 0; k < new.count; k++)
        memcpy(new.arrays[k].rows, old.arrays[k].rows, (size_t)g->count * new.arrays[k].width);
    return DFCGS_OK;
}

/* Binds births to where control points are now. */
static dfcgs_status bind_births(dfcgs_arena *arena, const dfcgs_gof *g, dfcgs_births *births) {
    const dfcgs_field *field = &g->points.field;
    int32_t *control;
    DFCGS_GET(births->bindings, arena, dfcgs_binding, births->state.count);
    DFCGS_GET(control, arena, int32_t, 3 * (size_t)field->count);
    dfcgs_control_cells(field->pivots, field->count, g->center, g->control.shift, control);
    return dfcgs_gather(arena, births->cells, births->state.count, control, field->count, births->bindings);
}

dfcgs_status dfcgs_insert_births(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_births *births) {
    uint32_t survivors = gof->count, count = survivors + births->state.count;
    DFCGS_TRY(bind_births(arena, gof, births));
    DFCGS_TRY(grow(arena, gof, count));
    row_arrays list = all_rows(gof, births);
    for (int k = 0; k < list.count; k++) spread(&list.arrays[k], births->source, survivors, count);
    gof->count = count;
    gof->points.has_moved = 1;
    forget_blocks(gof);
    return DFCGS_OK;
}

/* --- 8.5
 * ---------------------------------------------------------------------------------------------------------------
 */

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
