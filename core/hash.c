#include "hash.h"

static const uint64_t initial[8] = {0x6a09e667f3bcc908, 0xbb67ae8584caa73b, 0x3c6ef372fe94f82b,
                                    0xa54ff53a5f1d36f1, 0x510e527fade682d1, 0x9b05688c2b3e6c1f,
                                    0x1f83d9abfb41bd6b, 0x5be0cd19137e2179};
static const uint8_t sigma[10][16] = {{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
                                      {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
                                      {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
                                      {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
                                      {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
                                      {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
                                      {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
                                      {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
                                      {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
                                      {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};

static uint64_t rotated(uint64_t word, int bits) { return word >> bits | word << (64 - bits); }

#define MIX(a, b, c, d, x, y)                                                                                \
    do {                                                                                                     \
        v[a] += v[b] + (x), v[d] = rotated(v[d] ^ v[a], 32);                                                 \
        v[c] += v[d], v[b] = rotated(v[b] ^ v[c], 24);                                                       \
        v[a] += v[b] + (y), v[d] = rotated(v[d] ^ v[a], 16);                                                 \
        v[c] += v[d], v[b] = rotated(v[b] ^ v[c], 63);                                                       \
    } while (0)

#define ROUND(r)                                                                                             \
    do {                                                                                                     \
        const uint8_t *s = sigma[(r) % 10];                                                                  \
        MIX(0, 4, 8, 12, m[s[0]], m[s[1]]);                                                                  \
        MIX(1, 5, 9, 13, m[s[2]], m[s[3]]);                                                                  \
        MIX(2, 6, 10, 14, m[s[4]], m[s[5]]);                                                                 \
        MIX(3, 7, 11, 15, m[s[6]], m[s[7]]);                                                                 \
        MIX(0, 5, 10, 15, m[s[8]], m[s[9]]);                                                                 \
        MIX(1, 6, 11, 12, m[s[10]], m[s[11]]);                                                               \
        MIX(2, 7, 8, 13, m[s[12]], m[s[13]]);                                                                \
        MIX(3, 4, 9, 14, m[s[14]], m[s[15]]);                                                                \
    } while (0)

/* Takes in a block; all machines that this runs on are little-endian. */
static void compress(dfcgs_hash *hash, const uint8_t *block, int last) {
    uint64_t v[16], m[16];
    memcpy(m, block, sizeof m);
    for (int i = 0; i < 8; i++) v[i] = hash->words[i], v[8 + i] = initial[i];
    v[12] ^= hash->length;
    if (last) v[14] = ~v[14];
    ROUND(0);
    ROUND(1);
    ROUND(2);
    ROUND(3);
    ROUND(4);
    ROUND(5);
    ROUND(6);
    ROUND(7);
    ROUND(8);
    ROUND(9);
    ROUND(10);
    ROUND(11);
    for (int i = 0; i < 8; i++) hash->words[i] ^= v[i] ^ v[8 + i];
}

void dfcgs_hash_start(dfcgs_hash *hash) {
    *hash = (dfcgs_hash){.length = 0};
    for (int i = 0; i < 8; i++) hash->words[i] = initial[i];
    hash->words[0] ^= 0x01010000 ^ DFCGS_DIGEST_BYTES;
}

/* The last block of all is compressed by dfcgs_hash_end: one that is full waits for more. */
void dfcgs_hash_add(dfcgs_hash *hash, const void *bytes, size_t count) {
    const uint8_t *from = bytes;
    while (count > 0) {
        if (hash->waiting == DFCGS_HASH_BLOCK) {
            hash->length += DFCGS_HASH_BLOCK;
            compress(hash, hash->block, 0);
            hash->waiting = 0;
        }
        while (hash->waiting == 0 && count > DFCGS_HASH_BLOCK) {
            hash->length += DFCGS_HASH_BLOCK;
            compress(hash, from, 0);
            from += DFCGS_HASH_BLOCK, count -= DFCGS_HASH_BLOCK;
        }
        size_t room = DFCGS_HASH_BLOCK - hash->waiting, some = count < room ? count : room;
        memcpy(hash->block + hash->waiting, from, some);
        hash->waiting += (uint32_t)some;
        from += some, count -= some;
    }
}

void dfcgs_hash_end(dfcgs_hash *hash, uint8_t digest[DFCGS_DIGEST_BYTES]) {
    hash->length += hash->waiting;
    memset(hash->block + hash->waiting, 0, DFCGS_HASH_BLOCK - hash->waiting);
    compress(hash, hash->block, 1);
    memcpy(digest, hash->words, DFCGS_DIGEST_BYTES);
}

void dfcgs_digest(const void *bytes, uint32_t count, uint8_t digest[DFCGS_DIGEST_BYTES]) {
    dfcgs_hash hash;
    dfcgs_hash_start(&hash);
    dfcgs_hash_add(&hash, bytes, count);
    dfcgs_hash_end(&hash, digest);
}
