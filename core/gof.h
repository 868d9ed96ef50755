/* What is kept of a GoF from frame to frame: state, activity, motion (8, 12.1, 14, 15.2).

   All arrays lie in one block. Those of Gaussians have room for `capacity` rows, of which `count` are used;
   where more are born the block moves to the end of the arena, and back to its place when the frame is done.
 */
#ifndef DFCGS_GOF_H
#define DFCGS_GOF_H

#include "hash.h"
#include "headers.h"
#include "inter.h"
#include "motion.h"

/* Control points, and their Gaussians `chosen` in the I-frame; `order`: ranks by these. */
typedef struct {
    dfcgs_arena arena;
    int is_there, has_moved; /* has_moved: efforts and choices are known */
    dfcgs_field field;
    uint32_t *chosen, *order;
    int32_t *symbols; /* [n][6], those of the last MOTION chunk */
} dfcgs_points;

typedef struct {
    int is_there, num_attributes, has_order, has_weights, has_patterns;
    uint32_t count, capacity;
    int32_t anchor_step, center[3];
    dfcgs_control_header control;
    dfcgs_points points;
    int32_t *planes[DFCGS_MAX_ATTRIBUTES];
    uint32_t *patterns[DFCGS_MAX_ATTRIBUTES]; /* float32 values of a verbatim I-frame, where has_patterns */
    int32_t *order, *anchors, *cells;
    uint8_t *cover;
    int16_t *weights;         /* of levels of detail, where has_weights */
    int32_t *intra_positions; /* until control points are chosen */
    int history;              /* attributes whose activity is that of the frame before, as bits */
    dfcgs_activity activity[DFCGS_MAX_ATTRIBUTES];
    uint8_t *modes, *follows;
    dfcgs_binding *bindings;
    /* planes whose digests are not known, and those that this frame changed, as bits; bit 8: the order */
    int changed, touched;
    uint8_t digests[DFCGS_MAX_ATTRIBUTES + 1][DFCGS_HASH_BYTES];
    uint8_t *block, *home; /* `home`: where the block lies between frames */
    size_t size;
} dfcgs_gof;

enum { DFCGS_ORDER_BIT = 1 << DFCGS_MAX_ATTRIBUTES };

/* Takes the block of an I-frame's GoF; no array is filled but that nobody has followed and all cover is 0. */
dfcgs_status dfcgs_take_gof(dfcgs_arena *arena, int num_attributes, const dfcgs_intra_header *header,
                            dfcgs_gof *gof);

/* After the I-frame's planes are there: anchors and what control points will need. */
void dfcgs_begin_gof(dfcgs_gof *gof, int32_t anchor_step);

/* Levels of detail of all Gaussians, with distance weights. */
dfcgs_status dfcgs_gof_levels(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_levels *levels);

/* Chooses control points and binds the Gaussians, if that is not done yet. */
dfcgs_status dfcgs_need_points(dfcgs_arena *arena, dfcgs_gof *gof);

/* 15.2: keeps the Gaussians `kept` [count], which rise. */
dfcgs_status dfcgs_keep_survivors(dfcgs_arena *arena, dfcgs_gof *gof, const uint32_t *kept, uint32_t count);

/* Births: their state and cover, what they bring with them, and which row of survivors and births stands
   where: `source` [survivors + births], survivors first in the counting. */
typedef struct {
    dfcgs_state state;
    uint8_t *cover;
    int32_t *anchors, *cells, *order;
    uint32_t *source;
    dfcgs_binding *bindings;
} dfcgs_births;

/* 15.3, as soon as the births are decoded: all but their bindings. */
dfcgs_status dfcgs_place_births(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_births *births);
/* 15.4: puts them in. */
dfcgs_status dfcgs_insert_births(dfcgs_arena *arena, dfcgs_gof *gof, dfcgs_births *births);

/* Planes were changed, as bits. */
DFCGS_INLINE void dfcgs_touch(dfcgs_gof *gof, int planes) {
    gof->changed |= planes;
    gof->touched |= planes;
}

/* Zeros in the place of an activity that is not there. */
void dfcgs_clear_activity(dfcgs_gof *gof, int attribute);

/* At the end of a frame: the block comes home. What lies behind it in the arena is of no use any more. */
void dfcgs_settle_gof(dfcgs_gof *gof);

/* 8.5; `escapes`: payload of the frame's escapes, NULL for none. */
void dfcgs_frame_hash(dfcgs_gof *gof, const uint8_t *escapes, size_t num_bytes,
                      uint8_t hash[DFCGS_HASH_BYTES]);

#endif
