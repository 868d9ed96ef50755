/* What the frozen prior is told of Gaussians and symbols (12.1, 12.3), and a pass of a column with it (17.3).
 */
#ifndef DFCGS_PRIOR_H
#define DFCGS_PRIOR_H

#include "exact.h"
#include "motion.h"
#include "network.h"

enum {
    DFCGS_NUM_GAUSSIAN_INPUTS = 5,
    DFCGS_NUM_COMMON = 20,
    DFCGS_NUM_OTHERS = 10,
    DFCGS_NUM_CONTROL_COMMON = 4
};
/* POSITION and ROTATION, whose symbols in the last frame others look at; sorts of attributes */
enum { DFCGS_NUM_EARLIER = 2, DFCGS_NUM_SORTS = 6 };

/* log(size(symbols)) of each row of `symbols` [count][columns]. */
DFCGS_EXPORT void dfcgs_log_sizes(const int32_t *symbols, uint32_t count, int columns, uint8_t *sizes);

/* 12.1: `running` [count] and `memory` [count][columns] after a frame with `symbols` [count][columns]. */
DFCGS_EXPORT void dfcgs_remember(const int32_t *symbols, uint32_t count, int columns, int32_t *running,
                                 int64_t *memory);

/* x[0] .. x[4] of all Gaussians, `inputs` [count][5]. `bindings`: NULL where no frame of the GoF has moved;
   `follows` [count]: NULL where this one does not. */
DFCGS_EXPORT void dfcgs_gaussian_inputs(const dfcgs_binding *bindings, const uint8_t *follows, uint32_t count,
                                        uint8_t *inputs);

/* What x[0] .. x[19] of an attribute are made of. All of N Gaussians, or of their blocks; NULL for what is
 * not there. */
typedef struct {
    const uint8_t *gaussians;                  /* [N][5], see dfcgs_gaussian_inputs */
    const uint8_t *coarseness;                 /* [N] */
    const uint8_t *before;                     /* [N], log sizes of the attribute's symbols before */
    const int32_t *running;                    /* [N] */
    const int64_t *memory;                     /* [N][columns] */
    const uint8_t *density_before;             /* [blocks] */
    const uint8_t *density;                    /* [blocks] */
    const uint8_t *magnitude;                  /* [blocks] */
    const uint8_t *earlier[DFCGS_NUM_EARLIER]; /* [N], log sizes */
    int32_t attribute, columns;
} dfcgs_known;

/* `inputs` [count][20] of the Gaussians `rows` [count]. */
DFCGS_EXPORT void dfcgs_common_inputs(const dfcgs_known *known, const uint32_t *rows, uint32_t count,
                                      uint8_t *inputs);

/* u[3] to u[6] and u[9] of `others` [count][10] of column number `column` of `symbols` [count][columns],
   `before` likewise; all others of u become 0. */
DFCGS_EXPORT void dfcgs_other_inputs(const int32_t *before, const int32_t *symbols, uint32_t count,
                                     int columns, int column, int last_input, uint8_t *others);

/* own[i] += feature[i * stride] * weight. With features in symbols `weight` is 256 times that of 17.3, in
 * sixteenths 16 times. */
DFCGS_EXPORT void dfcgs_add_feature(const int32_t *feature, uint32_t count, uint32_t stride, int weight,
                                    int64_t *own);
DFCGS_EXPORT void dfcgs_add_wide_feature(const int64_t *feature, uint32_t count, uint32_t stride, int weight,
                                         int64_t *own);

/* A column's network and what is known of each of its rows; `kinds` NULL for zeros. */
typedef struct {
    const dfcgs_network *network;
    const int32_t *prepared; /* [count][dfcgs_prepared_width] */
    const uint8_t *others;   /* [count][10], 0 for what a pass finds: u[0] to u[2], u[7], u[8] */
    const uint8_t *kinds;    /* [count] */
    const int64_t *own;      /* [count] */
    int32_t mean_weight;     /* w[0] */
} dfcgs_component;

/* Of the rows first::stride, `rows` of them: the prediction, the context (a cell, 17.1), and whether the
   symbol is flipped. `mean` and `deviation` are the statistics of the level, NULL in the base. */
DFCGS_EXPORT void dfcgs_pass(const dfcgs_component *component, uint32_t first, uint32_t stride, uint32_t rows,
                             const int64_t *mean, const int64_t *deviation, int64_t *predictions,
                             uint8_t *contexts, uint8_t *flipped);

/* 12.4: classes of the flags of `rows` [count], whose inputs were prepared row by row; `mean` [count] of the
   level's statistics of s at each, NULL in the base. */
DFCGS_EXPORT void dfcgs_flag_classes(const dfcgs_network *network, const int32_t *prepared,
                                     const uint32_t *rows, uint32_t count, const int64_t *mean,
                                     uint8_t *classes);

#endif
