/* 9.1 keys; 14.1 control points by farthest point sampling; 14.2 whom points gather from. All on cells:
   triples of integers within +-2**20. */
#ifndef DFCGS_NEARNESS_H
#define DFCGS_NEARNESS_H

#include "exact.h"

enum { DFCGS_CELL_LIMIT = 1 << 20 };
enum { DFCGS_NUM_GATHERED = 4, DFCGS_NUM_CANDIDATES = 5, DFCGS_BLEND = 0, DFCGS_MAX_CONTROL_POINTS = 16384 };

/* Of a Gaussian, or a control point beyond the first level: its control points with weights that sum to
   2**12, the efforts of its candidates, and which of them leads. */
typedef struct {
    uint16_t rank[DFCGS_NUM_GATHERED], weight[DFCGS_NUM_GATHERED];
    int16_t effort[DFCGS_NUM_CANDIDATES];
    uint16_t choice;
} dfcgs_binding;

/* The key of 9.1 with 21 bits of a `cell` of three coordinates from 0 to 2**21 - 1. */
uint64_t dfcgs_morton_key(const int32_t cell[3]);

/* Cells [count][3] of `positions` [count][3] about `center` (14.1). */
DFCGS_EXPORT void dfcgs_control_cells(const int32_t *positions, uint32_t count, const int32_t center[3],
                                      int shift, int32_t *cells);

/* Keys [count] of cells as births are sorted in by (15.3). */
DFCGS_EXPORT void dfcgs_cell_keys(const int32_t *cells, uint32_t count, uint64_t *keys);

/* A permutation `order` [count] with which cells that are near stand near each other: by key, equals as they
 * come. */
DFCGS_EXPORT dfcgs_status dfcgs_near_order(dfcgs_arena *arena, const int32_t *cells, uint32_t count,
                                           uint32_t *order);

/* 14.1: at most `wanted` indices `chosen`, `*found` of them; count >= 1. */
DFCGS_EXPORT dfcgs_status dfcgs_farthest_points(dfcgs_arena *arena, const int32_t *cells, uint32_t count,
                                                uint32_t wanted, uint32_t *chosen, uint32_t *found);

/* 14.2: bindings [count] of points with `cells` [count][3] to `control` [num_control][3], 1 <= num_control.
   Efforts and choice become 0. */
DFCGS_EXPORT dfcgs_status dfcgs_gather(dfcgs_arena *arena, const int32_t *cells, uint32_t count,
                                       const int32_t *control, uint32_t num_control, dfcgs_binding *bindings);

#endif
