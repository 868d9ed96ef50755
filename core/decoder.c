#include "decoder.h"

#include "column.h"
#include "intra.h"
#include "motion_passes.h"
#include "reconstruct.h"
#include "verbatim_state.h"

enum { NUM_MOTION_STREAMS = 2 };

/* --- setting up
 * ------------------------------------------------------------------------------------------------------ */

/* Fills in the record where whoever refused did not. */
static dfcgs_status recorded(dfcgs_decoder *d, dfcgs_status status, const char *message) {
    if (status != DFCGS_OK && d->error.status != status)
        dfcgs_refuse(&d->error, status, DFCGS_NO_OFFSET, message);
    return status;
}

static dfcgs_reader reader_of(dfcgs_decoder *d, const uint8_t *data, size_t size, int64_t offset) {
    return (dfcgs_reader){
        .data = data, .size = size, .base = offset, .shortage = DFCGS_CORRUPT, .error = &d->error};
}

static dfcgs_stream stream_of(dfcgs_decoder *d) {
    return (dfcgs_stream){.arena = &d->arena, .models = &d->models, .error = &d->error};
}

dfcgs_status dfcgs_open(dfcgs_decoder *decoder, const int32_t *words, uint32_t num_words) {
    DFCGS_TRY(
        recorded(decoder, dfcgs_make_models(&decoder->arena, &decoder->models), "no memory for tables"));
    dfcgs_status status =
        dfcgs_read_context_model(&decoder->arena, &decoder->models, words, num_words, &decoder->model);
    return recorded(decoder, status, "the arrays of the model do not fit each other");
}

dfcgs_status dfcgs_begin(dfcgs_decoder *decoder, const uint8_t *payload, size_t size, int64_t offset) {
    dfcgs_reader r = reader_of(decoder, payload, size, offset);
    DFCGS_TRY(dfcgs_read_sequence(&r, &decoder->sequence));
    decoder->budget = (dfcgs_budget){.max_memory = INT64_MAX,
                                     .max_gaussians = INT64_MAX,
                                     .columns = decoder->sequence.num_columns,
                                     .error = &decoder->error};
    decoder->setup_end = decoder->frame_start = decoder->arena.used;
    dfcgs_forget(decoder);
    return DFCGS_OK;
}

void dfcgs_forget(dfcgs_decoder *decoder) {
    decoder->gof.is_there = 0;
    decoder->frame.expects = 0;
    decoder->escapes = NULL;
    decoder->arena.used = decoder->frame_start = decoder->setup_end;
}

uint8_t *dfcgs_payload_room(dfcgs_decoder *decoder, int type, size_t size) {
    if (type == DFCGS_CHUNK_INTRA) dfcgs_forget(decoder);
    if (type == DFCGS_CHUNK_INTER) decoder->arena.used = decoder->frame_start;
    return DFCGS_TAKE(&decoder->arena, uint8_t, size);
}

/* --- the end of a frame
 * ------------------------------------------------------------------------------------------------- */

/* Where the arena is free when the frame is done: behind the GoF and the escapes that stay. */
static void settle(dfcgs_decoder *d) {
    dfcgs_frame *f = &d->frame;
    dfcgs_settle_gof(&d->gof);
    uint8_t *end = d->gof.home + d->gof.size;
    if (f->escapes) {
        memmove(end, f->escapes, f->escape_bytes);
        d->escapes = end;
        d->escape_bytes = f->escape_bytes;
    }
    d->frame_start = (size_t)(end - d->arena.base) + (d->escapes ? d->escape_bytes : 0);
    d->arena.used = d->frame_start;
}

static dfcgs_status finish_frame(dfcgs_decoder *d) {
    uint8_t hash[DFCGS_HASH_BYTES];
    int differs = 0;
    d->frame.expects = 0;
    settle(d);
    if (!d->check) return DFCGS_OK;
    dfcgs_frame_hash(&d->gof, d->escapes, d->escape_bytes, hash);
    for (int i = 0; i < DFCGS_HASH_BYTES; i++) differs |= hash[i] ^ d->frame.hash[i];
    if (!differs) return DFCGS_OK;
    return dfcgs_refuse(&d->error, DFCGS_HASH, d->frame.offset,
                        "the frame decodes to other values than its encoder had");
}

/* --- I-frames
 * --------------------------------------------------------------------------------------------------------------
 */

static dfcgs_state state_of(const dfcgs_gof *gof) {
    dfcgs_state state = {.count = gof->count, .num_attributes = gof->num_attributes};
    memcpy(state.planes, gof->planes, sizeof state.planes);
    return state;
}

static dfcgs_status decode_intra(dfcgs_decoder *d, dfcgs_streams *streams, const dfcgs_intra_header *header) {
    dfcgs_gof *gof = &d->gof;
    dfcgs_intra_frame frame = {state_of(gof), gof->cover, gof->order};
    if (header->kind == DFCGS_CODED)
        return dfcgs_coded_intra(streams, &d->sequence, &header->coding, header->has_permutation, &frame);
    DFCGS_TRY(dfcgs_verbatim_intra(streams, gof->num_attributes, header->has_permutation, gof->count,
                                   gof->patterns, gof->order));
    dfcgs_verbatim_state(&d->sequence, gof->patterns, &frame.state);
    return DFCGS_OK;
}

/* Reads the lengths of streams, and stands before the first one. */
static dfcgs_status open_streams(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                                 dfcgs_streams *streams) {
    DFCGS_TRY(dfcgs_read_lengths(r, count, lengths));
    return dfcgs_open_streams(streams, r, lengths, count, stream_of(d));
}

static dfcgs_status put_intra(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_intra_header header;
    dfcgs_streams streams;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    DFCGS_TRY(dfcgs_read_intra(r, &d->sequence, &header));
    memcpy(d->frame.hash, header.hash, DFCGS_HASH_BYTES);
    DFCGS_TRY(dfcgs_charge_intra(&d->budget, d->frame.index, header.num_gaussians, &header.control));
    DFCGS_TRY(open_streams(d, r, header.num_streams, lengths, &streams));
    if (header.num_gaussians == 0) header.kind = DFCGS_CODED;
    DFCGS_TRY(dfcgs_take_gof(&d->arena, d->sequence.num_attributes, &header, &d->gof));
    if (header.num_gaussians) {
        DFCGS_TRY(decode_intra(d, &streams, &header));
        DFCGS_TRY(dfcgs_close_streams(&streams));
        dfcgs_begin_gof(&d->gof, header.kind == DFCGS_CODED ? header.coding.steps[DFCGS_POSITION] : 1);
    }
    d->gof.is_there = 1;
    d->frame.expects = header.has_escapes ? DFCGS_CHUNK_ESCAPES : 0;
    return header.has_escapes ? DFCGS_OK : finish_frame(d);
}

/* --- TOPOLOGY
 * -------------------------------------------------------------------------------------------------------------
 */

/* Who survives: `kept` [count]. */
static dfcgs_status read_removals(dfcgs_decoder *d, dfcgs_streams *streams, uint32_t *kept) {
    static const uint8_t used[1] = {1};
    uint32_t count = d->gof.count, survivors = 0;
    dfcgs_stream *s;
    dfcgs_model models[1];
    uint8_t *contexts, *removed;
    DFCGS_TRY(dfcgs_next_stream(streams, &s));
    DFCGS_GET_ZEROS(contexts, &d->arena, uint8_t, count);
    DFCGS_GET(removed, &d->arena, uint8_t, count);
    DFCGS_TRY(dfcgs_read_histograms(s, used, 1, 2, models));
    DFCGS_TRY(dfcgs_grouped(s, contexts, count, models, removed));
    for (uint32_t i = 0; i < count; i++)
        if (!removed[i]) kept[survivors++] = i;
    if (survivors == count - d->frame.topology.num_removals) return DFCGS_OK;
    return dfcgs_corrupt(&d->error, DFCGS_NO_OFFSET, "removals are not as many as their number says");
}

static dfcgs_status read_births(dfcgs_decoder *d, dfcgs_streams *streams) {
    dfcgs_births *births = &d->frame.births;
    uint32_t count = d->frame.topology.num_births;
    births->state = (dfcgs_state){.count = count, .num_attributes = d->gof.num_attributes};
    for (int a = 0; a < d->gof.num_attributes; a++)
        DFCGS_GET(births->state.planes[a], &d->arena, int32_t, (size_t)count *(size_t)dfcgs_columns(a));
    DFCGS_GET(births->cover, &d->arena, uint8_t, count);
    dfcgs_intra_frame frame = {births->state, births->cover, NULL};
    return dfcgs_coded_intra(streams, &d->sequence, &d->frame.topology.coding, 0, &frame);
}

/* Places [count] that are expected of survivors and births. */
static void expect_places(const dfcgs_decoder *d, uint32_t count, int32_t *places) {
    const dfcgs_gof *gof = &d->gof;
    const uint32_t *source = d->frame.births.source;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t row = source ? source[i] : i;
        places[i] = !gof->has_order ? (int32_t)i : row < gof->count ? gof->order[row] : (int32_t)row;
    }
}

static dfcgs_status read_places(dfcgs_decoder *d, dfcgs_streams *streams) {
    dfcgs_stream *s;
    uint32_t count = d->frame.num_gaussians;
    dfcgs_column_shape shape = dfcgs_plain_column(dfcgs_order_levels(count));
    int32_t *places, *expected;
    DFCGS_GET(places, &d->arena, int32_t, count);
    DFCGS_GET(expected, &d->arena, int32_t, count);
    DFCGS_TRY(dfcgs_next_stream(streams, &s));
    DFCGS_TRY(dfcgs_column(s, &shape, places, NULL));
    expect_places(d, count, expected);
    for (uint32_t i = 0; i < count; i++) places[i] += expected[i];
    d->frame.places = places;
    return dfcgs_check_permutation(s, places, count);
}

/* Removals, births and places, in the order of their streams. */
static dfcgs_status read_topology(dfcgs_decoder *d, dfcgs_streams *streams) {
    const dfcgs_topology_header *header = &d->frame.topology;
    uint32_t *kept;
    DFCGS_GET(kept, &d->arena, uint32_t, d->gof.count);
    if (header->num_removals) {
        DFCGS_TRY(read_removals(d, streams, kept));
        DFCGS_TRY(dfcgs_keep_survivors(&d->arena, &d->gof, kept, d->gof.count - header->num_removals));
    }
    if (header->num_births) {
        DFCGS_TRY(read_births(d, streams));
        DFCGS_TRY(dfcgs_place_births(&d->arena, &d->gof, &d->frame.births));
    }
    if (header->has_permutation) DFCGS_TRY(read_places(d, streams));
    return dfcgs_close_streams(streams);
}

static dfcgs_status put_topology(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_frame *f = &d->frame;
    const dfcgs_topology_header *header = &f->topology;
    dfcgs_streams streams;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    DFCGS_TRY(dfcgs_read_topology(r, &d->sequence, d->gof.count, &f->topology));
    f->num_gaussians = d->gof.count - header->num_removals + header->num_births;
    if (header->num_births)
        DFCGS_TRY(dfcgs_charge_births(&d->budget, f->index, header->num_births, f->num_gaussians));
    int births = header->num_births ? d->gof.num_attributes + 2 : 0;
    int num_streams = (header->num_removals > 0) + births + header->has_permutation;
    DFCGS_TRY(open_streams(d, r, num_streams, lengths, &streams));
    DFCGS_TRY(read_topology(d, &streams));
    f->has_topology = 1;
    return DFCGS_OK;
}

/* The end of a frame in which Gaussians come or have other places. */
static dfcgs_status finish_topology(dfcgs_decoder *d) {
    dfcgs_frame *f = &d->frame;
    dfcgs_gof *gof = &d->gof;
    if (f->topology.num_births) DFCGS_TRY(dfcgs_insert_births(&d->arena, gof, &f->births));
    if (!f->places) return DFCGS_OK;
    memcpy(gof->order, f->places, gof->count * sizeof *gof->order);
    gof->has_order = 1;
    dfcgs_touch(gof, DFCGS_ORDER_BIT);
    return DFCGS_OK;
}

/* --- MOTION
 * ---------------------------------------------------------------------------------------------------------------
 */

static dfcgs_status charge_symbols(void *whom, uint64_t num_symbols) {
    dfcgs_decoder *d = whom;
    return dfcgs_charge_symbols(&d->budget, d->frame.index, d->frame.num_gaussians, num_symbols);
}

static dfcgs_status open_charged(dfcgs_decoder *d, dfcgs_reader *r, int count, uint64_t *lengths,
                                 dfcgs_streams *streams) {
    DFCGS_TRY(open_streams(d, r, count, lengths, streams));
    streams->charge = charge_symbols;
    streams->whom = d;
    return DFCGS_OK;
}

static dfcgs_status read_motion_streams(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_gof *gof = &d->gof;
    dfcgs_streams streams;
    dfcgs_stream *s;
    uint64_t lengths[NUM_MOTION_STREAMS];
    DFCGS_TRY(open_charged(d, r, NUM_MOTION_STREAMS, lengths, &streams));
    DFCGS_TRY(dfcgs_next_stream(&streams, &s));
    DFCGS_TRY(dfcgs_read_followers(s, gof->count, gof->modes, gof->follows));
    DFCGS_TRY(dfcgs_next_stream(&streams, &s));
    DFCGS_TRY(dfcgs_read_control(s, &d->model.control, d->model.control_weights, &gof->points.field,
                                 gof->points.order, &d->frame.motion, gof->points.symbols));
    return dfcgs_close_streams(&streams);
}

static dfcgs_status put_motion(dfcgs_decoder *d, dfcgs_reader *r) {
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

static void learn(dfcgs_decoder *d) {
    dfcgs_gof *gof = &d->gof;
    int step = d->frame.motion.translation_step;
    dfcgs_learn(&gof->points.field, gof->bindings, gof->follows, gof->count, d->frame.reference,
                gof->planes[DFCGS_POSITION], step);
    dfcgs_learn_field(&gof->points.field, step);
    gof->points.has_moved = 1;
}

/* --- RESIDUAL
 * -------------------------------------------------------------------------------------------------------------
 */

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

static dfcgs_status put_residual(dfcgs_decoder *d, dfcgs_reader *r) {
    size_t mark = d->arena.used;
    residual all = {0};
    dfcgs_streams streams;
    dfcgs_stream *s;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    int mask = d->frame.header.mask;
    DFCGS_TRY(prepare_residual(d, &all));
    DFCGS_TRY(open_charged(d, r, __builtin_popcount((unsigned)mask), lengths, &streams));
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

/* --- P-frames
 * -------------------------------------------------------------------------------------------------------------
 */

static dfcgs_status put_escapes(dfcgs_decoder *d, dfcgs_reader *r) {
    uint64_t count;
    DFCGS_TRY(dfcgs_check_escapes(&d->arena, r, &d->sequence, d->gof.count, &count));
    d->frame.escapes = count ? r->data : NULL;
    d->frame.escape_bytes = r->size;
    return finish_frame(d);
}

/* What the frame waits for; when all is there, the frame's end. */
static dfcgs_status advance(dfcgs_decoder *d) {
    dfcgs_frame *f = &d->frame;
    int tools = f->header.tools;
    if (tools & DFCGS_TOPOLOGY && !f->has_topology) f->expects = DFCGS_CHUNK_TOPOLOGY;
    else if (tools & DFCGS_MOTION && !f->has_motion) f->expects = DFCGS_CHUNK_MOTION;
    else if (f->header.mask && !f->has_residual) f->expects = DFCGS_CHUNK_RESIDUAL;
    else {
        d->gof.history = f->header.mask;
        if (f->has_motion) learn(d);
        if (f->has_topology) DFCGS_TRY(finish_topology(d));
        f->expects = tools & DFCGS_ESCAPE ? DFCGS_CHUNK_ESCAPES : 0;
        if (!f->expects) return finish_frame(d);
    }
    return DFCGS_OK;
}

static dfcgs_status put_inter(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_frame *f = &d->frame;
    DFCGS_TRY(dfcgs_read_inter(r, &d->sequence, &f->header));
    memcpy(f->hash, f->header.hash, DFCGS_HASH_BYTES);
    f->num_gaussians = d->gof.count;
    d->gof.touched = 0;
    DFCGS_TRY(dfcgs_charge_inter(&d->budget, f->index, d->gof.count, &f->header));
    DFCGS_TRY(dfcgs_expect_end(r));
    if (f->header.tools || f->header.mask) {
        if (d->gof.count == 0)
            return dfcgs_corrupt(&d->error, DFCGS_NO_OFFSET,
                                 "a P-frame that changes a frame without Gaussians");
        d->gof.has_patterns = 0;
        d->escapes = NULL;
    }
    return advance(d);
}

static dfcgs_status put_part(dfcgs_decoder *d, dfcgs_reader *r, int type) {
    switch (type) {
    case DFCGS_CHUNK_TOPOLOGY: DFCGS_TRY(put_topology(d, r)); break;
    case DFCGS_CHUNK_MOTION: DFCGS_TRY(put_motion(d, r)); break;
    case DFCGS_CHUNK_RESIDUAL: DFCGS_TRY(put_residual(d, r)); break;
    case DFCGS_CHUNK_ESCAPES: return put_escapes(d, r);
    default: return DFCGS_MISUSE;
    }
    return advance(d);
}

static dfcgs_status put(dfcgs_decoder *d, const dfcgs_chunk *chunk) {
    dfcgs_reader r = reader_of(d, chunk->payload, chunk->payload_size, chunk->payload_offset);
    int is_intra = chunk->type == DFCGS_CHUNK_INTRA, is_inter = chunk->type == DFCGS_CHUNK_INTER;
    if (is_inter && !d->gof.is_there)
        return dfcgs_corrupt(&d->error, chunk->offset, "a P-frame without an I-frame before it");
    dfcgs_charge_bytes(&d->budget, chunk->size);
    if (!is_intra && !is_inter)
        return chunk->type == d->frame.expects ? put_part(d, &r, chunk->type) : DFCGS_MISUSE;
    d->frame = (dfcgs_frame){.index = chunk->frame, .offset = chunk->offset, .is_intra = is_intra};
    return is_intra ? put_intra(d, &r) : put_inter(d, &r);
}

dfcgs_status dfcgs_put(dfcgs_decoder *decoder, const dfcgs_chunk *chunk) {
    decoder->error = (dfcgs_error){.status = DFCGS_OK, .offset = DFCGS_NO_OFFSET};
    dfcgs_status status = put(decoder, chunk);
    if (status != DFCGS_OK) dfcgs_forget(decoder);
    return recorded(decoder, status,
                    "a symbol is too large for its step, or a value leaves the range of the state");
}
