/* 17.3 A column with the prior. */
#ifndef DFCGS_PRIOR_COLUMN_H
#define DFCGS_PRIOR_COLUMN_H

#include "context_model.h"
#include "lod.h"
#include "prior.h"
#include "stream.h"

enum { DFCGS_PRIOR_LEVELS = 5 };

/* `values` [levels->count] at a stride of `columns`, as they lie in a row-major array; `residuals` [count]. A
   value beyond 32 bits is refused: no step allows it. */
dfcgs_status dfcgs_prior_column(dfcgs_stream *s, const dfcgs_levels *levels, const dfcgs_component *component,
                                const dfcgs_table *tables, int columns, int32_t *values, int64_t *residuals);

#endif
