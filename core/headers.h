/* 5, 6 Headers of frames. */
#ifndef DFCGS_HEADERS_H
#define DFCGS_HEADERS_H

#include "positions.h"
#include "sequence.h"

enum { DFCGS_PLY, DFCGS_CODED, DFCGS_NUM_KINDS };
enum {
    DFCGS_MOTION = 1,
    DFCGS_TOPOLOGY = 2,
    DFCGS_VISIBILITY = 4,
    DFCGS_LATENT = 8,
    DFCGS_REFINEMENT = 16,
    DFCGS_ESCAPE = 32,
    DFCGS_MAIN_TOOLS = DFCGS_MOTION | DFCGS_TOPOLOGY | DFCGS_VISIBILITY | DFCGS_ESCAPE
};
enum { DFCGS_MAX_STREAMS = DFCGS_MAX_ATTRIBUTES + 4 };

/* `sort_shift` to `alternating` of section 5: how Gaussians of an I-frame, or births, are coded. */
typedef struct {
    dfcgs_sort_grid grid;
    int32_t steps[DFCGS_MAX_ATTRIBUTES], levels[DFCGS_MAX_ATTRIBUTES];
    int coarse_log2, thin_octaves, alternating;
} dfcgs_intra_coding;

typedef struct {
    int32_t spacing;
    int shift;
} dfcgs_control_header;

typedef struct {
    uint8_t hash[DFCGS_HASH_BYTES];
    uint8_t kind, has_permutation, has_escapes;
    uint32_t num_gaussians;
    dfcgs_control_header control;
    dfcgs_intra_coding coding;
    int num_streams;
} dfcgs_intra_header;

typedef struct {
    uint8_t hash[DFCGS_HASH_BYTES];
    uint8_t tools, mask;
    int32_t steps[DFCGS_MAX_ATTRIBUTES], levels[DFCGS_MAX_ATTRIBUTES];
} dfcgs_inter_header;

typedef struct {
    uint32_t num_removals, num_births;
    uint8_t has_permutation;
    dfcgs_intra_coding coding;
} dfcgs_topology_header;

typedef struct {
    int32_t translation_step, turn_step;
} dfcgs_motion_header;

/* Control points that are wanted of `count` Gaussians (14.1). */
uint32_t dfcgs_wanted_points(uint32_t count, const dfcgs_control_header *control);

/* Each reads from the beginning of its payload; lengths of streams follow. */
dfcgs_status dfcgs_read_intra(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_intra_header *header);
dfcgs_status dfcgs_read_inter(dfcgs_reader *r, const dfcgs_sequence *sequence, dfcgs_inter_header *header);
/* `num_gaussians`: those of the reference frame. */
dfcgs_status dfcgs_read_topology(dfcgs_reader *r, const dfcgs_sequence *sequence, uint32_t num_gaussians,
                                 dfcgs_topology_header *header);
dfcgs_status dfcgs_read_motion(dfcgs_reader *r, dfcgs_motion_header *header);
dfcgs_status dfcgs_read_lengths(dfcgs_reader *r, int count, uint64_t *lengths);

/* 13: checks an ESCAPES payload for a frame of `num_gaussians`; `count` escapes begin at `fields`. */
dfcgs_status dfcgs_check_escapes(dfcgs_arena *arena, dfcgs_reader *r, const dfcgs_sequence *sequence,
                                 uint32_t num_gaussians, uint64_t *count);

#endif
