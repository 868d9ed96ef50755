#include "side_information.h"

enum {
    MAX_WEIGHT = 4096,
    NO_WEIGHTS = 64,
    ABSENT_LEVEL = 63,
    EXPECTED_SCALE_RISE = 3,
    FIRST_SCALE = 26,
    LAPLACE_TABLE = DFCGS_LAPLACE * DFCGS_NUM_SCALES,
    SIDE_TABLE_FIRST = LAPLACE_TABLE + 50,
    SIDE_TABLE_SCALE = LAPLACE_TABLE + 26,
    SIDE_TABLE_SHAPE = LAPLACE_TABLE + 18
};
static const int64_t QUARTER_OCTAVES[4] = {256, 304, 362, 431};

dfcgs_status dfcgs_read_weights(dfcgs_stream *s, uint32_t count, int64_t *weights) {
    uint64_t index;
    DFCGS_TRY(dfcgs_count_value(s, NO_WEIGHTS, &index));
    if (index == NO_WEIGHTS) {
        memset(weights, 0, count * sizeof *weights);
        return DFCGS_OK;
    }
    DFCGS_TRY(dfcgs_flat(s, LAPLACE_TABLE + (int)index, count, weights));
    for (uint32_t i = 0; i < count; i++)
        if (weights[i] < -MAX_WEIGHT || weights[i] > MAX_WEIGHT)
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a prediction weight is out of range");
    return DFCGS_OK;
}

/* The tables of `count` contexts from what was read of them. */
static dfcgs_status tables_from_steps(dfcgs_stream *s, const int64_t *shape_steps, const int64_t *scale_steps,
                                      int count, dfcgs_table *tables) {
    int64_t shape = DFCGS_LAPLACE, scale = FIRST_SCALE - EXPECTED_SCALE_RISE;
    for (int j = 0; j < count; j++) {
        shape += shape_steps[j];
        scale += scale_steps[j] + EXPECTED_SCALE_RISE;
        if (shape < 0 || shape >= DFCGS_NUM_SHAPES || scale < 0 || scale >= DFCGS_NUM_SCALES)
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a table index is out of range");
        tables[j] = dfcgs_table_of(s->models, (int)(shape * DFCGS_NUM_SCALES + scale));
    }
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_tables(dfcgs_stream *s, int num_contexts, dfcgs_table *tables) {
    uint64_t first, count;
    int64_t shape_steps[DFCGS_MAX_CONTEXTS], scale_steps[DFCGS_MAX_CONTEXTS];
    DFCGS_TRY(dfcgs_count_value(s, (uint64_t)num_contexts - 1, &first));
    DFCGS_TRY(dfcgs_count_value(s, (uint64_t)num_contexts - 1 - first, &count));
    count++;
    DFCGS_TRY(dfcgs_flat(s, SIDE_TABLE_SHAPE, (uint32_t)count, shape_steps));
    DFCGS_TRY(dfcgs_flat(s, SIDE_TABLE_FIRST, 1, scale_steps));
    DFCGS_TRY(dfcgs_flat(s, SIDE_TABLE_SCALE, (uint32_t)count - 1, scale_steps + 1));
    for (int c = 0; c < num_contexts; c++) tables[c] = dfcgs_table_of(s->models, SIDE_TABLE_SCALE);
    return tables_from_steps(s, shape_steps, scale_steps, (int)count, tables + first);
}

/* Weights of a context's symbols; `level` runs on. */
static dfcgs_status levels_to_weights(dfcgs_stream *s, const int64_t *steps, uint32_t size, int64_t *level,
                                      int64_t *weights) {
    int64_t any = 0;
    for (uint32_t i = 0; i < size; i++) {
        *level += steps[i];
        if (*level < 0 || *level > ABSENT_LEVEL)
            return dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a histogram level is out of range");
        int64_t down = ABSENT_LEVEL - 1 - *level;
        weights[i] = down < 0 ? 0 : QUARTER_OCTAVES[down % 4] << (down / 4);
        any |= weights[i];
    }
    return any ? DFCGS_OK : dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a histogram is empty");
}

dfcgs_status dfcgs_read_histograms(dfcgs_stream *s, const uint8_t *used, int num_contexts, uint32_t size,
                                   dfcgs_model *models) {
    uint32_t num_used = 0, *cumulative;
    uint64_t index;
    int64_t *steps, *weights, level = 0;
    for (int c = 0; c < num_contexts; c++) num_used += used[c];
    DFCGS_GET(steps, s->arena, int64_t, (size_t)size *num_used);
    DFCGS_GET(weights, s->arena, int64_t, size);
    DFCGS_TRY(dfcgs_count_value(s, ABSENT_LEVEL, &index));
    DFCGS_TRY(dfcgs_flat(s, LAPLACE_TABLE + (int)index, size * num_used, steps));
    for (int c = 0; c < num_contexts; c++) {
        if (!used[c]) continue;
        DFCGS_GET(cumulative, s->arena, uint32_t, (size_t)size + 1);
        DFCGS_TRY(levels_to_weights(s, steps, size, &level, weights));
        dfcgs_from_weights(weights, size, cumulative);
        DFCGS_TRY(dfcgs_make_model(s->arena, size, cumulative, &models[c]));
        steps += size;
    }
    return DFCGS_OK;
}

void dfcgs_occurring(const uint8_t *contexts, uint32_t count, int num_contexts, uint8_t *used) {
    memset(used, 0, (size_t)num_contexts);
    for (uint32_t i = 0; i < count; i++) used[contexts[i]] = 1;
}
