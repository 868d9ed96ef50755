/* The decoder of profile MAIN: takes the chunks of a file one after the other and holds the last frame (5,
 * 6, 9.3). */
#ifndef DFCGS_DECODER_H
#define DFCGS_DECODER_H

#include "context_model.h"
#include "gof.h"
#include "intra.h"
#include "limits.h"
#include "streams.h"

/* Chunk types of 3.1. */
enum {
    DFCGS_CHUNK_SEQUENCE = 0x01,
    DFCGS_CHUNK_INTRA = 0x10,
    DFCGS_CHUNK_INTER = 0x20,
    DFCGS_CHUNK_HYPERPRIOR = 0x21,
    DFCGS_CHUNK_MOTION = 0x22,
    DFCGS_CHUNK_TOPOLOGY = 0x23,
    DFCGS_CHUNK_RESIDUAL = 0x24,
    DFCGS_CHUNK_ESCAPES = 0x25,
    DFCGS_CHUNK_INDEX = 0x7E,
    DFCGS_CHUNK_END = 0x7F
};

/* A chunk whose checksum was found right. `offset` of its first byte in the file, `payload_offset` of its
   payload, `size` of all of it. */
typedef struct {
    int type;
    uint32_t frame;
    int64_t offset, payload_offset;
    uint64_t size;
    const uint8_t *payload;
    size_t payload_size;
} dfcgs_chunk;

/* A frame under way: what its chunks so far have said. */
typedef struct {
    uint32_t index, num_gaussians; /* num_gaussians: those of its output */
    int64_t offset;
    int is_intra, expects; /* type of the chunk that comes next, 0 when the frame is whole */
    uint8_t hash[DFCGS_HASH_BYTES];
    dfcgs_inter_header header;
    int has_topology, has_motion, has_residual;
    dfcgs_topology_header topology;
    dfcgs_births births;
    int32_t *places; /* of all Gaussians in the output, where the frame says them */
    dfcgs_motion_header motion;
    int32_t *reference; /* POSITION of the reference frame, where the frame has moved */
    const uint8_t *escapes;
    size_t escape_bytes;
} dfcgs_frame;

typedef struct {
    dfcgs_arena arena;
    dfcgs_error error;
    dfcgs_models models;
    dfcgs_context_model model;
    dfcgs_sequence sequence;
    dfcgs_budget budget;
    int check; /* whether hashes are checked */
    dfcgs_gof gof;
    dfcgs_frame frame;
    const uint8_t *escapes; /* payload of the frame's escapes, NULL for none */
    size_t escape_bytes, setup_end, frame_start;
} dfcgs_decoder;

/* Makes a decoder of a cleared record; `words` is the model (context_model.h). */
dfcgs_status dfcgs_open(dfcgs_decoder *decoder, const int32_t *words, uint32_t num_words);
/* The payload of the sequence header; then the budget's limits may be set. */
dfcgs_status dfcgs_begin(dfcgs_decoder *decoder, const uint8_t *payload, size_t size, int64_t offset);
/* Forgets the GoF: what follows begins with an I-frame. */
void dfcgs_forget(dfcgs_decoder *decoder);

/* Room for the payload of the next chunk; it stays until its frame is done. */
uint8_t *dfcgs_payload_room(dfcgs_decoder *decoder, int type, size_t size);
/* Decodes a chunk: INTRA_FRAME or INTER_FRAME, or the one that the frame expects. The frame is whole, and its
   hash was right, where nothing more is expected. */
dfcgs_status dfcgs_put(dfcgs_decoder *decoder, const dfcgs_chunk *chunk);

#endif
