#include "frame_output.h"

#include "output.h"

enum { FIRST_REST = DFCGS_SH_1, BANDS = 3, CHANNELS = 3 };

static const uint8_t FIRST_COEFFICIENT[BANDS] = {0, 3, 8};

/* An array of the output: its rows have `width` floats. */
typedef struct {
    float *values;
    uint32_t width;
} columns;

/* Where the values of an attribute go, but for doubles; those of SH bands lie channel by channel. */
static columns columns_of(const dfcgs_output *o, int attribute) {
    switch (attribute) {
    case DFCGS_POSITION: return (columns){o->positions, 3};
    case DFCGS_SCALE: return (columns){o->scales, 3};
    case DFCGS_ROTATION: return (columns){o->rotations, 4};
    case DFCGS_OPACITY: return (columns){o->opacities, 1};
    case DFCGS_SH_DC: return (columns){o->sh_dc, 3};
    default: return (columns){o->sh_rest, CHANNELS * o->num_rest};
    }
}

/* The place of column c of an attribute in a row of its array. */
static uint32_t place_of(const dfcgs_output *o, int attribute, uint32_t c) {
    if (attribute < FIRST_REST) return c;
    return c % CHANNELS * o->num_rest + FIRST_COEFFICIENT[attribute - FIRST_REST] + c / CHANNELS;
}

static size_t row_of(const dfcgs_gof *gof, size_t i) { return gof->has_order ? (size_t)gof->order[i] : i; }

/* Room for an array, if it is wanted. */
static dfcgs_status take_array(dfcgs_decoder *d, int wanted, int array, size_t width, float **values) {
    if (!(wanted >> array & 1)) return DFCGS_OK;
    DFCGS_GET(*values, &d->arena, float, width * d->gof.count);
    return DFCGS_OK;
}

static dfcgs_status take_output(dfcgs_decoder *d, int wanted, dfcgs_output *o) {
    size_t wide = d->sequence.precision == DFCGS_FLOAT64 ? 2 : 1;
    uint32_t degree = d->sequence.sh_degree;
    *o = (dfcgs_output){.count = d->gof.count, .num_rest = degree * (degree + 2)};
    DFCGS_TRY(take_array(d, wanted, 0, 3 * wide, (float **)&o->positions));
    DFCGS_TRY(take_array(d, wanted, 1, 4, &o->rotations));
    DFCGS_TRY(take_array(d, wanted, 2, 3, &o->scales));
    DFCGS_TRY(take_array(d, wanted, 3, 1, &o->opacities));
    DFCGS_TRY(take_array(d, wanted, 4, 3, &o->sh_dc));
    return take_array(d, wanted, 5, CHANNELS * o->num_rest, &o->sh_rest);
}

static void position_output(const dfcgs_decoder *d, const int32_t *order, void *positions) {
    const dfcgs_sequence *seq = &d->sequence;
    const int32_t *plane = d->gof.planes[DFCGS_POSITION];
    if (seq->precision == DFCGS_FLOAT64)
        dfcgs_double_positions(plane, d->gof.count, seq->origin, seq->position_exponent, order, positions);
    else dfcgs_float_positions(plane, d->gof.count, seq->origin, seq->position_exponent, order, positions);
}

static void band_output(const dfcgs_decoder *d, const int32_t *order, float *sh_rest) {
    const dfcgs_gof *g = &d->gof;
    const int32_t *second = g->num_attributes > DFCGS_SH_2 ? g->planes[DFCGS_SH_2] : NULL;
    const int32_t *third = g->num_attributes > DFCGS_SH_3 ? g->planes[DFCGS_SH_3] : NULL;
    dfcgs_float_bands(g->planes[DFCGS_SH_1], second, third, g->count, d->sequence.color_exponent, order,
                      sh_rest);
}

static void state_output(const dfcgs_decoder *d, const dfcgs_output *o) {
    const dfcgs_sequence *seq = &d->sequence;
    const dfcgs_gof *g = &d->gof;
    const int32_t *order = g->has_order ? g->order : NULL;
    if (o->positions) position_output(d, order, o->positions);
    if (o->rotations) dfcgs_floats(g->planes[DFCGS_ROTATION], g->count, 4, -24, order, o->rotations);
    if (o->scales) dfcgs_floats(g->planes[DFCGS_SCALE], g->count, 3, seq->scale_exponent, order, o->scales);
    if (o->opacities)
        dfcgs_float_logits(g->planes[DFCGS_OPACITY], g->count, seq->opacity_exponent, order, o->opacities);
    if (o->sh_dc) dfcgs_floats(g->planes[DFCGS_SH_DC], g->count, 3, seq->color_exponent, order, o->sh_dc);
    if (o->sh_rest && o->num_rest) band_output(d, order, o->sh_rest);
}

/* Puts the bits of a float32 into column c of an attribute. */
static void put_value(const dfcgs_decoder *d, const dfcgs_output *o, int attribute, size_t row, uint32_t c,
                      uint32_t bits) {
    columns to = columns_of(o, attribute);
    size_t at = row * to.width + place_of(o, attribute, c);
    float value;
    memcpy(&value, &bits, sizeof value);
    if (attribute == DFCGS_POSITION && d->sequence.precision == DFCGS_FLOAT64) {
        double wide = value;
        memcpy((double *)o->positions + at, &wide, sizeof wide);
    } else memcpy(to.values + at, &bits, sizeof bits);
}

static void verbatim_output(const dfcgs_decoder *d, const dfcgs_output *o) {
    const dfcgs_gof *g = &d->gof;
    for (int a = 0; a < g->num_attributes; a++) {
        uint32_t width = (uint32_t)dfcgs_columns(a);
        for (size_t i = 0; i < g->count; i++)
            for (uint32_t c = 0; c < width; c++)
                put_value(d, o, a, row_of(g, i), c, g->patterns[a][i * width + c]);
    }
}

/* The attribute of column c of all of them, and the column of its own. */
static int attribute_of(uint32_t *c) {
    int attribute = 0;
    while (*c >= (uint32_t)dfcgs_columns(attribute)) *c -= (uint32_t)dfcgs_columns(attribute++);
    return attribute;
}

/* Escapes were checked when they came, so that no read fails. */
static void put_escapes(dfcgs_decoder *d, const dfcgs_output *o) {
    dfcgs_reader rows = {.data = d->escapes, .size = d->escape_bytes, .error = &d->error}, values;
    const uint8_t *column_bytes, *pattern;
    uint64_t count, delta, row = 0;
    dfcgs_uvarint(&rows, &count);
    values = rows;
    for (uint64_t i = 0; i < count; i++) dfcgs_uvarint(&values, &delta);
    dfcgs_raw(&values, count, &column_bytes);
    for (uint64_t i = 0; i < count; i++) {
        uint32_t c = column_bytes[i], bits;
        int attribute = attribute_of(&c),
            wide = attribute == DFCGS_POSITION && d->sequence.precision == DFCGS_FLOAT64;
        dfcgs_uvarint(&rows, &delta);
        row += delta;
        dfcgs_raw(&values, wide ? 8 : 4, &pattern);
        size_t to = row_of(&d->gof, (size_t)row);
        if (wide) memcpy((double *)o->positions + 3 * to + c, pattern, 8);
        else {
            memcpy(&bits, pattern, 4);
            put_value(d, o, attribute, to, c, bits);
        }
    }
}

dfcgs_status dfcgs_frame_output(dfcgs_decoder *decoder, int wanted, dfcgs_output *output) {
    if (decoder->gof.has_patterns || decoder->escapes) wanted = DFCGS_ALL_ARRAYS;
    decoder->arena.used = decoder->frame_start;
    DFCGS_TRY(take_output(decoder, wanted, output));
    if (decoder->gof.has_patterns) verbatim_output(decoder, output);
    else state_output(decoder, output);
    if (decoder->escapes) put_escapes(decoder, output);
    return DFCGS_OK;
}
