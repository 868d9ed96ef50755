/* What all parts of the core share: status, arena, exact integer arithmetic (chapter 1.2 of
   bitstream_spec.md).

   C11, integers only but in the output process, no libc. Nothing here is allocated but from an arena that the
   caller sizes; what lies in an arena lives until its mark is restored. */
#ifndef DFCGS_CORE_H
#define DFCGS_CORE_H

#include <stddef.h>
#include <stdint.h>

#if defined(__wasm__)
#define DFCGS_EXPORT __attribute__((visibility("default")))
#else
#define DFCGS_EXPORT
#endif
#define DFCGS_INLINE static inline __attribute__((unused))

typedef enum {
    DFCGS_OK = 0,
    DFCGS_CORRUPT,     /* CorruptBitstream */
    DFCGS_TRUNCATED,   /* TruncatedBitstream: more bytes are needed */
    DFCGS_UNSUPPORTED, /* UnsupportedBitstream */
    DFCGS_LIMIT,       /* LimitExceeded */
    DFCGS_MODEL,       /* ModelMismatch */
    DFCGS_HASH,        /* HashMismatch: the state is not what the file's hash says */
    DFCGS_MEMORY,      /* the arena is too small; says nothing about the file */
    DFCGS_RESOURCES,   /* ResourceLimit: more than the caller allows */
    DFCGS_NOT_OURS,    /* NotADgsFile */
    DFCGS_MISUSE       /* the caller asked for what cannot be: no fault of the file */
} dfcgs_status;

/* `return` what went wrong, if anything did. */
#define DFCGS_TRY(call)                                                                                      \
    do {                                                                                                     \
        dfcgs_status try_status_ = (call);                                                                   \
        if (try_status_ != DFCGS_OK) return try_status_;                                                     \
    } while (0)

/* A bump allocator. A mark is the value of `used`; storing it back frees what was taken since. */
typedef struct {
    uint8_t *base;
    size_t size, used, peak;
} dfcgs_arena;

/* `count` times `width` bytes, 16-byte aligned, not cleared; NULL when the arena is full or the product
   overflows. Zero bytes are a pointer that is not NULL. */
void *dfcgs_take(dfcgs_arena *arena, size_t count, size_t width);
void *dfcgs_take_zeros(dfcgs_arena *arena, size_t count, size_t width);

#define DFCGS_TAKE(arena, type, count) ((type *)dfcgs_take((arena), (count), sizeof(type)))
#define DFCGS_ZEROS(arena, type, count) ((type *)dfcgs_take_zeros((arena), (count), sizeof(type)))

/* Instructions of their own in WebAssembly (bulk memory), libc elsewhere. */
#define memcpy __builtin_memcpy
#define memmove __builtin_memmove
#define memset __builtin_memset

/* What a file was refused for. `offset`: byte of the file, -1 where none is known. */
typedef struct {
    dfcgs_status status;
    int64_t offset;
    const char *message;
} dfcgs_error;

/* Writes the record and returns `status`, to be returned again. */
dfcgs_status dfcgs_refuse(dfcgs_error *error, dfcgs_status status, int64_t offset, const char *message);

DFCGS_INLINE dfcgs_status dfcgs_corrupt(dfcgs_error *error, int64_t offset, const char *message) {
    return dfcgs_refuse(error, DFCGS_CORRUPT, offset, message);
}

#define DFCGS_NO_OFFSET ((int64_t)-1)

/* Take memory or return DFCGS_MEMORY. */
#define DFCGS_GET(variable, arena, type, count)                                                              \
    do {                                                                                                     \
        if (!((variable) = DFCGS_TAKE(arena, type, count))) return DFCGS_MEMORY;                             \
    } while (0)
#define DFCGS_GET_ZEROS(variable, arena, type, count)                                                        \
    do {                                                                                                     \
        if (!((variable) = DFCGS_ZEROS(arena, type, count))) return DFCGS_MEMORY;                            \
    } while (0)

/* --- 3, 4.2: numbers that several chapters use ------------------------------------------------------------
 */

#define DFCGS_STATE_LIMIT 536870911 /* 2**29 - 1 */
enum {
    DFCGS_POSITION,
    DFCGS_SCALE,
    DFCGS_ROTATION,
    DFCGS_OPACITY,
    DFCGS_SH_DC,
    DFCGS_SH_1,
    DFCGS_SH_2,
    DFCGS_SH_3
};
enum { DFCGS_MAX_ATTRIBUTES = 8 };

/* Columns of an attribute's plane in the state. Planes are int32, row-major [N][columns]. */
DFCGS_INLINE int dfcgs_columns(int attribute) {
    static const uint8_t columns[DFCGS_MAX_ATTRIBUTES] = {3, 3, 4, 1, 3, 9, 15, 21};
    return columns[attribute];
}

/* The state of a frame (8): planes of the attributes 0 .. num_attributes - 1, all in GoF order. */
typedef struct {
    uint32_t count;                        /* N */
    int num_attributes;                    /* 5 + sh_degree */
    int32_t *planes[DFCGS_MAX_ATTRIBUTES]; /* [N][columns] */
} dfcgs_state;

/* --- 1.2: arithmetic ---------------------------------------------------------------------------------------
 */

DFCGS_INLINE int64_t dfcgs_min(int64_t a, int64_t b) { return a < b ? a : b; }
DFCGS_INLINE int64_t dfcgs_max(int64_t a, int64_t b) { return a > b ? a : b; }
DFCGS_INLINE int64_t dfcgs_clip(int64_t a, int64_t low, int64_t high) {
    return a < low ? low : a > high ? high : a;
}
DFCGS_INLINE int64_t dfcgs_abs(int64_t a) { return a < 0 ? -a : a; }
DFCGS_INLINE int dfcgs_sign(int64_t a) { return (a > 0) - (a < 0); }

/* a << n, n in 0 .. 62, without undefined behaviour for negative a; the result shall fit. */
DFCGS_INLINE int64_t dfcgs_shift(int64_t a, int n) { return (int64_t)((uint64_t)a << n); }

/* round_shift(a, n), n >= 1. a >> n of a negative a is arithmetic with every compiler that is used. */
DFCGS_INLINE int64_t dfcgs_round_shift(int64_t a, int n) { return (a + ((int64_t)1 << (n - 1))) >> n; }

/* a // b, b > 0 */
DFCGS_INLINE int64_t dfcgs_floor_divide(int64_t a, int64_t b) {
    int64_t q = a / b;
    return q - (a % b < 0);
}

/* round_divide(a, b), b > 0; 2 * abs(a) + b shall stay below 2**63. */
DFCGS_INLINE int64_t dfcgs_round_divide(int64_t a, int64_t b) { return dfcgs_floor_divide(2 * a + b, 2 * b); }

/* bit_length(a): 0 for 0 */
DFCGS_INLINE int dfcgs_bit_length(uint64_t a) { return a ? 64 - __builtin_clzll(a) : 0; }

/* isqrt(a) of any 64-bit integer, exact. */
DFCGS_INLINE uint64_t dfcgs_isqrt(uint64_t a) {
    uint64_t root = (uint64_t)__builtin_sqrt((double)a); /* at most one off either way, put right below */
    if (root > 0xFFFFFFFFu) root = 0xFFFFFFFFu;
    while (root * root > a) root--;
    while (root < 0xFFFFFFFFu && (root + 1) * (root + 1) <= a) root++;
    return root;
}

/* ladder(a, num_steps) of 11.2: half octaves; a >= 0 and below 2**55 */
DFCGS_INLINE int dfcgs_ladder(int64_t a, int num_steps) {
    if (a == 0) return 0;
    int b = dfcgs_bit_length((uint64_t)a);
    int rung = 2 * b - 1 + (((uint64_t)a << 8) >= ((uint64_t)181 << b));
    return rung < num_steps - 1 ? rung : num_steps - 1;
}

#endif
