/* 8.4 The whole output of a decoded frame: arrays of floats, in output order. */
#ifndef DFCGS_FRAME_OUTPUT_H
#define DFCGS_FRAME_OUTPUT_H

#include "decoder.h"

enum { DFCGS_NUM_ARRAYS = 6, DFCGS_ALL_ARRAYS = (1 << DFCGS_NUM_ARRAYS) - 1 };

/* Arrays of `count` Gaussians: positions [3], of doubles where the sequence has them, rotations [4], scales
   [3], opacities, sh_dc [3], sh_rest [3][num_rest]; NULL for those that were not asked for. They lie in the
   decoder's arena until its next chunk. */
typedef struct {
    uint32_t count, num_rest;
    void *positions;
    float *rotations, *scales, *opacities, *sh_dc, *sh_rest;
} dfcgs_output;

/* `wanted`: arrays as bits, the first one lowest. A verbatim frame, and one with escapes, is whole or not at
 * all. */
dfcgs_status dfcgs_frame_output(dfcgs_decoder *decoder, int wanted, dfcgs_output *output);

#endif
