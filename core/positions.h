/* 11.1 The position tree. */
#ifndef DFCGS_POSITIONS_H
#define DFCGS_POSITIONS_H

#include "stream.h"

/* 9.1 */
typedef struct {
    int shift, bits, has_excess;
    int32_t origin[3];
} dfcgs_sort_grid;

/* `index` [count][3], the symbols of POSITION, count >= 1; refused where one's magnitude is above `limit`,
 * below 2**31. */
dfcgs_status dfcgs_position_tree(dfcgs_stream *s, const dfcgs_sort_grid *grid, uint32_t count, int64_t limit,
                                 int32_t *index);

#endif
