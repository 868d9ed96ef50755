/* Decodes files to their end: for libFuzzer, and, with files as arguments, on its own.

   DFCGS_WORDS names a file with the model's words and DFCGS_HASH its hash in hexadecimal (tools/fuzz_core.py
   sets both). */
#include <stdio.h>
#include <stdlib.h>

#include "../container.h"
#include "../frame_output.h"

enum { ARENA = 1 << 30 };

static dfcgs_decoder opened; /* with the model, before any file */
static uint8_t *arena, hash[DFCGS_MODEL_HASH_BYTES];

static uint8_t *read_file(const char *name, size_t *size) {
    FILE *file = fopen(name, "rb");
    if (!file) abort();
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    uint8_t *data = malloc(*size + 1);
    if (fread(data, 1, *size, file) != *size) abort();
    fclose(file);
    return data;
}

static void set_up(void) {
    size_t size;
    if (arena) return;
    int32_t *words = (int32_t *)read_file(getenv("DFCGS_WORDS"), &size);
    for (int i = 0; i < DFCGS_MODEL_HASH_BYTES; i++) sscanf(getenv("DFCGS_HASH") + 2 * i, "%2hhx", &hash[i]);
    arena = malloc(ARENA);
    opened.arena = (dfcgs_arena){.base = arena, .size = ARENA};
    if (dfcgs_open(&opened, words, (uint32_t)(size / 4))) abort();
    free(words);
}

static int decode(const uint8_t *data, size_t size, dfcgs_decoder *decoder, int *num_frames) {
    dfcgs_file file;
    dfcgs_output output;
    int is_there = 1;
    *decoder = opened;
    DFCGS_TRY(dfcgs_open_file(&file, decoder, data, size, hash));
    decoder->budget.max_memory = ARENA;
    decoder->budget.max_gaussians = -1;
    for (*num_frames = 0; is_there; *num_frames += is_there) {
        DFCGS_TRY(dfcgs_next_frame(&file, decoder, &is_there));
        if (is_there) DFCGS_TRY(dfcgs_frame_output(decoder, DFCGS_ALL_ARRAYS, &output));
    }
    return DFCGS_OK;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static dfcgs_decoder decoder;
    int num_frames;
    set_up();
    int status = decode(data, size, &decoder, &num_frames);
    if (status == DFCGS_MISUSE || status == DFCGS_HASH) abort();
    return 0;
}

#if !defined(DFCGS_LIBFUZZER)
int main(int count, char **names) {
    static dfcgs_decoder decoder;
    set_up();
    for (int i = 1; i < count; i++) {
        size_t size;
        int num_frames = 0;
        uint8_t *data = read_file(names[i], &size);
        int status = decode(data, size, &decoder, &num_frames);
        printf("%s: status %d at %lld, %d frames\n", names[i], status, (long long)decoder.error.offset,
               num_frames);
        if (status == DFCGS_MISUSE) abort();
        free(data);
    }
    return 0;
}
#endif
