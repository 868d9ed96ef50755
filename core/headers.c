#include "headers.h"

#include "nearness.h"

enum {
    MAX_CONTROL_SHIFT = 31,
    MAX_SORT_BITS = 21,
    MAX_SORT_SHIFT = 31,
    MAX_COARSE_LOG2 = 8,
    MAX_THIN_OCTAVES = 8,
    MAX_THIN_EXPONENT = -11,
    MAX_TURN_STEP = 1 << 18,
    NUM_TOOLS = 6,
    LEAST_ESCAPE_BYTES = 6
};

static dfcgs_status read_hash(dfcgs_reader *r, uint8_t *hash) {
    const uint8_t *bytes;
    DFCGS_TRY(dfcgs_raw(r, DFCGS_HASH_BYTES, &bytes));
    memcpy(hash, bytes, DFCGS_HASH_BYTES);
    return DFCGS_OK;
}

/* Attributes of the sequence as bits. */
static int mask_of(const dfcgs_sequence *sequence) { return (1 << sequence->num_attributes) - 1; }

static dfcgs_status read_steps(dfcgs_reader *r, int mask, int32_t *steps) {
    for (int a = 0; a < DFCGS_MAX_ATTRIBUTES; a++)
        if (mask >> a & 1) DFCGS_TRY(dfcgs_step_field(r, &steps[a]));
    return DFCGS_OK;
}

static dfcgs_status read_levels(dfcgs_reader *r, int mask, int32_t *levels) {
    int64_t level;
    for (int a = 0; a < DFCGS_MAX_ATTRIBUTES; a++) {
        if (!(mask >> a & 1)) continue;
        DFCGS_TRY(dfcgs_svarints_within(r, 1, DFCGS_STATE_LIMIT, &level));
        levels[a] = (int32_t)level;
    }
    return DFCGS_OK;
}

static dfcgs_status read_grid(dfcgs_reader *r, dfcgs_sort_grid *grid) {
    uint8_t shift, bits, has_excess;
    int64_t origin[3];
    DFCGS_TRY(dfcgs_u8_most(r, MAX_SORT_SHIFT, &shift));
    DFCGS_TRY(dfcgs_u8_most(r, MAX_SORT_BITS, &bits));
    DFCGS_TRY(dfcgs_svarints_within(r, 3, DFCGS_STATE_LIMIT, origin));
    DFCGS_TRY(dfcgs_u8_most(r, 1, &has_excess));
    *grid = (dfcgs_sort_grid){
        shift, bits, has_excess, {(int32_t)origin[0], (int32_t)origin[1], (int32_t)origin[2]}};
    return DFCGS_OK;
}

static dfcgs_status read_coding(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_intra_coding *coding) {
    uint8_t coarse_log2, thin_octaves, alternating;
    int mask = mask_of(sequence);
    DFCGS_TRY(read_grid(r, &coding->grid));
    DFCGS_TRY(read_steps(r, mask, coding->steps));
    DFCGS_TRY(dfcgs_u8_most(r, MAX_COARSE_LOG2, &coarse_log2));
    DFCGS_TRY(read_levels(r, mask, coding->levels));
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8_most(r, MAX_THIN_OCTAVES, &thin_octaves));
    if (thin_octaves && sequence->scale_exponent > MAX_THIN_EXPONENT)
        return dfcgs_corrupt(r->error, offset, "thin axes on a grid as coarse as octaves");
    offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, &alternating));
    if (alternating & ~(mask & ~(1 << DFCGS_POSITION)))
        return dfcgs_corrupt(r->error, offset, "alternating names unknown attributes");
    coding->coarse_log2 = coarse_log2;
    coding->thin_octaves = thin_octaves;
    coding->alternating = alternating;
    return DFCGS_OK;
}

uint32_t dfcgs_wanted_points(uint32_t count, const dfcgs_control_header *control) {
    return (uint32_t)dfcgs_clip(count / (uint32_t)control->spacing, 1, DFCGS_MAX_CONTROL_POINTS);
}

static dfcgs_status read_control(dfcgs_reader *r, const dfcgs_sequence *sequence, uint32_t count,
                                 dfcgs_control_header *control) {
    int64_t offset = dfcgs_offset(r);
    uint8_t shift;
    DFCGS_TRY(dfcgs_step_field(r, &control->spacing));
    DFCGS_TRY(dfcgs_u8_most(r, MAX_CONTROL_SHIFT, &shift));
    control->shift = shift;
    if (dfcgs_wanted_points(count, control) <= sequence->limits.max_control_points) return DFCGS_OK;
    return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "too many control points");
}

static dfcgs_status read_escape_flag(dfcgs_reader *r, dfcgs_intra_header *header) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8_most(r, 1, &header->has_escapes));
    if (header->has_escapes && header->kind == DFCGS_PLY)
        return dfcgs_corrupt(r->error, offset, "escapes in a verbatim I-frame");
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_intra(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_intra_header *header) {
    uint64_t count;
    memset(header, 0, sizeof *header);
    header->control.spacing = 1;
    DFCGS_TRY(read_hash(r, header->hash));
    DFCGS_TRY(dfcgs_enum(r, DFCGS_NUM_KINDS, &header->kind));
    DFCGS_TRY(dfcgs_uvarint_most(r, sequence->limits.max_gaussians, &count));
    header->num_gaussians = (uint32_t)count;
    if (count == 0) return DFCGS_OK;
    DFCGS_TRY(dfcgs_u8_most(r, 1, &header->has_permutation));
    DFCGS_TRY(read_escape_flag(r, header));
    DFCGS_TRY(read_control(r, sequence, header->num_gaussians, &header->control));
    if (header->kind == DFCGS_CODED) DFCGS_TRY(read_coding(r, sequence, &header->coding));
    header->num_streams =
        sequence->num_attributes + 2 * (header->kind == DFCGS_CODED) + header->has_permutation;
    return DFCGS_OK;
}

static dfcgs_status read_tools(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_inter_header *header) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, &header->tools));
    if (header->tools >> NUM_TOOLS)
        return dfcgs_refuse(r->error, DFCGS_UNSUPPORTED, offset, "unknown tools: a newer decoder is needed");
    offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, &header->mask));
    if (header->mask & ~mask_of(sequence))
        return dfcgs_corrupt(r->error, offset, "attribute_mask names unknown attributes");
    if (!header->mask && header->tools & DFCGS_VISIBILITY)
        return dfcgs_corrupt(r->error, offset, "VISIBILITY without attributes");
    if (header->tools & ~DFCGS_MAIN_TOOLS)
        return dfcgs_corrupt(r->error, offset, "tools that the profile does not have");
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_inter(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_inter_header *header) {
    memset(header, 0, sizeof *header);
    DFCGS_TRY(read_hash(r, header->hash));
    DFCGS_TRY(read_tools(r, sequence, header));
    DFCGS_TRY(read_steps(r, header->mask, header->steps));
    return header->tools & DFCGS_VISIBILITY ? read_levels(r, header->mask, header->levels) : DFCGS_OK;
}

dfcgs_status dfcgs_read_topology(dfcgs_reader *r, const dfcgs_sequence *sequence, uint32_t num_gaussians,
                                 dfcgs_topology_header *header) {
    uint64_t removals, births, limit = sequence->limits.max_gaussians;
    int64_t offset = dfcgs_offset(r);
    memset(header, 0, sizeof *header);
    DFCGS_TRY(dfcgs_uvarint_most(r, limit, &removals));
    DFCGS_TRY(dfcgs_u8_most(r, 1, &header->has_permutation));
    DFCGS_TRY(dfcgs_uvarint_most(r, limit, &births));
    if (births) DFCGS_TRY(read_coding(r, sequence, &header->coding));
    if (removals >= num_gaussians)
        return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "more Gaussians go than there are");
    if (num_gaussians - removals + births > limit)
        return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "too many Gaussians");
    header->num_removals = (uint32_t)removals;
    header->num_births = (uint32_t)births;
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_motion(dfcgs_reader *r, dfcgs_motion_header *header) {
    uint64_t turn_step;
    DFCGS_TRY(dfcgs_step_field(r, &header->translation_step));
    DFCGS_TRY(dfcgs_uvarint_most(r, MAX_TURN_STEP, &turn_step));
    header->turn_step = (int32_t)turn_step;
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_lengths(dfcgs_reader *r, int count, uint64_t *lengths) {
    for (int i = 0; i < count; i++) DFCGS_TRY(dfcgs_uvarint(r, &lengths[i]));
    return DFCGS_OK;
}

/* --- 13
 * ----------------------------------------------------------------------------------------------------------
 */

static dfcgs_status read_escape_rows(dfcgs_reader *r, int64_t offset, uint32_t num_gaussians, uint64_t count,
                                     uint32_t *rows) {
    uint64_t row = 0, delta;
    for (uint64_t i = 0; i < count; i++) {
        DFCGS_TRY(dfcgs_uvarint(r, &delta));
        if (delta >= num_gaussians || (row += delta) >= num_gaussians)
            return dfcgs_corrupt(r->error, offset, "an escape of a Gaussian that is not there");
        rows[i] = (uint32_t)row;
    }
    return DFCGS_OK;
}

static dfcgs_status check_columns(dfcgs_reader *r, int64_t offset, int num_columns, uint64_t count,
                                  const uint32_t *rows, const uint8_t *columns) {
    for (uint64_t i = 0; i < count; i++) {
        int rises =
            i == 0 || rows[i - 1] < rows[i] || (rows[i - 1] == rows[i] && columns[i - 1] < columns[i]);
        if (columns[i] >= num_columns || !rises)
            return dfcgs_corrupt(r->error, offset, "escapes out of order, or of no attribute");
    }
    return DFCGS_OK;
}

dfcgs_status dfcgs_check_escapes(dfcgs_arena *arena, dfcgs_reader *r, const dfcgs_sequence *sequence,
                                 uint32_t num_gaussians, uint64_t *count) {
    int64_t offset = dfcgs_offset(r);
    const uint8_t *columns, *pattern;
    uint32_t *rows;
    size_t mark = arena->used;
    DFCGS_TRY(dfcgs_uvarint_most(r, dfcgs_left(r) / LEAST_ESCAPE_BYTES, count));
    DFCGS_GET(rows, arena, uint32_t, (size_t)*count);
    DFCGS_TRY(read_escape_rows(r, offset, num_gaussians, *count, rows));
    DFCGS_TRY(dfcgs_raw(r, *count, &columns));
    DFCGS_TRY(check_columns(r, offset, sequence->num_columns, *count, rows, columns));
    for (uint64_t i = 0; i < *count; i++) {
        int is_double = columns[i] < 3 && sequence->precision == DFCGS_FLOAT64;
        DFCGS_TRY(dfcgs_raw(r, is_double ? 8 : 4, &pattern));
    }
    arena->used = mark;
    return dfcgs_expect_end(r);
}
