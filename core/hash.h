/* 8.5 Digests: BLAKE2b without a key, 16 bytes (RFC 7693). */
#ifndef DFCGS_HASH_H
#define DFCGS_HASH_H

#include "core.h"

enum { DFCGS_DIGEST_BYTES = 16, DFCGS_HASH_BLOCK = 128 };

typedef struct {
    uint64_t words[8], length;
    uint32_t waiting; /* bytes in `block` */
    uint8_t block[DFCGS_HASH_BLOCK];
} dfcgs_hash;

void dfcgs_hash_start(dfcgs_hash *hash);
void dfcgs_hash_add(dfcgs_hash *hash, const void *bytes, size_t count);
void dfcgs_hash_end(dfcgs_hash *hash, uint8_t digest[DFCGS_DIGEST_BYTES]);

/* The digest of `count` bytes. */
DFCGS_EXPORT void dfcgs_digest(const void *bytes, uint32_t count, uint8_t digest[DFCGS_DIGEST_BYTES]);

#endif
