/* 9.2 Levels of detail: which rows of a column predict which, and how much each neighbour weighs. */
#ifndef DFCGS_LOD_H
#define DFCGS_LOD_H

#include "exact.h"

enum { DFCGS_NEIGHBOURS = 8, DFCGS_MAX_LEVELS = 8, DFCGS_MIN_BASE = 32 };
/* coarse rows of a window lie between so many repetitions of the first and of the last one */
enum { DFCGS_MARGIN = DFCGS_NEIGHBOURS / 2 };
/* How large the values of a window are, in magnitude: those of a narrow one are below 2**21, so that sums of
   products stay below 2**31; those of a tiny one, which it holds as 16 bits each, below 2**14, so that
   differences are below 2**15. */
enum { DFCGS_WIDE, DFCGS_NARROW, DFCGS_TINY };

/* Levels of detail of `count` rows. `weights`: eight a row, NULL where all weigh the same. Rows lie level by
   level, coarse to fine: those of a level begin at row number dfcgs_coarse_rows(count, level), those before
   it are not used. */
typedef struct {
    uint32_t count;
    int num_levels;
    const int16_t *weights;
} dfcgs_levels;

/* L of `count` rows. */
int dfcgs_num_levels(uint32_t count);

/* G: the rows 0::2**(level + 1) of `count` rows, which predict those of `level`. */
DFCGS_INLINE uint32_t dfcgs_coarse_rows(uint32_t count, int level) {
    return (uint32_t)(((uint64_t)count + ((uint64_t)2 << level) - 1) >> (level + 1));
}

/* Rows 2**level::2**(level + 1) of `count` rows. */
DFCGS_INLINE uint32_t dfcgs_level_rows(uint32_t count, int level) {
    return (uint32_t)(((uint64_t)count + ((uint64_t)1 << level) - 1) >> (level + 1));
}

DFCGS_INLINE dfcgs_levels dfcgs_order_levels(uint32_t count) {
    dfcgs_levels levels = {count, dfcgs_num_levels(count), 0};
    return levels;
}

/* Distance weights [count][8] of rows at `positions` [count][3], the anchor positions. Takes scratch of 24
 * bytes a row. */
DFCGS_EXPORT dfcgs_status dfcgs_distance_weights(dfcgs_arena *arena, const int32_t *positions, uint32_t count,
                                                 int16_t *weights);

/* The values of the coarse rows of `level` in `column` [count], with their margins, in `window` [G + 8]; says
   how large they are. */
DFCGS_EXPORT int dfcgs_window(const int32_t *column, uint32_t count, int level, int32_t *window);

/* Mean and deviation, both times 256, of the `rows` rows of a level from its `window` and how large its
   values are, as dfcgs_window says. `weights`: those of the level's first row, NULL for equal ones. */
DFCGS_EXPORT void dfcgs_statistics(const int32_t *window, int size, const int16_t *weights, uint32_t rows,
                                   int64_t *mean, int64_t *deviation);

/* The mean alone. */
DFCGS_EXPORT void dfcgs_means(const int32_t *window, int size, const int16_t *weights, uint32_t rows,
                              int64_t *mean);

/* Weights of the first row of a level, as dfcgs_statistics takes them. */
DFCGS_INLINE const int16_t *dfcgs_level_weights(const dfcgs_levels *levels, int level) {
    return levels->weights
               ? levels->weights + (size_t)DFCGS_NEIGHBOURS * dfcgs_coarse_rows(levels->count, level)
               : 0;
}

#endif
