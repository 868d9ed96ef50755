/* 3 Chunks, 3.2 their order: the frames of a file that lies in memory as a whole. */
#ifndef DFCGS_CONTAINER_H
#define DFCGS_CONTAINER_H

#include "decoder.h"

typedef struct {
    dfcgs_reader reader;
    uint32_t num_frames; /* frames decoded so far */
    int has_ended;
} dfcgs_file;

/* Checks the magic number and reads the sequence header; the decoder was opened with the model of
   `model_hash`. The file's bytes stay the caller's. Limits of the decoder's budget may be set then. */
dfcgs_status dfcgs_open_file(dfcgs_file *file, dfcgs_decoder *decoder, const uint8_t *data, size_t size,
                             const uint8_t model_hash[DFCGS_MODEL_HASH_BYTES]);
/* Decodes the next frame; `*is_there` 0 behind the last one, when the file was right to its end. */
dfcgs_status dfcgs_next_frame(dfcgs_file *file, dfcgs_decoder *decoder, int *is_there);

#endif
