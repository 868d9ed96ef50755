#include "motion_passes.h"
#include "parts.h"

enum { NUM_MOTION_STREAMS = 2 };

static dfcgs_status read_motion_streams(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_gof *gof = &d->gof;
    dfcgs_streams streams;
    dfcgs_stream *s;
    uint64_t lengths[NUM_MOTION_STREAMS];
    DFCGS_TRY(dfcgs_open_charged(d, r, NUM_MOTION_STREAMS, lengths, &streams));
    DFCGS_TRY(dfcgs_next_stream(&streams, &s));
    DFCGS_TRY(dfcgs_read_followers(s, gof->count, gof->modes, gof->follows));
    DFCGS_TRY(dfcgs_next_stream(&streams, &s));
    DFCGS_TRY(dfcgs_read_control(s, &d->model.control, d->model.control_weights, &gof->points.field,
                                 gof->points.order, &d->frame.motion, gof->points.symbols));
    return dfcgs_close_streams(&streams);
}

dfcgs_status dfcgs_put_motion(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_gof *gof = &d->gof;
    dfcgs_frame *f = &d->frame;
    size_t values = 3 * (size_t)gof->count;
    DFCGS_TRY(dfcgs_need_points(&d->arena, gof));
    DFCGS_TRY(dfcgs_read_motion(r, &f->motion));
    DFCGS_TRY(read_motion_streams(d, r));
    DFCGS_TRY(dfcgs_move_field(&gof->points.field, gof->points.symbols, f->motion.translation_step,
                               f->motion.turn_step));
    DFCGS_GET(f->reference, &d->arena, int32_t, values);
    memcpy(f->reference, gof->planes[DFCGS_POSITION], values * sizeof *f->reference);
    dfcgs_carry(&gof->points.field, gof->bindings, gof->follows, gof->count, f->motion.turn_step > 0,
                gof->planes[DFCGS_POSITION], gof->planes[DFCGS_ROTATION]);
    dfcgs_touch(gof, 1 << DFCGS_POSITION | (f->motion.turn_step > 0) << DFCGS_ROTATION);
    f->has_motion = 1;
    return DFCGS_OK;
}

void dfcgs_learn_motion(dfcgs_decoder *d) {
    dfcgs_gof *gof = &d->gof;
    int step = d->frame.motion.translation_step;
    dfcgs_learn(&gof->points.field, gof->bindings, gof->follows, gof->count, d->frame.reference,
                gof->planes[DFCGS_POSITION], step);
    dfcgs_learn_field(&gof->points.field, step);
    gof->points.has_moved = 1;
}
