/* 17.1 The frozen prior of profile MAIN: networks, and the models of what they tell apart. */
#ifndef DFCGS_CONTEXT_MODEL_H
#define DFCGS_CONTEXT_MODEL_H

#include "models.h"
#include "network.h"

enum {
    DFCGS_NUM_CLASSES = 40,
    DFCGS_NUM_CELLS = 238,
    DFCGS_NUM_FLAG_CLASSES = 32,
    DFCGS_NUM_DENSITIES = 4,
    DFCGS_CONTROL_COLUMNS = 6,
    DFCGS_CONTROL_WEIGHTS = 8,
    DFCGS_EXPLICIT_REACH = 15
};

/* Tables by cell. */
typedef struct {
    dfcgs_network network;
    dfcgs_table tables[DFCGS_NUM_CELLS];
} dfcgs_symbol_part;

typedef struct {
    dfcgs_network flags;
    dfcgs_model flag_models[DFCGS_NUM_FLAG_CLASSES];
    dfcgs_symbol_part columns, control;
    dfcgs_model densities[DFCGS_NUM_DENSITIES * DFCGS_NUM_DENSITIES];
    dfcgs_table magnitudes[2 * DFCGS_NUM_DENSITIES];
    int32_t control_weights[DFCGS_CONTROL_COLUMNS][DFCGS_CONTROL_WEIGHTS];
} dfcgs_context_model;

/* From `words`: the networks flags, columns and control (network.h), flags.frequencies,
   densities.frequencies, magnitudes.tables, control.weights; then of columns and of control the tables, the
   number of rows, and the rows of frequencies. DFCGS_MODEL for anything else. */
dfcgs_status dfcgs_read_context_model(dfcgs_arena *arena, const dfcgs_models *models, const int32_t *words,
                                      uint32_t count, dfcgs_context_model *model);

#endif
