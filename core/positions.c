#include "positions.h"

enum { MAX_DEPTH = 63, NUM_CLASSES = 3, NUM_LENGTHS = 33, BIAS_BITS = 4 };

/* A cell with two Gaussians or more. */
typedef struct {
    uint64_t key;
    uint32_t first, count;
} cell;

/* The tree under way: `cells`, and room for their halves. Keys rise with the rows. */
typedef struct {
    dfcgs_stream *s;
    cell *cells, *halves;
    uint32_t num_cells;
    uint64_t *keys;
    uint8_t *remaining;
} tree;

/* --- how many lie in the lower half
 * ------------------------------------------------------------------------------ */

static int class_of(uint32_t count) { return count == 2 ? 0 : count <= 4 ? 1 : 2; }

/* Models of the counts that occur, from a bias for each class of them. */
static dfcgs_status split_models(dfcgs_stream *s, const uint8_t *counts, uint32_t num, dfcgs_model *models) {
    uint8_t occurs[DFCGS_MAX_SPLIT_COUNT + 1] = {0}, has_class[NUM_CLASSES] = {0};
    uint32_t bias[NUM_CLASSES];
    for (uint32_t i = 0; i < num; i++) occurs[counts[i]] = 1;
    for (uint32_t c = 2; c <= DFCGS_MAX_SPLIT_COUNT; c++) has_class[class_of(c)] |= occurs[c];
    for (int k = 0; k < NUM_CLASSES; k++)
        if (has_class[k]) DFCGS_TRY(dfcgs_choice(s, BIAS_BITS, &bias[k]));
    for (uint32_t c = 2; c <= DFCGS_MAX_SPLIT_COUNT; c++)
        if (occurs[c]) models[c] = *dfcgs_split_model(s->models, (int)bias[class_of(c)], (int)c);
    return DFCGS_OK;
}

static dfcgs_status split_small(dfcgs_stream *s, const uint8_t *counts, uint32_t num, uint8_t *lower) {
    dfcgs_model models[DFCGS_MAX_SPLIT_COUNT + 1];
    if (num == 0) return DFCGS_OK;
    DFCGS_TRY(split_models(s, counts, num, models));
    return dfcgs_grouped(s, counts, num, models, lower);
}

/* Residuals from the halves, by the bit length of the count. */
static dfcgs_status split_large(dfcgs_stream *s, const uint8_t *lengths, uint32_t num, int64_t *residuals) {
    dfcgs_table tables[NUM_LENGTHS];
    for (int b = 0; b < NUM_LENGTHS; b++)
        tables[b] = dfcgs_table_of(s->models, (int)dfcgs_min(6 * b + 11, DFCGS_NUM_SCALES - 1));
    return dfcgs_residuals(s, lengths, num, tables, residuals);
}

/* Lower counts of small cells come in their order from `small`, those of large ones from `large`. */
static dfcgs_status join_splits(tree *t, const uint8_t *small, const int64_t *large, uint32_t *lower) {
    for (uint32_t i = 0; i < t->num_cells; i++) {
        uint32_t count = t->cells[i].count;
        int64_t value = count <= DFCGS_MAX_SPLIT_COUNT ? *small++ : *large++ + (count >> 1);
        if (value < 0 || value > count)
            return dfcgs_corrupt(t->s->error, DFCGS_NO_OFFSET, "a cell's halves do not add up");
        lower[i] = (uint32_t)value;
    }
    return DFCGS_OK;
}

static dfcgs_status split(tree *t, uint32_t *lower) {
    dfcgs_arena *arena = t->s->arena;
    size_t mark = arena->used;
    uint8_t *counts, *lengths, *small;
    int64_t *large;
    uint32_t num_small = 0, num_large = 0;
    DFCGS_GET(counts, arena, uint8_t, t->num_cells);
    DFCGS_GET(lengths, arena, uint8_t, t->num_cells);
    DFCGS_GET(small, arena, uint8_t, t->num_cells);
    for (uint32_t i = 0; i < t->num_cells; i++) {
        uint32_t count = t->cells[i].count;
        if (count <= DFCGS_MAX_SPLIT_COUNT) counts[num_small++] = (uint8_t)count;
        else lengths[num_large++] = (uint8_t)dfcgs_bit_length(count);
    }
    DFCGS_GET(large, arena, int64_t, num_large);
    DFCGS_TRY(split_small(t->s, counts, num_small, small));
    DFCGS_TRY(split_large(t->s, lengths, num_large, large));
    DFCGS_TRY(join_splits(t, small, large, lower));
    arena->used = mark;
    return DFCGS_OK;
}

/* --- keys
 * ------------------------------------------------------------------------------------------------------- */

/* Adds a cell at `depth`: one with a single Gaussian goes no further. */
static void add_cell(tree *t, cell *to, uint32_t *num, cell added, int depth) {
    if (added.count == 1) {
        t->keys[added.first] = added.key << depth;
        t->remaining[added.first] = (uint8_t)depth;
    } else if (added.count > 1) to[(*num)++] = added;
}

/* Replaces all cells by their halves, which are at `depth`. */
static void halve(tree *t, const uint32_t *lower, int depth) {
    uint32_t num = 0;
    for (uint32_t i = 0; i < t->num_cells; i++) {
        cell whole = t->cells[i], low = {whole.key << 1, whole.first, lower[i]};
        cell high = {whole.key << 1 | 1, whole.first + lower[i], whole.count - lower[i]};
        add_cell(t, t->halves, &num, low, depth);
        add_cell(t, t->halves, &num, high, depth);
    }
    cell *cells = t->cells;
    t->cells = t->halves;
    t->halves = cells;
    t->num_cells = num;
}

/* The raw bits of keys that a single Gaussian's cell leaves open. */
static dfcgs_status remaining_bits(tree *t, uint32_t count) {
    dfcgs_arena *arena = t->s->arena;
    uint32_t *order, first[257];
    uint64_t *low;
    DFCGS_GET(order, arena, uint32_t, count);
    DFCGS_GET(low, arena, uint64_t, count);
    dfcgs_group(t->remaining, count, order, first);
    for (int d = 0; d <= MAX_DEPTH; d++) {
        uint32_t rows = first[d + 1] - first[d];
        DFCGS_TRY(dfcgs_bits(t->s, d, rows, low));
        for (uint32_t j = 0; j < rows; j++) t->keys[order[first[d] + j]] |= low[j];
    }
    return DFCGS_OK;
}

/* Rising keys [count] of `key_bits` bits. */
static dfcgs_status sorted_keys(dfcgs_stream *s, uint32_t count, int key_bits, uint64_t *keys) {
    dfcgs_arena *arena = s->arena;
    size_t mark = arena->used;
    tree t = {.s = s, .keys = keys};
    uint32_t *lower;
    DFCGS_GET_ZEROS(t.remaining, arena, uint8_t, count);
    DFCGS_GET(t.cells, arena, cell, (size_t)count / 2 + 1);
    DFCGS_GET(t.halves, arena, cell, (size_t)count / 2 + 1);
    DFCGS_GET(lower, arena, uint32_t, (size_t)count / 2 + 1);
    add_cell(&t, t.cells, &t.num_cells, (cell){0, 0, count}, key_bits);
    for (int depth = key_bits; depth > 0 && t.num_cells; depth--) {
        DFCGS_TRY(split(&t, lower));
        halve(&t, lower, depth - 1);
    }
    for (uint32_t i = 0; i < t.num_cells; i++)
        for (uint32_t j = 0; j < t.cells[i].count; j++) keys[t.cells[i].first + j] = t.cells[i].key;
    DFCGS_TRY(remaining_bits(&t, count));
    arena->used = mark;
    return DFCGS_OK;
}

/* --- cells and indices
 * ------------------------------------------------------------------------------------------ */

/* Every third bit of a key, from the lowest one. */
static int64_t third_bits(uint64_t key) {
    key &= 0x1249249249249249u;
    key = (key | key >> 2) & 0x10C30C30C30C30C3u;
    key = (key | key >> 4) & 0x100F00F00F00F00Fu;
    key = (key | key >> 8) & 0x001F0000FF0000FFu;
    key = (key | key >> 16) & 0x001F00000000FFFFu;
    return (int64_t)((key | key >> 32) & 0x1FFFFFu);
}

/* Moves the cells of one axis [count][3] that are at `end` out by what is decoded. */
static dfcgs_status excess_at(dfcgs_stream *s, const uint32_t *rows, uint32_t num, int sign, int64_t *cells) {
    size_t mark = s->arena->used;
    uint64_t *excess;
    DFCGS_GET(excess, s->arena, uint64_t, num);
    DFCGS_TRY(dfcgs_escapes(s, num, excess));
    for (uint32_t j = 0; j < num; j++) cells[3 * (size_t)rows[j]] += sign * (int64_t)excess[j];
    s->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status add_excess(dfcgs_stream *s, int64_t *cells, uint32_t count, int64_t top) {
    size_t mark = s->arena->used;
    uint32_t *low, *high;
    DFCGS_GET(low, s->arena, uint32_t, count);
    DFCGS_GET(high, s->arena, uint32_t, count);
    for (int axis = 0; axis < 3; axis++) {
        uint32_t num_low = 0, num_high = 0;
        for (uint32_t i = 0; i < count; i++) {
            int64_t c = cells[3 * (size_t)i + axis];
            if (c == 0) low[num_low++] = i;
            if (c == top) high[num_high++] = i;
        }
        DFCGS_TRY(excess_at(s, low, num_low, -1, cells + axis));
        DFCGS_TRY(excess_at(s, high, num_high, 1, cells + axis));
    }
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_position_tree(dfcgs_stream *s, const dfcgs_sort_grid *grid, uint32_t count, int64_t limit,
                                 int32_t *index) {
    dfcgs_arena *arena = s->arena;
    size_t mark = arena->used;
    uint64_t *keys, *low;
    int64_t *cells;
    DFCGS_GET(keys, arena, uint64_t, count);
    DFCGS_GET(cells, arena, int64_t, 3 * (size_t)count);
    DFCGS_GET(low, arena, uint64_t, 3 * (size_t)count);
    DFCGS_TRY(sorted_keys(s, count, 3 * grid->bits, keys));
    for (uint32_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++) cells[3 * (size_t)i + axis] = third_bits(keys[i] >> (2 - axis));
    if (grid->has_excess) DFCGS_TRY(add_excess(s, cells, count, ((int64_t)1 << grid->bits) - 1));
    DFCGS_TRY(dfcgs_bits(s, grid->shift, 3 * count, low));
    for (size_t i = 0; i < 3 * (size_t)count; i++) {
        int64_t value = dfcgs_shift(cells[i] + grid->origin[i % 3], grid->shift) | (int64_t)low[i];
        if (value < -limit || value > limit)
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a symbol is too large for its step");
        index[i] = (int32_t)value;
    }
    arena->used = mark;
    return DFCGS_OK;
}
