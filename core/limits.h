/* 18.2 What a file may ask of the machine that decodes it: memory and work, known from headers alone.

   The same estimates as in codec/frame/limits.py, so that both decoders refuse the same files. */
#ifndef DFCGS_LIMITS_H
#define DFCGS_LIMITS_H

#include "headers.h"

enum { DFCGS_LIMIT_GAUSSIANS = 1, DFCGS_LIMIT_MEMORY, DFCGS_LIMIT_BOMB, DFCGS_LIMIT_WORK };

/* What a frame was refused for with DFCGS_RESOURCES: `value` would have been enough. */
typedef struct {
    int32_t kind;
    uint32_t frame, num_gaussians;
    int64_t value;
} dfcgs_excess;

/* `max_gaussians` -1: as many as the bytes read so far pay for. */
typedef struct {
    int64_t max_memory, max_gaussians, bytes, work;
    int columns, has_control;
    dfcgs_control_header control;
    dfcgs_excess excess;
    dfcgs_error *error;
} dfcgs_budget;

void dfcgs_charge_bytes(dfcgs_budget *budget, uint64_t count);
dfcgs_status dfcgs_charge_intra(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                const dfcgs_control_header *control);
dfcgs_status dfcgs_charge_inter(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                const dfcgs_inter_header *header);
dfcgs_status dfcgs_charge_births(dfcgs_budget *budget, uint32_t frame, uint32_t num_births,
                                 uint32_t num_gaussians);
dfcgs_status dfcgs_charge_symbols(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                  uint64_t num_symbols);

#endif
