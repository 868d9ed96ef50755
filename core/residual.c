#include "parts.h"
#include "reconstruct.h"
#include "visibility.h"

/* What the streams of a frame share; `coarseness` of attributes with the tool VISIBILITY. */
typedef struct {
    dfcgs_inter_context context;
    uint8_t *earlier[DFCGS_NUM_EARLIER], *coarseness[DFCGS_MAX_ATTRIBUTES], *nothing;
} residual;

static int attribute_of_earlier(int i) { return i == 0 ? DFCGS_POSITION : DFCGS_ROTATION; }

static dfcgs_status find_coarseness(dfcgs_decoder *d, residual *all) {
    const dfcgs_gof *gof = &d->gof;
    const dfcgs_inter_header *header = &d->frame.header;
    int32_t *weights;
    if (!(header->tools & DFCGS_VISIBILITY)) return DFCGS_OK;
    DFCGS_GET(weights, &d->arena, int32_t, DFCGS_NUM_SHOWN *(size_t)gof->count);
    dfcgs_visibility(gof->planes[DFCGS_SCALE], gof->planes[DFCGS_OPACITY], gof->cover, gof->count,
                     d->sequence.scale_exponent, d->sequence.opacity_exponent, weights);
    for (int a = 0; a < gof->num_attributes; a++) {
        if (!(header->mask >> a & 1)) continue;
        DFCGS_GET(all->coarseness[a], &d->arena, uint8_t, gof->count);
        dfcgs_coarseness(weights + (size_t)dfcgs_shown(a) * gof->count, gof->count, header->levels[a], 3,
                         DFCGS_MAX_COARSENESS, all->coarseness[a]);
    }
    return DFCGS_OK;
}

static dfcgs_status prepare_residual(dfcgs_decoder *d, residual *all) {
    dfcgs_gof *gof = &d->gof;
    uint8_t *gaussians;
    all->context.model = &d->model;
    DFCGS_TRY(find_coarseness(d, all));
    DFCGS_TRY(dfcgs_gof_levels(&d->arena, gof, &all->context.levels));
    DFCGS_GET(gaussians, &d->arena, uint8_t, (size_t)gof->count *DFCGS_NUM_GAUSSIAN_INPUTS);
    dfcgs_gaussian_inputs(gof->points.has_moved ? gof->bindings : NULL,
                          d->frame.has_motion ? gof->follows : NULL, gof->count, gaussians);
    all->context.known.gaussians = gaussians;
    DFCGS_GET_ZEROS(all->nothing, &d->arena, uint8_t, dfcgs_num_blocks(gof->count));
    all->context.beside = d->frame.has_motion ? gof->modes : all->nothing;
    for (int i = 0; i < DFCGS_NUM_EARLIER; i++) {
        int a = attribute_of_earlier(i);
        if (!(gof->history >> a & 1)) continue;
        DFCGS_GET(all->earlier[i], &d->arena, uint8_t, gof->count);
        dfcgs_log_sizes(gof->activity[a].symbols, gof->count, dfcgs_inter_columns(a), all->earlier[i]);
    }
    return DFCGS_OK;
}

static dfcgs_status read_attribute(dfcgs_decoder *d, dfcgs_stream *s, residual *all, int attribute) {
    dfcgs_gof *gof = &d->gof;
    dfcgs_activity *activity = &gof->activity[attribute];
    dfcgs_known *known = &all->context.known;
    uint8_t *before;
    int columns = dfcgs_inter_columns(attribute);
    size_t mark = d->arena.used;
    DFCGS_GET(before, &d->arena, uint8_t, gof->count);
    if (!(gof->history >> attribute & 1)) dfcgs_clear_activity(gof, attribute);
    dfcgs_log_sizes(activity->symbols, gof->count, columns, before);
    for (int i = 0; i < DFCGS_NUM_EARLIER; i++)
        known->earlier[i] = attribute == attribute_of_earlier(i) ? NULL : all->earlier[i];
    known->attribute = attribute;
    known->columns = columns;
    known->coarseness = all->coarseness[attribute];
    known->before = before;
    known->running = activity->running;
    known->memory = activity->memory;
    known->density_before = activity->density;
    DFCGS_TRY(dfcgs_inter_attribute(s, &all->context, activity));
    all->context.beside = activity->density;
    d->arena.used = mark;
    return DFCGS_OK;
}

static dfcgs_status reconstruct(dfcgs_decoder *d, const residual *all) {
    dfcgs_gof *gof = &d->gof;
    for (int a = 0; a < gof->num_attributes; a++) {
        if (!(d->frame.header.mask >> a & 1)) continue;
        int32_t step = d->frame.header.steps[a], *symbols = gof->activity[a].symbols;
        if (a == DFCGS_ROTATION)
            DFCGS_TRY(dfcgs_turn(gof->planes[a], symbols, gof->count, step, all->coarseness[a]));
        else
            DFCGS_TRY(dfcgs_reconstruct(gof->planes[a], symbols, gof->count, dfcgs_columns(a), step,
                                        all->coarseness[a]));
    }
    dfcgs_touch(gof, d->frame.header.mask);
    return DFCGS_OK;
}

dfcgs_status dfcgs_put_residual(dfcgs_decoder *d, dfcgs_reader *r) {
    size_t mark = d->arena.used;
    residual all = {0};
    dfcgs_streams streams;
    dfcgs_stream *s;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    int mask = d->frame.header.mask;
    DFCGS_TRY(prepare_residual(d, &all));
    DFCGS_TRY(dfcgs_open_charged(d, r, __builtin_popcount((unsigned)mask), lengths, &streams));
    for (int a = 0; a < d->gof.num_attributes; a++) {
        if (!(mask >> a & 1)) continue;
        DFCGS_TRY(dfcgs_next_stream(&streams, &s));
        DFCGS_TRY(read_attribute(d, s, &all, a));
    }
    DFCGS_TRY(dfcgs_close_streams(&streams));
    DFCGS_TRY(reconstruct(d, &all));
    d->frame.has_residual = 1;
    d->arena.used = mark;
    return DFCGS_OK;
}
