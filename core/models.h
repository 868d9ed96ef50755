/* 10.4 to 10.6 Models: scale tables, split tables, and models made of weights. */
#ifndef DFCGS_MODELS_H
#define DFCGS_MODELS_H

#include "core.h"

enum {
    DFCGS_FREQUENCY_BITS = 24,
    DFCGS_NUM_SCALES = 160,
    DFCGS_NUM_BASE_SCALES = 64,
    DFCGS_NUM_SHAPES = 3,
    DFCGS_NUM_TABLES = DFCGS_NUM_SHAPES * DFCGS_NUM_SCALES,
    DFCGS_MAX_SPLIT_COUNT = 32,
    DFCGS_NUM_BIASES = 16,
    DFCGS_MAX_MODEL_SIZE = 1023
};
enum { DFCGS_GAUSSIAN, DFCGS_LAPLACE, DFCGS_HEAVY };

/* `cumulative` [size + 1] rises from 0 to 2**24. `start` [256]: the symbol of the quantile s << 16, NULL
   where a search from symbol 0 is as fast. */
typedef struct {
    uint32_t size;
    const uint32_t *cumulative;
    const uint16_t *start;
} dfcgs_model;

/* Integers with a model: symbols less `reach`, whose ends are escapes, and below them `low_bits` raw bits. */
typedef struct {
    const dfcgs_model *model;
    int low_bits;
} dfcgs_table;

/* All models that do not depend on a file. Split models are made when they are first wanted. */
typedef struct {
    dfcgs_model scale[DFCGS_NUM_SHAPES][DFCGS_NUM_BASE_SCALES];
    dfcgs_model split[DFCGS_NUM_BIASES][DFCGS_MAX_SPLIT_COUNT + 1];
} dfcgs_models;

/* Takes what the tables need from the arena. */
dfcgs_status dfcgs_make_models(dfcgs_arena *arena, dfcgs_models *models);

/* The model of how many of `count` (2 to 32) Gaussians lie in one half of a cell; bias 0 to 15. */
const dfcgs_model *dfcgs_split_model(dfcgs_models *models, int bias, int count);

/* What a table index 0 .. DFCGS_NUM_TABLES - 1 stands for. */
dfcgs_table dfcgs_table_of(const dfcgs_models *models, int index);

/* `cumulative` [size + 1] from weights, not all 0, whose sum is below 2**39. */
void dfcgs_from_weights(const int64_t *weights, uint32_t size, uint32_t *cumulative);

/* A model of `cumulative`, which stays where it is; large ones take a start table from the arena. */
dfcgs_status dfcgs_make_model(dfcgs_arena *arena, uint32_t size, const uint32_t *cumulative,
                              dfcgs_model *model);

/* The same from frequencies [size]: DFCGS_MISUSE unless each is at least 1 and all sum to 2**24. */
dfcgs_status dfcgs_model_of(dfcgs_arena *arena, uint32_t size, const int32_t *frequencies,
                            dfcgs_model *model);

#endif
