/* 11.2 Columns: one integer for each of `count` rows, coded in passes. */
#ifndef DFCGS_COLUMN_H
#define DFCGS_COLUMN_H

#include "lod.h"
#include "side_information.h"
#include "visibility.h"

enum { DFCGS_COLUMN_CONTEXTS = 32, DFCGS_MAX_EARLIER = 48 };

/* Steps of rows by class: step[class[row]]. `class` NULL: all of class 0. */
typedef struct {
    int64_t step[DFCGS_NUM_COARSENESS];
    const uint8_t *class;
} dfcgs_row_steps;

/* What is known before a column begins. `earlier`: residuals [count] of the columns before it, features and,
   by their magnitudes, sources. */
typedef struct {
    dfcgs_levels levels;
    dfcgs_row_steps steps;
    int in_steps, alternating, num_earlier;
    const int32_t *earlier[DFCGS_MAX_EARLIER];
} dfcgs_column_shape;

/* `values` and `residuals` [count]; the latter may be NULL where nobody asks for them. */
dfcgs_status dfcgs_column(dfcgs_stream *s, const dfcgs_column_shape *shape, int32_t *values,
                          int32_t *residuals);

/* A column with step 1, of which nothing is known. */
dfcgs_column_shape dfcgs_plain_column(dfcgs_levels levels);

/* What the symbols of a pass are worth (9.8), refused where one is too large for its step: `worth` [count].
   Row i of the pass is row first + i * stride of all; `wrap`: rows after which they begin again, count or
   half of it. */
dfcgs_status dfcgs_worths(dfcgs_stream *s, const int64_t *symbols, uint32_t count,
                          const dfcgs_row_steps *steps, size_t first, size_t stride, uint32_t wrap,
                          int alternating, int32_t *worth);

#endif
