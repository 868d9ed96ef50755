/* 8.4 The whole output of a decoded frame: arrays of floats, in output order. */
#ifndef DFCGS_FRAME_OUTPUT_H
#define DFCGS_FRAME_OUTPUT_H

#include "decoder.h"

/* Arrays of `count` Gaussians: positions [3], of doubles where the sequence has them, rotations [4], scales [3], opacities,
   sh_dc [3], sh_rest [3][num_rest]. They lie in the decoder's arena until its next chunk. */
typedef struct {
    uint32_t count, num_rest;
    void *positions;
    float *rotations, *scales, *opacities, *sh_dc, *sh_rest;
} dfcgs_output;

dfcgs_status dfcgs_frame_output(dfcgs_decoder *decoder, dfcgs_output *output);

#endif
