/* 15.2 to 15.4: Gaussians that go and come, in all that is kept for each of them. */
#include "gof.h"
#include "reconstruct.h"

enum { MAX_ROW_ARRAYS = 40 };

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

/* --- 15.3 -------------------------------------------------------------------------------------------- */

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
    DFCGS_TRY(dfcgs_take_block(arena, g));
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
