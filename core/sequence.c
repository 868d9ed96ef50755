#include "sequence.h"

enum {
    BITSTREAM_VERSION = 11,
    NUM_LEVELS = 3,
    MAX_SH_DEGREE = 3,
    NUM_ORDERS = 3,
    MAX_UNIT_EXPONENT = 60,
    MAX_OPACITY_EXPONENT = -11,
    MAX_NETWORK_SCALE_EXPONENT = 23,
    MIN_NETWORK_COLOR_EXPONENT = -40,
    MAX_NETWORK_COLOR_EXPONENT = 21
};
#define MAX_ORIGIN ((int64_t)1 << 52)

static const dfcgs_level_limits LEVELS[NUM_LEVELS] = {
    {262144, 16384, 4096}, {2097152, 131072, 16384}, {16777216, 1048576, 16384}};

static dfcgs_status read_version(dfcgs_reader *r) {
    int64_t offset = dfcgs_offset(r);
    uint8_t version;
    DFCGS_TRY(dfcgs_u8(r, &version));
    if (version == BITSTREAM_VERSION) return DFCGS_OK;
    return dfcgs_refuse(r->error, DFCGS_UNSUPPORTED, offset, "another bitstream version than 11");
}

static dfcgs_status read_level(dfcgs_reader *r, dfcgs_sequence *sequence) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, &sequence->level));
    if (sequence->level < 1 || sequence->level > NUM_LEVELS)
        return dfcgs_refuse(r->error, DFCGS_UNSUPPORTED, offset, "the level is unknown");
    sequence->limits = LEVELS[sequence->level - 1];
    return DFCGS_OK;
}

static dfcgs_status read_frame_rate(dfcgs_reader *r, const dfcgs_sequence *sequence) {
    int64_t offset = dfcgs_offset(r);
    uint64_t numerator, denominator;
    DFCGS_TRY(dfcgs_uvarint(r, &numerator));
    DFCGS_TRY(dfcgs_uvarint(r, &denominator));
    if (sequence->num_frames && denominator) return DFCGS_OK;
    return dfcgs_corrupt(r->error, offset, "no frames, or a frame rate with denominator 0");
}

/* Runs of frame numbers; what the numbers are is of no matter to a decoder. */
static dfcgs_status read_runs(dfcgs_reader *r, const dfcgs_sequence *sequence) {
    int64_t offset = dfcgs_offset(r), left = sequence->num_frames;
    uint64_t num_runs, skipped, length;
    DFCGS_TRY(dfcgs_uvarint_most(r, sequence->num_frames, &num_runs));
    for (uint64_t i = 0; i < num_runs; i++) {
        DFCGS_TRY(dfcgs_uvarint(r, &skipped));
        DFCGS_TRY(dfcgs_uvarint_most(r, sequence->num_frames, &length));
        left -= (int64_t)length + 1;
    }
    return left ? dfcgs_corrupt(r->error, offset, "frame numbers do not add up to num_frames") : DFCGS_OK;
}

static int suits_networks(const dfcgs_sequence *s) {
    return s->scale_exponent <= MAX_NETWORK_SCALE_EXPONENT &&
           s->color_exponent >= MIN_NETWORK_COLOR_EXPONENT && s->color_exponent <= MAX_NETWORK_COLOR_EXPONENT;
}

static dfcgs_status read_units(dfcgs_reader *r, dfcgs_sequence *sequence) {
    int64_t offset = dfcgs_offset(r), e[4];
    DFCGS_TRY(dfcgs_svarints_within(r, 4, MAX_UNIT_EXPONENT, e));
    if (e[2] > MAX_OPACITY_EXPONENT)
        return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "the unit of opacities is too large");
    sequence->position_exponent = (int)e[0];
    sequence->scale_exponent = (int)e[1];
    sequence->opacity_exponent = (int)e[2];
    sequence->color_exponent = (int)e[3];
    DFCGS_TRY(dfcgs_svarints_within(r, 3, MAX_ORIGIN, sequence->origin));
    DFCGS_TRY(dfcgs_enum(r, DFCGS_NUM_PRECISIONS, &sequence->precision));
    if (sequence->profile == DFCGS_PAPER && !suits_networks(sequence))
        return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "unit exponents are too far from 0 for a network");
    return DFCGS_OK;
}

static dfcgs_status read_model(dfcgs_reader *r, dfcgs_sequence *sequence) {
    const uint8_t *bytes;
    uint64_t length;
    DFCGS_TRY(dfcgs_uvarint_most(r, DFCGS_MAX_MODEL_ID, &length));
    sequence->model_id_length = (uint8_t)length;
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_raw(r, length, &bytes));
    for (int i = 0; i < sequence->model_id_length; i++) {
        if (bytes[i] > 127) return dfcgs_corrupt(r->error, offset, "model_id is not ASCII");
        sequence->model_id[i] = bytes[i];
    }
    DFCGS_TRY(dfcgs_raw(r, DFCGS_MODEL_HASH_BYTES, &bytes));
    memcpy(sequence->model_hash, bytes, DFCGS_MODEL_HASH_BYTES);
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_sequence(dfcgs_reader *r, dfcgs_sequence *sequence) {
    uint64_t num_frames;
    memset(sequence, 0, sizeof *sequence);
    DFCGS_TRY(read_version(r));
    DFCGS_TRY(dfcgs_enum(r, DFCGS_NUM_PROFILES, &sequence->profile));
    DFCGS_TRY(read_level(r, sequence));
    DFCGS_TRY(dfcgs_u8_most(r, MAX_SH_DEGREE, &sequence->sh_degree));
    DFCGS_TRY(dfcgs_enum(r, NUM_ORDERS, &sequence->output_order));
    DFCGS_TRY(dfcgs_uvarint_most(r, sequence->limits.max_frames, &num_frames));
    sequence->num_frames = (uint32_t)num_frames;
    DFCGS_TRY(read_frame_rate(r, sequence));
    DFCGS_TRY(read_runs(r, sequence));
    DFCGS_TRY(read_units(r, sequence));
    DFCGS_TRY(read_model(r, sequence));
    sequence->num_attributes = DFCGS_SH_1 + sequence->sh_degree;
    for (int a = 0; a < sequence->num_attributes; a++) sequence->num_columns += dfcgs_columns(a);
    return dfcgs_expect_end(r);
}
