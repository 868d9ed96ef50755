#include "nearness.h"

enum { DIGIT_BITS = 11, NUM_DIGITS = 6, RADIX = 1 << DIGIT_BITS };

static uint64_t spread(uint64_t bits) {
    bits = (bits | bits << 32) & 0x001F00000000FFFF;
    bits = (bits | bits << 16) & 0x001F0000FF0000FF;
    bits = (bits | bits << 8) & 0x100F00F00F00F00F;
    bits = (bits | bits << 4) & 0x10C30C30C30C30C3;
    return (bits | bits << 2) & 0x1249249249249249;
}

uint64_t dfcgs_morton_key(const int32_t cell[3]) {
    return spread((uint64_t)cell[0]) << 2 | spread((uint64_t)cell[1]) << 1 | spread((uint64_t)cell[2]);
}

void dfcgs_control_cells(const int32_t *positions, uint32_t count, const int32_t center[3], int shift,
                         int32_t *cells) {
    for (uint32_t i = 0; i < count; i++, positions += 3, cells += 3)
        for (int a = 0; a < 3; a++)
            cells[a] = (int32_t)dfcgs_clip(((int64_t)positions[a] - center[a]) >> shift, -DFCGS_CELL_LIMIT,
                                           DFCGS_CELL_LIMIT);
}

void dfcgs_cell_keys(const int32_t *cells, uint32_t count, uint64_t *keys) {
    for (uint32_t i = 0; i < count; i++, cells += 3) {
        int32_t raised[3];
        for (int a = 0; a < 3; a++)
            raised[a] = (int32_t)dfcgs_min(cells[a] + DFCGS_CELL_LIMIT, 2 * DFCGS_CELL_LIMIT - 1);
        keys[i] = dfcgs_morton_key(raised);
    }
}

static int rising(const uint64_t *keys, uint32_t count) {
    for (uint32_t i = 1; i < count; i++)
        if (keys[i] < keys[i - 1]) return 0;
    return 1;
}

/* One pass of a radix sort, which keeps the order of equals. */
static void sort_by_digit(const uint64_t *keys, const uint32_t *from, uint32_t count, int shift,
                          uint32_t *places, uint32_t *to) {
    memset(places, 0, RADIX * sizeof *places);
    for (uint32_t i = 0; i < count; i++) places[keys[i] >> shift & (RADIX - 1)]++;
    uint32_t total = 0;
    for (int d = 0; d < RADIX; d++) {
        uint32_t here = places[d];
        places[d] = total;
        total += here;
    }
    for (uint32_t i = 0; i < count; i++) to[places[keys[from[i]] >> shift & (RADIX - 1)]++] = from[i];
}

dfcgs_status dfcgs_near_order(dfcgs_arena *arena, const int32_t *cells, uint32_t count, uint32_t *order) {
    size_t mark = arena->used;
    uint64_t *keys = DFCGS_TAKE(arena, uint64_t, count);
    uint32_t *other = DFCGS_TAKE(arena, uint32_t, count), *places = DFCGS_TAKE(arena, uint32_t, RADIX);
    if (!keys || !other || !places) return DFCGS_MEMORY;
    dfcgs_cell_keys(cells, count, keys);
    for (uint32_t i = 0; i < count; i++) order[i] = i;
    /* an even number of passes, so that the last one ends in `order` */
    if (!rising(keys, count))
        for (int d = 0; d < NUM_DIGITS; d += 2) {
            sort_by_digit(keys, order, count, d * DIGIT_BITS, places, other);
            sort_by_digit(keys, other, count, (d + 1) * DIGIT_BITS, places, order);
        }
    arena->used = mark;
    return DFCGS_OK;
}
