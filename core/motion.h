/* 14.3 to 14.6: motion of control points, Gaussians carried along, and what is learnt. */
#ifndef DFCGS_MOTION_H
#define DFCGS_MOTION_H

#include "nearness.h"
#include "rotation.h"

enum { DFCGS_MOTION_COLUMNS = 6, DFCGS_TABLE_COLUMNS = 12, DFCGS_NUM_CONTROL_INPUTS = 4 };

/* The n control points of a GoF, in the order in which they were chosen; arrays belong to the caller, all but
   `pivots` cleared at first. */
typedef struct {
    uint32_t count;
    int32_t *pivots, *translations, *vectors;  /* [n][3] */
    int64_t *translation_habits, *turn_habits; /* [n][3] */
    dfcgs_binding *bindings;                   /* [n], those of the first level are not used */
    int64_t *table; /* [n][12]: for each axis a row of the matrix, and what is added; 2**-20 */
} dfcgs_field;

/* Arrays of `count` control points, cleared. */
dfcgs_status dfcgs_take_field(dfcgs_arena *arena, uint32_t count, dfcgs_field *field);

/* 14.1: where the level that begins at `start` ends. */
DFCGS_INLINE uint32_t dfcgs_level_end(uint32_t start, uint32_t count) {
    uint32_t end = start == 0 ? 1 : 4 * start;
    return end < count ? end : count;
}

/* 14.2: binds control points with `cells` [n][3] to those of earlier levels. */
dfcgs_status dfcgs_bind_levels(dfcgs_arena *arena, const int32_t *cells, dfcgs_field *field);

/* 14.3: inputs x [n][4] of control points and expected changes [n][6]; `before` [n][6]: the last symbols. */
void dfcgs_control_inputs(const dfcgs_field *field, const int32_t *before, int translation_step,
                          int turn_step, uint8_t *inputs, int64_t *expected_changes);

/* 14.4: translations, turn vectors and table from `symbols` [n][6]. */
dfcgs_status dfcgs_move_field(dfcgs_field *field, const int32_t *symbols, int translation_step,
                              int turn_step);

/* 14.5: carries the Gaussians that follow; `positions` [count][3] and, where `turns`, `rotations` [count][4]
 * are changed. */
void dfcgs_carry(const dfcgs_field *field, const dfcgs_binding *bindings, const uint8_t *follows,
                 uint32_t count, int turns, int32_t *positions, int32_t *rotations);

/* What carries rotations [count][4], by turns `vectors` [count][3]; those of zero vectors stay as they are.
 */
DFCGS_EXPORT void dfcgs_turn_all(const int32_t *vectors, uint32_t count, int32_t *rotations);

/* 14.6: what Gaussians that followed learn, from their positions in the reference frame and those decoded. */
void dfcgs_learn(const dfcgs_field *field, dfcgs_binding *bindings, const uint8_t *follows, uint32_t count,
                 const int32_t *reference, const int32_t *decoded, int translation_step);

/* 14.6: what control points learn, after the Gaussians; pivots move. */
void dfcgs_learn_field(dfcgs_field *field, int translation_step);

#endif
