#include "container.h"

enum { MAGIC_BYTES = 8, CRC_BYTES = 4, ANCILLARY_BIT = 0x80 };
enum { CHUNK_INFO = 0x81, CHUNK_COMMENTS = 0x82 };

static const uint8_t MAGIC[MAGIC_BYTES] = {0x89, 0x44, 0x47, 0x53, 0x0d, 0x0a, 0x1a, 0x0a};

static dfcgs_status check_magic(dfcgs_reader *r) {
    const uint8_t *bytes;
    for (size_t i = 0; i < MAGIC_BYTES && i < r->size; i++)
        if (r->data[i] != MAGIC[i])
            return dfcgs_refuse(r->error, DFCGS_NOT_OURS, DFCGS_NO_OFFSET, "not a dfcgs file");
    if (r->size < MAGIC_BYTES)
        return dfcgs_refuse(r->error, DFCGS_TRUNCATED, (int64_t)r->size,
                            "the file ends inside its magic number");
    return dfcgs_raw(r, MAGIC_BYTES, &bytes);
}

/* The next chunk, whose bytes are all there; its checksum is not looked at. */
static dfcgs_status read_head(dfcgs_reader *r, dfcgs_chunk *chunk) {
    uint8_t type;
    uint64_t frame, length;
    const uint8_t *bytes;
    chunk->offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, &type));
    DFCGS_TRY(dfcgs_uvarint(r, &frame));
    DFCGS_TRY(dfcgs_uvarint(r, &length));
    if (dfcgs_left(r) < CRC_BYTES || length > dfcgs_left(r) - CRC_BYTES)
        return dfcgs_refuse(r->error, DFCGS_TRUNCATED, (int64_t)r->size, "the file ends inside a chunk");
    chunk->type = type;
    chunk->frame = frame > UINT32_MAX ? UINT32_MAX : (uint32_t)frame;
    chunk->payload_offset = dfcgs_offset(r);
    chunk->payload_size = (size_t)length;
    DFCGS_TRY(dfcgs_raw(r, length + CRC_BYTES, &bytes));
    chunk->payload = bytes;
    chunk->size = (uint64_t)(dfcgs_offset(r) - chunk->offset);
    return DFCGS_OK;
}

static dfcgs_status check_crc(dfcgs_reader *r, const dfcgs_chunk *chunk) {
    size_t size = (size_t)chunk->size - CRC_BYTES;
    const uint8_t *bytes = r->data + chunk->offset, *crc = bytes + size;
    uint32_t said = crc[0] | (uint32_t)crc[1] << 8 | (uint32_t)crc[2] << 16 | (uint32_t)crc[3] << 24;
#if defined(DFCGS_ANY_CHECKSUM) /* for who breaks files */
    return DFCGS_OK;
#endif
    if (dfcgs_crc32(bytes, size) == said) return DFCGS_OK;
    return dfcgs_corrupt(r->error, chunk->offset, "wrong checksum: the file is damaged here");
}

static int is_known(int type) {
    switch (type) {
    case DFCGS_CHUNK_SEQUENCE:
    case DFCGS_CHUNK_INTRA:
    case DFCGS_CHUNK_INTER:
    case DFCGS_CHUNK_HYPERPRIOR:
    case DFCGS_CHUNK_MOTION:
    case DFCGS_CHUNK_TOPOLOGY:
    case DFCGS_CHUNK_RESIDUAL:
    case DFCGS_CHUNK_ESCAPES:
    case DFCGS_CHUNK_INDEX:
    case DFCGS_CHUNK_END:
    case CHUNK_INFO:
    case CHUNK_COMMENTS: return 1;
    default: return 0;
    }
}

/* The next chunk of a known type; unknown ancillary ones are checked and skipped. */
static dfcgs_status next_chunk(dfcgs_file *file, dfcgs_chunk *chunk) {
    dfcgs_reader *r = &file->reader;
    for (;;) {
        DFCGS_TRY(read_head(r, chunk));
        if (is_known(chunk->type)) return DFCGS_OK;
        if (!(chunk->type & ANCILLARY_BIT))
            return dfcgs_refuse(r->error, DFCGS_UNSUPPORTED, chunk->offset,
                                "an unknown chunk: a newer decoder is needed");
        DFCGS_TRY(check_crc(r, chunk));
    }
}

static dfcgs_status put(dfcgs_file *file, dfcgs_decoder *decoder, const dfcgs_chunk *chunk) {
    DFCGS_TRY(check_crc(&file->reader, chunk));
    if (!dfcgs_payload_room(decoder, chunk->type, 0)) return DFCGS_MEMORY;
    return dfcgs_put(decoder, chunk);
}

static dfcgs_status decode_frame(dfcgs_file *file, dfcgs_decoder *decoder, const dfcgs_chunk *first) {
    dfcgs_chunk chunk;
    dfcgs_error *error = file->reader.error;
    if (first->frame >= decoder->sequence.num_frames)
        return dfcgs_corrupt(error, first->offset, "more frames than the header says");
    DFCGS_TRY(put(file, decoder, first));
    while (decoder->frame.expects) {
        DFCGS_TRY(next_chunk(file, &chunk));
        if (chunk.type != decoder->frame.expects || chunk.frame != first->frame)
            return dfcgs_corrupt(error, chunk.offset, "a frame lacks one of its chunks");
        DFCGS_TRY(put(file, decoder, &chunk));
    }
    if (first->frame != file->num_frames) return dfcgs_corrupt(error, DFCGS_NO_OFFSET, "a frame is missing");
    file->num_frames++;
    return DFCGS_OK;
}

/* A chunk that belongs to no frame. */
static dfcgs_status side_chunk(dfcgs_file *file, const dfcgs_decoder *decoder, const dfcgs_chunk *chunk) {
    dfcgs_reader *r = &file->reader;
    if (chunk->type == DFCGS_CHUNK_END && dfcgs_left(r))
        return dfcgs_corrupt(r->error, dfcgs_offset(r), "bytes after the end chunk");
    if (chunk->type < DFCGS_CHUNK_INDEX)
        return dfcgs_corrupt(r->error, chunk->offset, "a chunk stands where it may not");
    DFCGS_TRY(check_crc(r, chunk));
    if (chunk->type != DFCGS_CHUNK_END) return DFCGS_OK;
    file->has_ended = 1;
    if (file->num_frames == decoder->sequence.num_frames) return DFCGS_OK;
    return dfcgs_corrupt(r->error, DFCGS_NO_OFFSET, "fewer frames than the header says");
}

dfcgs_status dfcgs_open_file(dfcgs_file *file, dfcgs_decoder *decoder, const uint8_t *data, size_t size,
                             const uint8_t model_hash[DFCGS_MODEL_HASH_BYTES]) {
    dfcgs_chunk chunk;
    int differs = 0;
    *file = (dfcgs_file){
        .reader = {.data = data, .size = size, .shortage = DFCGS_TRUNCATED, .error = &decoder->error}};
    DFCGS_TRY(check_magic(&file->reader));
    DFCGS_TRY(read_head(&file->reader, &chunk));
    if (chunk.type != DFCGS_CHUNK_SEQUENCE)
        return dfcgs_corrupt(&decoder->error, MAGIC_BYTES, "the first chunk is not a sequence header");
    DFCGS_TRY(check_crc(&file->reader, &chunk));
    DFCGS_TRY(dfcgs_begin(decoder, chunk.payload, chunk.payload_size, chunk.payload_offset));
    for (int i = 0; i < DFCGS_MODEL_HASH_BYTES; i++)
        differs |= model_hash[i] ^ decoder->sequence.model_hash[i];
    if (differs || decoder->sequence.profile != DFCGS_MAIN)
        return dfcgs_refuse(&decoder->error, DFCGS_MODEL, DFCGS_NO_OFFSET, "coded with another model");
    return DFCGS_OK;
}

dfcgs_status dfcgs_next_frame(dfcgs_file *file, dfcgs_decoder *decoder, int *is_there) {
    dfcgs_chunk chunk;
    *is_there = 0;
    while (!file->has_ended) {
        DFCGS_TRY(next_chunk(file, &chunk));
        if (chunk.type == DFCGS_CHUNK_INTRA || chunk.type == DFCGS_CHUNK_INTER) {
            *is_there = 1;
            return decode_frame(file, decoder, &chunk);
        }
        DFCGS_TRY(side_chunk(file, decoder, &chunk));
    }
    return DFCGS_OK;
}
