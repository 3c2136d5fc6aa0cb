/* SHA-1 by the processor's own instructions (x86 SHA extensions), or the firmware's where there are none. */
#include <string.h>

#include "internal.h"
#include "shared.h"

/* The firmware's, under another name. */
#define phx_hash_start phx_plain_start
#define phx_hash_add phx_plain_add
#define phx_hash_end phx_plain_end
#define phx_sha1 phx_plain_sha1
#include "../../src/hash.c"
#undef phx_hash_start
#undef phx_hash_add
#undef phx_hash_end
#undef phx_sha1

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>

int phx_host_can(void)
{
    unsigned a, b, c, d, wide = 0, can = 0;

    if (!__get_cpuid(1, &a, &b, &c, &d))
        return 0;
    if (c & (1u << 27)) { /* the system keeps registers that it has to be asked about: are the wide ones among them? */
        unsigned low, high;
        __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
        wide = (low & 6u) == 6u;
    }
    if (!(c & (1u << 9)) || !(c & (1u << 19)) || !__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return 0; /* no SSSE3, no SSE4.1 */
    can |= b & (1u << 29) ? PHX_HOST_SHA : 0u;
    can |= wide && b & (1u << 5) ? PHX_HOST_AVX2 : 0u;
    return (int)can;
}

/* Four rounds; then the schedule is four words further. */
#define FOUR(e, next, m0, m1, m2, m3, k)       \
    e = _mm_sha1nexte_epu32(e, m0);            \
    next = abcd;                               \
    m1 = _mm_sha1msg2_epu32(m1, m0);           \
    abcd = _mm_sha1rnds4_epu32(abcd, e, k);    \
    m3 = _mm_sha1msg1_epu32(m3, m0);           \
    m2 = _mm_xor_si128(m2, m0);

/* Source: Intel, "New Instructions Supporting the Secure Hash Algorithm" (2013). */
__attribute__((target("sha,sse4.1,ssse3"))) static void blocks(uint32_t h[5], const uint8_t *data, uint32_t count)
{
    const __m128i turn = _mm_set_epi64x(0x0001020304050607, 0x08090a0b0c0d0e0f);
    __m128i abcd = _mm_shuffle_epi32(_mm_loadu_si128((const __m128i *)h), 0x1b);
    __m128i e0 = _mm_set_epi32((int)h[4], 0, 0, 0), e1;

    phx_host_counts[0] += count;
    for (; count > 0; count--, data += PHX_SHA1_BLOCK) {
        const __m128i *from = (const __m128i *)data;
        __m128i abcd_before = abcd, e_before = e0;
        __m128i m0 = _mm_shuffle_epi8(_mm_loadu_si128(from), turn), m1 = _mm_shuffle_epi8(_mm_loadu_si128(from + 1), turn);
        __m128i m2 = _mm_shuffle_epi8(_mm_loadu_si128(from + 2), turn), m3 = _mm_shuffle_epi8(_mm_loadu_si128(from + 3), turn);

        e0 = _mm_add_epi32(e0, m0);
        e1 = abcd;
        abcd = _mm_sha1rnds4_epu32(abcd, e0, 0);
        e1 = _mm_sha1nexte_epu32(e1, m1);
        e0 = abcd;
        abcd = _mm_sha1rnds4_epu32(abcd, e1, 0);
        m0 = _mm_sha1msg1_epu32(m0, m1);
        e0 = _mm_sha1nexte_epu32(e0, m2);
        e1 = abcd;
        abcd = _mm_sha1rnds4_epu32(abcd, e0, 0);
        m1 = _mm_sha1msg1_epu32(m1, m2);
        m0 = _mm_xor_si128(m0, m2);
        FOUR(e1, e0, m3, m0, m1, m2, 0)
        FOUR(e0, e1, m0, m1, m2, m3, 0)
        FOUR(e1, e0, m1, m2, m3, m0, 1)
        FOUR(e0, e1, m2, m3, m0, m1, 1)
        FOUR(e1, e0, m3, m0, m1, m2, 1)
        FOUR(e0, e1, m0, m1, m2, m3, 1)
        FOUR(e1, e0, m1, m2, m3, m0, 1)
        FOUR(e0, e1, m2, m3, m0, m1, 2)
        FOUR(e1, e0, m3, m0, m1, m2, 2)
        FOUR(e0, e1, m0, m1, m2, m3, 2)
        FOUR(e1, e0, m1, m2, m3, m0, 2)
        FOUR(e0, e1, m2, m3, m0, m1, 2)
        FOUR(e1, e0, m3, m0, m1, m2, 3)
        FOUR(e0, e1, m0, m1, m2, m3, 3)
        FOUR(e1, e0, m1, m2, m3, m0, 3)
        FOUR(e0, e1, m2, m3, m0, m1, 3)
        e1 = _mm_sha1nexte_epu32(e1, m3);
        e0 = abcd;
        abcd = _mm_sha1rnds4_epu32(abcd, e1, 3);
        e0 = _mm_sha1nexte_epu32(e0, e_before);
        abcd = _mm_add_epi32(abcd, abcd_before);
    }
    _mm_storeu_si128((__m128i *)h, _mm_shuffle_epi32(abcd, 0x1b));
    h[4] = (uint32_t)_mm_extract_epi32(e0, 3);
}

#else

int phx_host_can(void)
{
    return 0;
}

static void blocks(uint32_t h[5], const uint8_t *data, uint32_t count)
{
    for (; count > 0; count--, data += PHX_SHA1_BLOCK)
        compress(h, data);
}

#endif

int phx_host_uses = 0;
uint64_t phx_host_counts[2];

void phx_host_count(uint64_t counts[2])
{
    memcpy(counts, phx_host_counts, sizeof phx_host_counts);
}

int phx_host_use(uint32_t fast)
{
    static int can = -1;

    if (can < 0)
        can = phx_host_can();
    phx_host_uses = fast ? can : 0;
    return phx_host_uses;
}

int phx_host_used(void)
{
    return phx_host_uses;
}

void phx_hash_start(phx_hash *hash)
{
    phx_plain_start(hash);
}

void phx_hash_add(phx_hash *hash, const uint8_t *data, uint32_t len)
{
    uint32_t used = (uint32_t)(hash->bytes % PHX_SHA1_BLOCK), whole;

    if (!(phx_host_uses & PHX_HOST_SHA)) {
        phx_plain_add(hash, data, len);
        return;
    }
    hash->bytes += len;
    if (used > 0) {
        uint32_t piece = PHX_SHA1_BLOCK - used < len ? PHX_SHA1_BLOCK - used : len;
        memcpy(hash->block + used, data, piece);
        if (used + piece < PHX_SHA1_BLOCK)
            return;
        blocks(hash->h, hash->block, 1);
        data += piece;
        len -= piece;
    }
    whole = len / PHX_SHA1_BLOCK;
    if (whole > 0)
        blocks(hash->h, data, whole);
    memcpy(hash->block, data + whole * PHX_SHA1_BLOCK, len % PHX_SHA1_BLOCK);
}

void phx_hash_end(phx_hash *hash, uint8_t out[PHX_HASH_BYTES])
{
    uint32_t used = (uint32_t)(hash->bytes % PHX_SHA1_BLOCK);
    uint64_t bits = 8u * hash->bytes;

    if (!(phx_host_uses & PHX_HOST_SHA)) {
        phx_plain_end(hash, out);
        return;
    }
    hash->block[used++] = 0x80;
    if (used > 56u) {
        memset(hash->block + used, 0, PHX_SHA1_BLOCK - used);
        blocks(hash->h, hash->block, 1);
        used = 0;
    }
    memset(hash->block + used, 0, 56u - used);
    for (unsigned i = 0; i < 8u; i++)
        hash->block[56u + i] = (uint8_t)(bits >> (56u - 8u * i));
    blocks(hash->h, hash->block, 1);
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

int phx_chain_extend(uint8_t top[PHX_HASH_BYTES], const uint8_t *bytes, uint32_t len)
{
    phx_hash hash;

    phx_hash_start(&hash);
    phx_hash_add(&hash, top, PHX_HASH_BYTES);
    phx_hash_add(&hash, bytes, len);
    phx_hash_end(&hash, top);
    return 0;
}
