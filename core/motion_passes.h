/* 14.3 Passes of a MOTION chunk. */
#ifndef DFCGS_MOTION_PASSES_H
#define DFCGS_MOTION_PASSES_H

#include "context_model.h"
#include "inter.h"
#include "motion.h"
#include "streams.h"

/* Who follows: `modes` [blocks] and `follows` [count] come as those of the last MOTION chunk and leave as
 * those of this one. */
dfcgs_status dfcgs_read_followers(dfcgs_stream *s, uint32_t count, uint8_t *modes, uint8_t *follows);

/* How control points move: `symbols` [n][6] likewise. `order` [n]: control points by their Gaussians'
 * indices. */
dfcgs_status dfcgs_read_control(dfcgs_stream *s, const dfcgs_symbol_part *part,
                                int32_t (*weights)[DFCGS_CONTROL_WEIGHTS], const dfcgs_field *field,
                                const uint32_t *order, const dfcgs_motion_header *header, int32_t *symbols);

#endif
