#include "decoder.h"

#include "intra.h"
#include "parts.h"
#include "verbatim_state.h"

/* --- setting up -------------------------------------------------------------------------------------- */

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

/* --- the end of a frame ------------------------------------------------------------------------------ */

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

/* --- I-frames ---------------------------------------------------------------------------------------- */

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

static dfcgs_status put_intra(dfcgs_decoder *d, dfcgs_reader *r) {
    dfcgs_intra_header header;
    dfcgs_streams streams;
    uint64_t lengths[DFCGS_MAX_STREAMS];
    DFCGS_TRY(dfcgs_read_intra(r, &d->sequence, &header));
    memcpy(d->frame.hash, header.hash, DFCGS_HASH_BYTES);
    DFCGS_TRY(dfcgs_charge_intra(&d->budget, d->frame.index, header.num_gaussians, &header.control));
    DFCGS_TRY(dfcgs_open_part(d, r, header.num_streams, lengths, &streams));
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

/* --- P-frames ---------------------------------------------------------------------------------------- */

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
        if (f->has_motion) dfcgs_learn_motion(d);
        if (f->has_topology) DFCGS_TRY(dfcgs_finish_topology(d));
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
    case DFCGS_CHUNK_TOPOLOGY: DFCGS_TRY(dfcgs_put_topology(d, r)); break;
    case DFCGS_CHUNK_MOTION: DFCGS_TRY(dfcgs_put_motion(d, r)); break;
    case DFCGS_CHUNK_RESIDUAL: DFCGS_TRY(dfcgs_put_residual(d, r)); break;
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
