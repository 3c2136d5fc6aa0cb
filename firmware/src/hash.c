/* SHA-1 (FIPS 180), bytes as they come. phx_hash and these functions are all that another hash would replace. */
#include <string.h>

#include "internal.h"

static uint32_t rotl(uint32_t x, unsigned n)
{
    return (x << n) | (x >> (32u - n));
}

/* The 80 words of the schedule live in a ring of 16: it is the small nodes' RAM that counts. */
static void compress(uint32_t h[5], const uint8_t block[PHX_SHA1_BLOCK])
{
    uint32_t w[16], a = h[0], b = h[1], c = h[2], d = h[3], e = h[4];

    for (unsigned i = 0; i < 16u; i++) {
        const uint8_t *p = block + 4u * i;
        w[i] = ((uint32_t)p[0] << 24) | ((uint32_t)p[1] << 16) | ((uint32_t)p[2] << 8) | p[3];
    }
    for (unsigned i = 0; i < 80u; i++) {
        uint32_t f, k, next;
        if (i >= 16u)
            w[i & 15u] = rotl(w[(i + 13u) & 15u] ^ w[(i + 8u) & 15u] ^ w[(i + 2u) & 15u] ^ w[i & 15u], 1);
        if (i < 20u) {
            f = (b & c) | (~b & d);
            k = 0x5a827999u;
        } else if (i < 40u) {
            f = b ^ c ^ d;
            k = 0x6ed9eba1u;
        } else if (i < 60u) {
            f = (b & c) | (b & d) | (c & d);
            k = 0x8f1bbcdcu;
        } else {
            f = b ^ c ^ d;
            k = 0xca62c1d6u;
        }
        next = rotl(a, 5) + f + e + k + w[i & 15u];
        e = d;
        d = c;
        c = rotl(b, 30);
        b = a;
        a = next;
    }
    h[0] += a;
    h[1] += b;
    h[2] += c;
    h[3] += d;
    h[4] += e;
}

void phx_hash_start(phx_hash *hash)
{
    static const uint32_t start[5] = {0x67452301u, 0xefcdab89u, 0x98badcfeu, 0x10325476u, 0xc3d2e1f0u};

    hash->bytes = 0;
    memcpy(hash->h, start, sizeof start);
}

void phx_hash_add(phx_hash *hash, const uint8_t *data, uint32_t len)
{
    uint32_t used = (uint32_t)(hash->bytes % PHX_SHA1_BLOCK);

    hash->bytes += len;
    while (len > 0) {
        uint32_t piece = PHX_SHA1_BLOCK - used < len ? PHX_SHA1_BLOCK - used : len;
        memcpy(hash->block + used, data, piece);
        data += piece;
        len -= piece;
        used += piece;
        if (used == PHX_SHA1_BLOCK) {
            compress(hash->h, hash->block);
            used = 0;
        }
    }
}

void phx_hash_end(phx_hash *hash, uint8_t out[PHX_HASH_BYTES])
{
    static const uint8_t padding[PHX_SHA1_BLOCK] = {0x80};
    uint64_t bits = 8u * hash->bytes;
    uint32_t used = (uint32_t)(hash->bytes % PHX_SHA1_BLOCK);
    uint8_t length[8];

    phx_hash_add(hash, padding, used < 56u ? 56u - used : 120u - used);
    for (unsigned i = 0; i < 8u; i++)
        length[i] = (uint8_t)(bits >> (56u - 8u * i));
    phx_hash_add(hash, length, sizeof length);
    for (unsigned i = 0; i < PHX_HASH_BYTES; i++)
        out[i] = (uint8_t)(hash->h[i / 4u] >> (24u - 8u * (i % 4u)));
}

int phx_sha1(const uint8_t *data, uint32_t len, uint8_t out[PHX_HASH_BYTES])
{
    phx_hash hash;

    phx_hash_start(&hash);
    phx_hash_add(&hash, data, len);
    phx_hash_end(&hash, out);
    return 0;
}
