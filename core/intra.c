#include "intra.h"

#include "column.h"
#include "companding.h"
#include "reconstruct.h"
#include "turn_passes.h"

enum { MAX_COVER = 15, THIN_AXIS = 2, STEP_SHIFT = 3, OCTAVE_SHIFT = 5, MAX_COLUMNS = 21 };

/* An I-frame under way. `coarse` [count][3] are the indices, with more and more of their bits. */
typedef struct {
    dfcgs_streams *streams;
    dfcgs_arena *arena;
    const dfcgs_sequence *sequence;
    const dfcgs_intra_coding *coding;
    dfcgs_intra_frame *frame;
    uint32_t count;
    dfcgs_levels levels;
    int32_t *coarse,
        *weights; /* weights [4][count] of 9.6: those of the attribute at hand, seen, tilts, spins */
    uint8_t *class, *spin_class, *needles;
    dfcgs_column_shape shape;
} walk;

dfcgs_status dfcgs_check_permutation(dfcgs_stream *s, const int32_t *places, uint32_t count) {
    size_t mark = s->arena->used;
    uint8_t *taken;
    DFCGS_GET_ZEROS(taken, s->arena, uint8_t, count);
    for (uint32_t i = 0; i < count; i++) {
        if (places[i] < 0 || (uint32_t)places[i] >= count || taken[places[i]])
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "the output order is not a permutation");
        taken[places[i]] = 1;
    }
    s->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status read_permutation(dfcgs_streams *streams, dfcgs_levels levels, int32_t *order) {
    dfcgs_stream *s;
    dfcgs_column_shape shape = dfcgs_plain_column(levels);
    DFCGS_TRY(dfcgs_next_stream(streams, &s));
    DFCGS_TRY(dfcgs_column(s, &shape, order, NULL));
    return dfcgs_check_permutation(s, order, levels.count);
}

/* --- 11.4, pass by pass
 * ------------------------------------------------------------------------------------------- */

static int64_t index_limit(const walk *w) {
    return 2 * (int64_t)DFCGS_STATE_LIMIT / w->coding->steps[DFCGS_POSITION];
}

static dfcgs_status read_positions(walk *w) {
    dfcgs_stream *s;
    int16_t *weights;
    DFCGS_TRY(dfcgs_next_stream(w->streams, &s));
    DFCGS_TRY(dfcgs_position_tree(s, &w->coding->grid, w->count, index_limit(w), w->coarse));
    DFCGS_GET(weights, w->arena, int16_t, (size_t)w->count *DFCGS_NEIGHBOURS);
    DFCGS_TRY(dfcgs_distance_weights(w->arena, w->coarse, w->count, weights));
    w->levels = (dfcgs_levels){w->count, dfcgs_num_levels(w->count), weights};
    return DFCGS_OK;
}

static dfcgs_status read_cover(walk *w) {
    size_t mark = w->arena->used;
    dfcgs_stream *s;
    dfcgs_column_shape shape = dfcgs_plain_column(w->levels);
    int32_t *cover;
    DFCGS_GET(cover, w->arena, int32_t, w->count);
    DFCGS_TRY(dfcgs_next_stream(w->streams, &s));
    DFCGS_TRY(dfcgs_column(s, &shape, cover, NULL));
    for (uint32_t i = 0; i < w->count; i++) {
        if (cover[i] < 0 || cover[i] > MAX_COVER)
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a cover class is out of range");
        w->frame->cover[i] = (uint8_t)cover[i];
    }
    w->arena->used = mark;
    return DFCGS_OK;
}

/* Steps of an attribute, by weights that were found. */
static dfcgs_row_steps steps_of(walk *w, int attribute, const int32_t *weights, uint8_t *class) {
    dfcgs_row_steps steps = {.class = class};
    dfcgs_coarseness(weights, w->count, w->coding->levels[attribute], STEP_SHIFT, DFCGS_MAX_COARSENESS,
                     class);
    if (attribute == DFCGS_ROTATION) dfcgs_turn_steps(w->coding->steps[attribute], steps.step);
    else dfcgs_steps(w->coding->steps[attribute], steps.step);
    return steps;
}

static void scatter(const int32_t *column, uint32_t count, int columns, int32_t *plane) {
    for (size_t i = 0; i < count; i++) plane[i * (size_t)columns] = column[i];
}

static dfcgs_status thin_axis(walk *w, dfcgs_stream *s, const int32_t *second, int32_t *third) {
    if (dfcgs_third_axis(second, third, w->count, w->sequence->scale_exponent, w->coding->thin_octaves,
                         third) == DFCGS_OK)
        return DFCGS_OK;
    return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a reconstructed value leaves the range of the state");
}

/* The stream of an attribute: its columns learn from those that `w->shape` knows, and become known to it. */
static dfcgs_status read_columns(walk *w, int attribute, const int32_t *weights) {
    dfcgs_stream *s;
    int columns = dfcgs_columns(attribute), alternating = w->coding->alternating >> attribute & 1;
    int32_t *values[2], *plane = w->frame->state.planes[attribute];
    w->shape.levels = w->levels;
    w->shape.steps = steps_of(w, attribute, weights, w->class);
    DFCGS_TRY(dfcgs_next_stream(w->streams, &s));
    DFCGS_GET(values[0], w->arena, int32_t, w->count);
    DFCGS_GET(values[1], w->arena, int32_t, w->count);
    for (int c = 0; c < columns; c++) {
        int32_t *residuals, *column = values[c % 2];
        int is_thin = attribute == DFCGS_SCALE && c == THIN_AXIS && w->coding->thin_octaves > 0;
        DFCGS_GET(residuals, w->arena, int32_t, w->count);
        w->shape.in_steps = !alternating;
        w->shape.alternating = alternating && !is_thin;
        DFCGS_TRY(dfcgs_column(s, &w->shape, column, residuals));
        if (is_thin) DFCGS_TRY(thin_axis(w, s, values[1 - c % 2], column));
        scatter(column, w->count, columns, plane + c);
        w->shape.earlier[w->shape.num_earlier++] = residuals;
    }
    return DFCGS_OK;
}

static dfcgs_status read_scales(walk *w) {
    size_t mark = w->arena->used;
    dfcgs_cover_weights(w->frame->cover, w->count, w->weights);
    DFCGS_TRY(read_columns(w, DFCGS_SCALE, w->weights));
    w->shape.num_earlier = 0;
    w->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status read_opacities(walk *w) {
    size_t mark = w->arena->used;
    dfcgs_area_weights(w->frame->state.planes[DFCGS_SCALE], w->frame->cover, w->count,
                       w->sequence->scale_exponent, w->weights);
    DFCGS_TRY(read_columns(w, DFCGS_OPACITY, w->weights));
    w->shape.num_earlier = 0;
    w->arena->used = mark;
    return DFCGS_OK;
}

/* `bits` low bits of the positions of rows whose octaves leave so many; whether all stay within the limit. */
static dfcgs_status bits_of_rows(walk *w, dfcgs_stream *s, const uint8_t *octaves, int bits, int *within) {
    size_t mark = w->arena->used;
    int64_t limit = index_limit(w);
    uint32_t *rows, num = 0;
    uint64_t *low;
    DFCGS_GET(rows, w->arena, uint32_t, w->count);
    for (uint32_t i = 0; i < w->count; i++)
        if (octaves[i] == w->coding->coarse_log2 - bits) rows[num++] = i;
    DFCGS_GET(low, w->arena, uint64_t, 3 * (size_t)num);
    DFCGS_TRY(dfcgs_bits(s, bits, 3 * num, low));
    for (uint32_t j = 0; j < num; j++)
        for (int a = 0; a < 3; a++) {
            int32_t *index = w->coarse + 3 * (size_t)rows[j] + a;
            int64_t whole = dfcgs_shift(*index, bits) | (int64_t)low[3 * (size_t)j + a];
            *within &= whole >= -limit && whole <= limit;
            *index = (int32_t)dfcgs_clip(whole, -limit, limit);
        }
    w->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status read_position_bits(walk *w) {
    dfcgs_stream *s;
    int within = 1;
    dfcgs_alpha_weights(w->frame->state.planes[DFCGS_OPACITY], w->frame->cover, w->count,
                        w->sequence->opacity_exponent, w->weights);
    dfcgs_coarseness(w->weights, w->count, w->coding->levels[DFCGS_POSITION], OCTAVE_SHIFT,
                     w->coding->coarse_log2, w->class);
    DFCGS_TRY(dfcgs_next_stream(w->streams, &s));
    for (int bits = 1; bits <= w->coding->coarse_log2; bits++)
        DFCGS_TRY(bits_of_rows(w, s, w->class, bits, &within));
    if (!within) return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a symbol is too large for its step");
    if (dfcgs_intra_positions(w->coarse, w->count, w->class, w->coding->steps[DFCGS_POSITION],
                              w->frame->state.planes[DFCGS_POSITION]) == DFCGS_OK)
        return DFCGS_OK;
    return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a reconstructed value leaves the range of the state");
}

static dfcgs_status read_rotations(walk *w) {
    size_t mark = w->arena->used;
    dfcgs_stream *s;
    int32_t *seen = w->weights + w->count, *tilts = seen + w->count, *spins = tilts + w->count;
    dfcgs_turn_shape shape = {.levels = w->levels, .needles = w->needles};
    dfcgs_seen_weights(w->frame->state.planes[DFCGS_SCALE], w->frame->state.planes[DFCGS_OPACITY],
                       w->frame->cover, w->count, w->sequence->scale_exponent, w->sequence->opacity_exponent,
                       seen, tilts, spins, w->needles);
    shape.tilts = steps_of(w, DFCGS_ROTATION, tilts, w->class);
    shape.spins = steps_of(w, DFCGS_ROTATION, spins, w->spin_class);
    shape.alternating = w->coding->alternating >> DFCGS_ROTATION & 1;
    DFCGS_TRY(dfcgs_next_stream(w->streams, &s));
    DFCGS_TRY(dfcgs_read_turns(s, &shape, w->frame->state.planes[DFCGS_ROTATION]));
    w->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status take_walk(walk *w) {
    DFCGS_GET(w->coarse, w->arena, int32_t, 3 * (size_t)w->count);
    DFCGS_GET(w->weights, w->arena, int32_t, 4 * (size_t)w->count);
    DFCGS_GET(w->class, w->arena, uint8_t, w->count);
    DFCGS_GET(w->spin_class, w->arena, uint8_t, w->count);
    DFCGS_GET(w->needles, w->arena, uint8_t, w->count);
    return DFCGS_OK;
}

dfcgs_status dfcgs_coded_intra(dfcgs_streams *streams, const dfcgs_sequence *sequence,
                               const dfcgs_intra_coding *coding, int has_permutation,
                               dfcgs_intra_frame *frame) {
    walk w = {.streams = streams,
              .arena = streams->stream.arena,
              .sequence = sequence,
              .coding = coding,
              .frame = frame,
              .count = frame->state.count};
    size_t mark = w.arena->used;
    DFCGS_TRY(take_walk(&w));
    DFCGS_TRY(read_positions(&w));
    if (has_permutation) DFCGS_TRY(read_permutation(streams, w.levels, frame->order));
    DFCGS_TRY(read_cover(&w));
    DFCGS_TRY(read_scales(&w));
    DFCGS_TRY(read_opacities(&w));
    DFCGS_TRY(read_position_bits(&w));
    DFCGS_TRY(read_rotations(&w));
    for (int a = DFCGS_SH_DC; a < sequence->num_attributes; a++)
        DFCGS_TRY(read_columns(&w, a, w.weights + w.count));
    w.arena->used = mark;
    return DFCGS_OK;
}

/* --- A
 * ----------------------------------------------------------------------------------------------------------
 */

enum { BYTE = 256, BYTE_BITS = 8, NUM_CONTEXTS = 8 };

/* One byte of each value: raw, or with a histogram for each context. */
static dfcgs_status read_plane(dfcgs_stream *s, const uint8_t *contexts, uint32_t count, uint8_t *plane) {
    uint8_t used[NUM_CONTEXTS];
    uint32_t is_structured;
    uint64_t *raw;
    dfcgs_model models[NUM_CONTEXTS];
    DFCGS_TRY(dfcgs_choice(s, 1, &is_structured));
    if (is_structured) {
        dfcgs_occurring(contexts, count, NUM_CONTEXTS, used);
        DFCGS_TRY(dfcgs_read_histograms(s, used, NUM_CONTEXTS, BYTE, models));
        return dfcgs_grouped(s, contexts, count, models, plane);
    }
    DFCGS_GET(raw, s->arena, uint64_t, count);
    DFCGS_TRY(dfcgs_bits(s, BYTE_BITS, count, raw));
    for (uint32_t i = 0; i < count; i++) plane[i] = (uint8_t)raw[i];
    return DFCGS_OK;
}

static dfcgs_status exponent_contexts(dfcgs_stream *s, const uint8_t *plane, uint32_t count,
                                      uint8_t *contexts) {
    uint32_t center;
    DFCGS_TRY(dfcgs_choice(s, BYTE_BITS, &center));
    for (uint32_t i = 0; i < count; i++)
        contexts[i] = (uint8_t)(dfcgs_clip((int64_t)(plane[i] & 127) - center, -4, 3) + 4);
    return DFCGS_OK;
}

/* A.1: values at a stride of `columns` */
static dfcgs_status read_float_column(dfcgs_stream *s, uint32_t count, int columns, uint32_t *patterns) {
    size_t mark = s->arena->used;
    uint8_t *contexts, *plane;
    DFCGS_GET_ZEROS(contexts, s->arena, uint8_t, count);
    DFCGS_GET(plane, s->arena, uint8_t, count);
    for (size_t i = 0; i < count; i++) patterns[i * (size_t)columns] = 0;
    for (int shift = 24; shift >= 0; shift -= BYTE_BITS) {
        size_t pass = s->arena->used;
        DFCGS_TRY(read_plane(s, contexts, count, plane));
        for (size_t i = 0; i < count; i++) patterns[i * (size_t)columns] |= (uint32_t)plane[i] << shift;
        memset(contexts, 0, count);
        if (shift == 24) DFCGS_TRY(exponent_contexts(s, plane, count, contexts));
        s->arena->used = pass;
    }
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_verbatim_intra(dfcgs_streams *streams, int num_attributes, int has_permutation,
                                  uint32_t count, uint32_t *const *patterns, int32_t *order) {
    for (int a = 0; a < num_attributes; a++) {
        dfcgs_stream *s;
        DFCGS_TRY(dfcgs_next_stream(streams, &s));
        for (int c = 0; c < dfcgs_columns(a); c++)
            DFCGS_TRY(read_float_column(s, count, dfcgs_columns(a), patterns[a] + c));
        if (a == DFCGS_POSITION && has_permutation)
            DFCGS_TRY(read_permutation(streams, dfcgs_order_levels(count), order));
    }
    return DFCGS_OK;
}
