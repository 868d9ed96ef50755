/* The core as a WebAssembly module: one decoder an instance, in linear memory. */
#include "container.h"
#include "frame_output.h"

#if defined(__wasm__)
extern uint8_t __heap_base;

static dfcgs_decoder decoder;
static dfcgs_output output;
static dfcgs_file file;

/* What a caller reads after each call, at fixed offsets; pointers and sizes are 32 bits. */
static struct {
    int64_t offset, excess_value, bytes, peak;
    int32_t status, excess_kind;
    const char *message;
    uint32_t excess_frame, excess_gaussians;
    int32_t expects;
    uint32_t count;
    int32_t num_attributes, has_order, has_patterns, touched;
    const void *planes[DFCGS_MAX_ATTRIBUTES], *patterns[DFCGS_MAX_ATTRIBUTES], *order, *escapes;
    uint32_t escape_bytes;
    const void *arrays[DFCGS_NUM_ARRAYS];
} info;

static int report(dfcgs_status status) {
    const dfcgs_gof *gof = &decoder.gof;
    info.status = status;
    info.offset = decoder.error.offset;
    info.message = decoder.error.message;
    info.excess_kind = decoder.budget.excess.kind;
    info.excess_value = decoder.budget.excess.value;
    info.excess_frame = decoder.budget.excess.frame;
    info.excess_gaussians = decoder.budget.excess.num_gaussians;
    info.bytes = decoder.budget.bytes;
    info.peak = (int64_t)decoder.arena.peak;
    info.expects = decoder.frame.expects;
    info.count = gof->count;
    info.num_attributes = gof->num_attributes;
    info.has_order = gof->has_order;
    info.has_patterns = gof->has_patterns;
    info.touched = gof->touched;
    for (int a = 0; a < DFCGS_MAX_ATTRIBUTES; a++) {
        info.planes[a] = gof->planes[a];
        info.patterns[a] = gof->patterns[a];
    }
    info.order = gof->order;
    info.escapes = decoder.escapes;
    info.escape_bytes = (uint32_t)decoder.escape_bytes;
    return status;
}

/* Where the record of above lies. */
DFCGS_EXPORT const void *core_info(void) { return &info; }

/* Begins anew; at most `limit` bytes of memory are taken. */
DFCGS_EXPORT void core_reset(uint32_t limit) {
    memset(&decoder, 0, sizeof decoder);
    decoder.arena.base = (uint8_t *)(((uintptr_t)&__heap_base + 15) & ~(uintptr_t)15);
    size_t most = UINT32_MAX - (uintptr_t)decoder.arena.base;
    decoder.arena.size = limit < most ? limit : most;
}

/* Room for bytes of the caller's; 0 where there is none. */
DFCGS_EXPORT void *core_room(uint32_t size) { return dfcgs_take(&decoder.arena, size, 1); }

/* `words`: the model. */
DFCGS_EXPORT int core_open(const int32_t *words, uint32_t count) {
    return report(dfcgs_open(&decoder, words, count));
}

/* The payload of the sequence header, whose first byte is at `offset`; max_gaussians -1 for none. */
DFCGS_EXPORT int core_begin(const uint8_t *payload, uint32_t size, int64_t offset, int64_t max_memory,
                            int64_t max_gaussians, int check) {
    dfcgs_status status = dfcgs_begin(&decoder, payload, size, offset);
    decoder.budget.max_memory = max_memory;
    decoder.budget.max_gaussians = max_gaussians;
    decoder.check = check;
    return report(status);
}

DFCGS_EXPORT void *core_payload(int type, uint32_t size) { return dfcgs_payload_room(&decoder, type, size); }

/* The chunk whose payload was put at `payload`. */
DFCGS_EXPORT int core_put(int type, uint32_t frame, int64_t offset, int64_t payload_offset, int64_t size,
                          const uint8_t *payload, uint32_t payload_size) {
    dfcgs_chunk chunk = {type, frame, offset, payload_offset, (uint64_t)size, payload, payload_size};
    return report(dfcgs_put(&decoder, &chunk));
}

/* Instead of core_begin and core_put: a whole file, which lies in memory that core_room gave. Limits are
   those of the file's level, hashes are checked. */
DFCGS_EXPORT int core_file(const uint8_t *data, uint32_t size, const uint8_t *model_hash) {
    decoder.check = 1;
    return report(dfcgs_open_file(&file, &decoder, data, size, model_hash));
}

/* The next frame of it; a count of -1 in the record says that there are no more. */
DFCGS_EXPORT int core_next(void) {
    int is_there;
    dfcgs_status status = report(dfcgs_next_frame(&file, &decoder, &is_there));
    if (!is_there) info.count = UINT32_MAX;
    return status;
}

/* Coefficients above degree 0 of a channel, and floats to a coordinate: 2 where positions are doubles. */
DFCGS_EXPORT int core_num_rest(void) { return decoder.sequence.sh_degree * (decoder.sequence.sh_degree + 2); }
DFCGS_EXPORT int core_position_floats(void) { return decoder.sequence.precision == DFCGS_FLOAT64 ? 2 : 1; }

/* The frame as floats: those arrays of `info` that are wanted. */
DFCGS_EXPORT int core_output(int wanted) {
    dfcgs_status status = dfcgs_frame_output(&decoder, wanted, &output);
    const void *arrays[DFCGS_NUM_ARRAYS] = {output.positions, output.rotations, output.scales,
                                            output.opacities, output.sh_dc,     output.sh_rest};
    memcpy(info.arrays, arrays, sizeof arrays);
    return report(status);
}
#endif
