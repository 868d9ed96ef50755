#include "context_model.h"

#include "prior.h"

enum { EXPLICIT_SIZE = 2 * DFCGS_EXPLICIT_REACH + 1, MAX_WEIGHT = 4096, NUM_FLAG_INPUTS = 2 };

/* Words that are left. */
typedef struct {
    dfcgs_arena *arena;
    const dfcgs_models *models;
    const int32_t *words;
    uint32_t left;
} words;

static const int32_t *next_words(words *w, uint32_t count) {
    const int32_t *found = w->words;
    if (count > w->left) return NULL;
    w->words += count;
    w->left -= count;
    return found;
}

static dfcgs_status next_network(words *w, int num_common, int num_others, int num_classes,
                                 dfcgs_network *network) {
    uint32_t used;
    DFCGS_TRY(
        dfcgs_read_network(w->arena, w->words, w->left, num_common, num_others, num_classes, network, &used));
    next_words(w, used);
    return DFCGS_OK;
}

/* `count` models of `size` symbols each. */
static dfcgs_status next_models(words *w, uint32_t count, uint32_t size, dfcgs_model *models) {
    for (uint32_t i = 0; i < count; i++) {
        const int32_t *frequencies = next_words(w, size);
        if (!frequencies) return DFCGS_MODEL;
        dfcgs_status status = dfcgs_model_of(w->arena, size, frequencies, &models[i]);
        if (status != DFCGS_OK) return status == DFCGS_MISUSE ? DFCGS_MODEL : status;
    }
    return DFCGS_OK;
}

/* Tables by index, or -1 - i for rows[i]. */
static dfcgs_status find_tables(words *w, const int32_t *indices, uint32_t count, const dfcgs_model *rows,
                                uint32_t num_rows, dfcgs_table *tables) {
    for (uint32_t i = 0; i < count; i++) {
        int64_t index = indices[i];
        if (index < -(int64_t)num_rows || index >= DFCGS_NUM_TABLES) return DFCGS_MODEL;
        tables[i] = index < 0 ? (dfcgs_table){&rows[-1 - index], 0} : dfcgs_table_of(w->models, (int)index);
    }
    return DFCGS_OK;
}

static dfcgs_status next_tables(words *w, dfcgs_symbol_part *part) {
    const int32_t *indices = next_words(w, DFCGS_NUM_CELLS), *num_rows = next_words(w, 1);
    dfcgs_model *rows;
    if (!indices || !num_rows || *num_rows < 0 || (uint32_t)*num_rows > w->left / EXPLICIT_SIZE)
        return DFCGS_MODEL;
    DFCGS_GET(rows, w->arena, dfcgs_model, (size_t)*num_rows);
    DFCGS_TRY(next_models(w, (uint32_t)*num_rows, EXPLICIT_SIZE, rows));
    return find_tables(w, indices, DFCGS_NUM_CELLS, rows, (uint32_t)*num_rows, part->tables);
}

static dfcgs_status next_weights(words *w, dfcgs_context_model *model) {
    const int32_t *weights = next_words(w, DFCGS_CONTROL_COLUMNS * DFCGS_CONTROL_WEIGHTS);
    if (!weights) return DFCGS_MODEL;
    for (int i = 0; i < DFCGS_CONTROL_COLUMNS * DFCGS_CONTROL_WEIGHTS; i++)
        if (weights[i] < -MAX_WEIGHT || weights[i] > MAX_WEIGHT) return DFCGS_MODEL;
    memcpy(model->control_weights, weights, sizeof model->control_weights);
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_context_model(dfcgs_arena *arena, const dfcgs_models *models, const int32_t *all,
                                      uint32_t count, dfcgs_context_model *model) {
    words w = {arena, models, all, count};
    DFCGS_TRY(next_network(&w, DFCGS_NUM_COMMON, NUM_FLAG_INPUTS, DFCGS_NUM_FLAG_CLASSES, &model->flags));
    DFCGS_TRY(
        next_network(&w, DFCGS_NUM_COMMON, DFCGS_NUM_OTHERS, DFCGS_NUM_CLASSES, &model->columns.network));
    DFCGS_TRY(next_network(&w, DFCGS_NUM_CONTROL_COMMON, DFCGS_NUM_OTHERS, DFCGS_NUM_CLASSES,
                           &model->control.network));
    DFCGS_TRY(next_models(&w, DFCGS_NUM_FLAG_CLASSES, 2, model->flag_models));
    DFCGS_TRY(
        next_models(&w, DFCGS_NUM_DENSITIES * DFCGS_NUM_DENSITIES, DFCGS_NUM_DENSITIES, model->densities));
    const int32_t *magnitudes = next_words(&w, 2 * DFCGS_NUM_DENSITIES);
    if (!magnitudes) return DFCGS_MODEL;
    DFCGS_TRY(find_tables(&w, magnitudes, 2 * DFCGS_NUM_DENSITIES, NULL, 0, model->magnitudes));
    DFCGS_TRY(next_weights(&w, model));
    DFCGS_TRY(next_tables(&w, &model->columns));
    DFCGS_TRY(next_tables(&w, &model->control));
    return w.left ? DFCGS_MODEL : DFCGS_OK;
}
