#include "core.h"

#if defined(__wasm__)
enum { PAGE_LOG2 = 16 };

/* Whether linear memory reaches to `end`; it grows where it does not, by an eighth more than is asked for. */
static int reaches(uintptr_t end) {
    size_t have = __builtin_wasm_memory_size(0), need = (size_t)((end >> PAGE_LOG2) + 1);
    if (need <= have) return 1;
    size_t more = need - have, ample = more + have / 8;
    if (ample + have <= 65536 && __builtin_wasm_memory_grow(0, ample) != (size_t)-1) return 1;
    return __builtin_wasm_memory_grow(0, more) != (size_t)-1;
}
#else
static int reaches(uintptr_t end) { return end != 0; }
#endif

void *dfcgs_take(dfcgs_arena *arena, size_t count, size_t width) {
    size_t start = (arena->used + 15) & ~(size_t)15, bytes;
    if (__builtin_mul_overflow(count, width, &bytes) || start > arena->size || bytes > arena->size - start)
        return NULL;
    if (!reaches((uintptr_t)arena->base + start + bytes)) return NULL;
    arena->used = start + bytes;
    if (arena->used > arena->peak) arena->peak = arena->used;
    return arena->base + start;
}

void *dfcgs_take_zeros(dfcgs_arena *arena, size_t count, size_t width) {
    void *taken = dfcgs_take(arena, count, width);
    if (taken) memset(taken, 0, count * width);
    return taken;
}

dfcgs_status dfcgs_refuse(dfcgs_error *error, dfcgs_status status, int64_t offset, const char *message) {
    *error = (dfcgs_error){.status = status, .offset = offset, .message = message};
    return status;
}
