#include "motion.h"

enum {
    MATRIX_BITS = 20,
    ENTRY_SHIFT = 27,
    WEIGHT_BITS = 12,
    EFFORT_BITS = 4,
    DECAY_LOG2 = 2,
    EFFORT_STEPS = 4
};
enum {
    BLEND_ADVANTAGE = 16,
    MAX_EFFORT_CLASS = 64,
    MEMORY_BITS = 4,
    EFFORT_SHIFT = 4
};
enum { INPUT_LIMIT = 255 };

dfcgs_status dfcgs_take_field(dfcgs_arena *arena, uint32_t count, dfcgs_field *field) {
    size_t triples = 3 * (size_t)count;
    *field = (dfcgs_field){.count = count};
    field->pivots = DFCGS_ZEROS(arena, int32_t, triples);
    field->translations = DFCGS_ZEROS(arena, int32_t, triples);
    field->vectors = DFCGS_ZEROS(arena, int32_t, triples);
    field->translation_habits = DFCGS_ZEROS(arena, int64_t, triples);
    field->turn_habits = DFCGS_ZEROS(arena, int64_t, triples);
    field->bindings = DFCGS_ZEROS(arena, dfcgs_binding, count);
    field->table = DFCGS_ZEROS(arena, int64_t, DFCGS_TABLE_COLUMNS *(size_t)count);
    int whole = field->pivots && field->translations && field->vectors && field->translation_habits &&
                field->turn_habits && field->bindings && field->table;
    return whole ? DFCGS_OK : DFCGS_MEMORY;
}

dfcgs_status dfcgs_bind_levels(dfcgs_arena *arena, const int32_t *cells, dfcgs_field *field) {
    for (uint32_t start = dfcgs_level_end(0, field->count); start < field->count;) {
        uint32_t end = dfcgs_level_end(start, field->count);
        DFCGS_TRY(dfcgs_gather(arena, cells + 3 * (size_t)start, end - start, cells, start,
                               field->bindings + start));
        start = end;
    }
    return DFCGS_OK;
}

/* --- 14.4
 * ---------------------------------------------------------------------------------------------------- */

static int64_t entry(int64_t product) { return dfcgs_round_shift(product, ENTRY_SHIFT); }

static void matrix(const int32_t *vector, int64_t m[9]) {
    int64_t p[3] = {vector[0], vector[1], vector[2]}, q[4];
    dfcgs_from_stereo(p, q);
    int64_t w = q[0], x = q[1], y = q[2], z = q[3];
    m[0] = entry(-(y * y + z * z)), m[1] = entry(x * y - w * z), m[2] = entry(x * z + w * y);
    m[3] = entry(x * y + w * z), m[4] = entry(-(x * x + z * z)), m[5] = entry(y * z - w * x);
    m[6] = entry(x * z - w * y), m[7] = entry(y * z + w * x), m[8] = entry(-(x * x + y * y));
}

/* What control point k does to positions: row . x + added, for each axis. */
static void fill_table(dfcgs_field *field, uint32_t k) {
    const int32_t *pivot = field->pivots + 3 * (size_t)k, *translation = field->translations + 3 * (size_t)k;
    int64_t m[9], *row = field->table + DFCGS_TABLE_COLUMNS * (size_t)k;
    matrix(field->vectors + 3 * (size_t)k, m);
    for (int a = 0; a < 3; a++, row += 4) {
        const int64_t *of = m + 3 * a;
        row[0] = of[0], row[1] = of[1], row[2] = of[2];
        row[3] = (int64_t)translation[a] * (1 << MATRIX_BITS) - of[0] * pivot[0] - of[1] * pivot[1] -
                 of[2] * pivot[2];
    }
}

static void displace(const dfcgs_field *field, uint32_t k, const int32_t *at, int64_t moved[3]) {
    const int64_t *row = field->table + DFCGS_TABLE_COLUMNS * (size_t)k;
    for (int a = 0; a < 3; a++, row += 4)
        moved[a] = dfcgs_round_shift(row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3], MATRIX_BITS);
}

static void blend(const dfcgs_binding *binding, int64_t values[DFCGS_NUM_CANDIDATES][3]) {
    for (int a = 0; a < 3; a++) {
        int64_t total = 0;
        for (int k = 0; k < DFCGS_NUM_GATHERED; k++) total += binding->weight[k] * values[1 + k][a];
        values[DFCGS_BLEND][a] = dfcgs_round_shift(total, WEIGHT_BITS);
    }
}

/* What each of a point's candidates does to it. */
static void displacements(const dfcgs_field *field, const dfcgs_binding *binding, const int32_t *at,
                          int64_t moved[DFCGS_NUM_CANDIDATES][3]) {
    for (int k = 0; k < DFCGS_NUM_GATHERED; k++) displace(field, binding->rank[k], at, moved[1 + k]);
    blend(binding, moved);
}

/* What its choice does. */
static void chosen_displacement(const dfcgs_field *field, const dfcgs_binding *binding, const int32_t *at,
                                int64_t moved[3]) {
    int64_t all[DFCGS_NUM_CANDIDATES][3];
    if (binding->choice != DFCGS_BLEND) {
        displace(field, binding->rank[binding->choice - 1], at, moved);
        return;
    }
    displacements(field, binding, at, all);
    memcpy(moved, all[DFCGS_BLEND], sizeof all[0]);
}

static void chosen_turn(const dfcgs_field *field, const dfcgs_binding *binding, int64_t turn[3]) {
    int64_t all[DFCGS_NUM_CANDIDATES][3];
    for (int k = 0; k < DFCGS_NUM_GATHERED; k++)
        for (int a = 0; a < 3; a++) all[1 + k][a] = field->vectors[3 * (size_t)binding->rank[k] + (size_t)a];
    if (binding->choice == DFCGS_BLEND) blend(binding, all);
    memcpy(turn, all[binding->choice], sizeof all[0]);
}

static int too_large(const int32_t *symbols, int step) {
    int64_t limit = 2 * (int64_t)DFCGS_STATE_LIMIT / step;
    for (int a = 0; a < 3; a++)
        if (dfcgs_abs(symbols[a]) > limit) return 1;
    return 0;
}

static dfcgs_status move_point(dfcgs_field *field, uint32_t k, const int32_t *symbols, int translation_step,
                               int turn_step) {
    int64_t expected[3] = {0, 0, 0}, turn[3] = {0, 0, 0}, most = 2 * (int64_t)DFCGS_STATE_LIMIT;
    int32_t *translation = field->translations + 3 * (size_t)k, *vector = field->vectors + 3 * (size_t)k;
    if (too_large(symbols, translation_step) || (turn_step > 0 && too_large(symbols + 3, turn_step)))
        return DFCGS_CORRUPT;
    if (k > 0) {
        chosen_displacement(field, field->bindings + k, field->pivots + 3 * (size_t)k, expected);
        chosen_turn(field, field->bindings + k, turn);
    }
    for (int a = 0; a < 3; a++) {
        int64_t moved = expected[a] + (int64_t)symbols[a] * translation_step;
        int64_t turned = turn[a] + (int64_t)symbols[3 + a] * turn_step;
        translation[a] = (int32_t)dfcgs_clip(moved, -most, most);
        vector[a] = turn_step > 0 ? (int32_t)dfcgs_clip(turned, -DFCGS_STEREO_ONE, DFCGS_STEREO_ONE) : 0;
    }
    fill_table(field, k);
    return DFCGS_OK;
}

/* Coarse to fine: a control point is bound to those of earlier levels, which come before it. */
dfcgs_status dfcgs_move_field(dfcgs_field *field, const int32_t *symbols, int translation_step,
                              int turn_step) {
    for (uint32_t k = 0; k < field->count; k++)
        DFCGS_TRY(
            move_point(field, k, symbols + DFCGS_MOTION_COLUMNS * (size_t)k, translation_step, turn_step));
    return DFCGS_OK;
}

/* --- 14.5
 * ---------------------------------------------------------------------------------------------------- */

static void turn_from_left(const int64_t turn[3], int32_t *rotation) {
    int64_t by[4], q[4] = {rotation[0], rotation[1], rotation[2], rotation[3]};
    dfcgs_from_stereo(turn, by);
    dfcgs_multiply(by, q, q);
    dfcgs_normalise(q);
    for (int c = 0; c < 4; c++) rotation[c] = (int32_t)q[c];
}

void dfcgs_turn_all(const int32_t *vectors, uint32_t count, int32_t *rotations) {
    for (uint32_t i = 0; i < count; i++, vectors += 3, rotations += 4) {
        int64_t turn[3] = {vectors[0], vectors[1], vectors[2]};
        if (turn[0] | turn[1] | turn[2]) turn_from_left(turn, rotations);
    }
}

void dfcgs_carry(const dfcgs_field *field, const dfcgs_binding *bindings, const uint8_t *follows,
                 uint32_t count, int turns, int32_t *positions, int32_t *rotations) {
    for (uint32_t i = 0; i < count; i++, positions += 3) {
        if (!follows[i]) continue;
        int64_t moved[3], turn[3];
        chosen_displacement(field, bindings + i, positions, moved);
        for (int a = 0; a < 3; a++)
            positions[a] =
                (int32_t)dfcgs_clip(positions[a] + moved[a], -DFCGS_STATE_LIMIT, DFCGS_STATE_LIMIT);
        if (!turns) continue;
        chosen_turn(field, bindings + i, turn);
        if (turn[0] | turn[1] | turn[2]) turn_from_left(turn, rotations + 4 * (size_t)i);
    }
}

/* --- 14.6
 * ---------------------------------------------------------------------------------------------------- */

static void learn_point(dfcgs_binding *binding, int64_t moved[DFCGS_NUM_CANDIDATES][3],
                        const int64_t actual[3], int64_t unit) {
    int best = 0, least = 0;
    for (int j = 0; j < DFCGS_NUM_CANDIDATES; j++) {
        int64_t error = 0;
        for (int a = 0; a < 3; a++) error += dfcgs_abs(moved[j][a] - actual[a]);
        int effort = binding->effort[j] - (binding->effort[j] >> DECAY_LOG2);
        if (error >= unit)
            effort += dfcgs_ladder(dfcgs_quotient(error, unit), MAX_EFFORT_CLASS) << EFFORT_BITS;
        binding->effort[j] = (int16_t)effort;
        int judged = j == DFCGS_BLEND ? effort - BLEND_ADVANTAGE : effort;
        if (j == 0 || judged < least) best = j, least = judged;
    }
    binding->choice = (uint16_t)best;
}

void dfcgs_learn(const dfcgs_field *field, dfcgs_binding *bindings, const uint8_t *follows, uint32_t count,
                 const int32_t *reference, const int32_t *decoded, int translation_step) {
    int64_t unit = EFFORT_STEPS * (int64_t)translation_step;
    for (uint32_t i = 0; i < count; i++, reference += 3, decoded += 3) {
        if (!follows[i]) continue;
        int64_t moved[DFCGS_NUM_CANDIDATES][3], actual[3];
        displacements(field, bindings + i, reference, moved);
        for (int a = 0; a < 3; a++) actual[a] = (int64_t)decoded[a] - reference[a];
        learn_point(bindings + i, moved, actual, unit);
    }
}

static void learn_control(dfcgs_field *field, uint32_t k, int64_t unit) {
    dfcgs_binding *binding = field->bindings + k;
    size_t at = 3 * (size_t)k;
    int64_t moved[DFCGS_NUM_CANDIDATES][3] = {{0}}, turn[3] = {0, 0, 0}, actual[3];
    for (int a = 0; a < 3; a++) actual[a] = field->translations[at + (size_t)a];
    if (k > 0) {
        displacements(field, binding, field->pivots + at, moved);
        learn_point(binding, moved, actual, unit);
        chosen_turn(field, binding, turn);
    }
    for (int a = 0; a < 3; a++) {
        field->translation_habits[at + (size_t)a] = actual[a] - moved[k > 0 ? binding->choice : 0][a];
        field->turn_habits[at + (size_t)a] = field->vectors[at + (size_t)a] - turn[a];
    }
}

void dfcgs_learn_field(dfcgs_field *field, int translation_step) {
    for (uint32_t k = 0; k < field->count; k++)
        learn_control(field, k, EFFORT_STEPS * (int64_t)translation_step);
    for (size_t i = 0; i < 3 * (size_t)field->count; i++)
        field->pivots[i] = (int32_t)dfcgs_clip((int64_t)field->pivots[i] + field->translations[i],
                                               -DFCGS_STATE_LIMIT, DFCGS_STATE_LIMIT);
}

/* --- 14.3
 * ---------------------------------------------------------------------------------------------------- */

static uint8_t limited(int value) { return (uint8_t)(value < INPUT_LIMIT ? value : INPUT_LIMIT); }

static void effort_inputs(const dfcgs_binding *binding, uint8_t *x) {
    int low = INT16_MAX, high = 0;
    for (int j = 0; j < DFCGS_NUM_CANDIDATES; j++) {
        int effort = binding->effort[j] >> EFFORT_SHIFT;
        low = effort < low ? effort : low;
        high = effort > high ? effort : high;
    }
    x[2] = limited(binding->effort[binding->choice] >> EFFORT_SHIFT);
    x[3] = limited(high - low);
}

static int64_t expect(const int64_t *habits, int step, int64_t *changes) {
    int64_t size = 0;
    for (int a = 0; a < 3; a++) {
        changes[a] = step > 0 ? dfcgs_floor_divide(habits[a] * (1 << MEMORY_BITS), step) : 0;
        size += dfcgs_abs(changes[a]);
    }
    return size;
}

void dfcgs_control_inputs(const dfcgs_field *field, const int32_t *before, int translation_step,
                          int turn_step, uint8_t *inputs, int64_t *expected_changes) {
    for (uint32_t k = 0; k < field->count;
         k++, inputs += DFCGS_NUM_CONTROL_INPUTS, expected_changes += 6, before += 6) {
        int64_t size = 0;
        for (int c = 0; c < DFCGS_MOTION_COLUMNS; c++) size += dfcgs_abs(before[c]);
        inputs[0] = dfcgs_log((uint64_t)size);
        size = expect(field->translation_habits + 3 * (size_t)k, translation_step, expected_changes);
        size += expect(field->turn_habits + 3 * (size_t)k, turn_step, expected_changes + 3);
        inputs[1] = dfcgs_log((uint64_t)size);
        inputs[2] = inputs[3] = 0;
        /* the first level has no parents */
        if (k >= dfcgs_level_end(0, field->count)) effort_inputs(field->bindings + k, inputs);
    }
}
