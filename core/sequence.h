/* 4 The sequence header. */
#ifndef DFCGS_SEQUENCE_H
#define DFCGS_SEQUENCE_H

#include "fields.h"

enum { DFCGS_MAIN, DFCGS_PAPER, DFCGS_NUM_PROFILES };
enum { DFCGS_FLOAT32, DFCGS_FLOAT64, DFCGS_NUM_PRECISIONS };
enum { DFCGS_MAX_MODEL_ID = 64, DFCGS_MODEL_HASH_BYTES = 8, DFCGS_HASH_BYTES = 16 };

/* 18.1 */
typedef struct {
    uint32_t max_gaussians, max_frames, max_control_points;
} dfcgs_level_limits;

typedef struct {
    uint8_t profile, level, sh_degree, output_order, precision;
    int num_attributes, num_columns; /* num_columns: values of a Gaussian */
    uint32_t num_frames;
    int position_exponent, scale_exponent, opacity_exponent, color_exponent;
    int64_t origin[3];
    uint8_t model_id_length;
    uint8_t model_id[DFCGS_MAX_MODEL_ID], model_hash[DFCGS_MODEL_HASH_BYTES];
    dfcgs_level_limits limits;
} dfcgs_sequence;

/* The payload of a SEQUENCE_HEADER chunk. */
dfcgs_status dfcgs_read_sequence(dfcgs_reader *r, dfcgs_sequence *sequence);

#endif
