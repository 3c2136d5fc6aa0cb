/* LightMAC by up to eight blocks of PRESENT at once (AVX2), or the firmware's where there is none. As there, no branch
   and no address depends on a key or a state. */
#include <string.h>

#include "internal.h"
#include "shared.h"

/* The firmware's, the three of them that encrypt messages under another name. */
#define phx_mac phx_plain_mac
#define phx_mac_check phx_plain_mac_check
#define phx_lightmac phx_plain_lightmac
#include "../../src/mac.c"
#undef phx_mac
#undef phx_mac_check
#undef phx_lightmac

#if defined(__x86_64__)
#include <immintrin.h>

#define AVX2 __attribute__((target("avx2")))

static uint64_t swap(uint64_t x, unsigned by, uint64_t mask)
{
    uint64_t t = (x ^ (x >> by)) & mask;

    return x ^ t ^ (t << by);
}

/* Bits are swapped as by `swap`, in each of four states. */
AVX2 static inline __m256i swap4(__m256i x, int by, uint64_t mask)
{
    __m256i t = _mm256_and_si256(_mm256_xor_si256(x, _mm256_srli_epi64(x, by)), _mm256_set1_epi64x((long long)mask));

    return _mm256_xor_si256(_mm256_xor_si256(x, t), _mm256_slli_epi64(t, by));
}

/* One round of four states: S-boxes are looked up in a register, a nibble each, with the permutation's first swap of
   bits already made; its last one moves whole bytes. */
AVX2 static inline __m256i round4(__m256i s, uint64_t key)
{
    /* S-box of the low and the high nibble of a byte, then swap(s, 3, 0x0a). */
    const __m256i low = _mm256_broadcastsi128_si256(_mm_setr_epi8(0x44, 0x05, 0x14, 0x51, 0x41, 0x00, 0x50, 0x45, 0x11,
                                                                  0x54, 0x55, 0x40, 0x04, 0x15, 0x01, 0x10));
    const __m256i high = _mm256_add_epi8(low, low);
    const __m256i bytes = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 4, 2, 6, 1, 5, 3, 7, 8, 12, 10, 14, 9, 13, 11, 15));
    const __m256i nibble = _mm256_set1_epi8(15);

    s = _mm256_xor_si256(s, _mm256_set1_epi64x((long long)key));
    s = _mm256_or_si256(_mm256_shuffle_epi8(low, _mm256_and_si256(s, nibble)),
                        _mm256_shuffle_epi8(high, _mm256_and_si256(_mm256_srli_epi64(s, 4), nibble)));
    s = swap4(s, 6, 0x00cc00cc00cc00ccu);
    s = swap4(s, 12, 0x0000f0f00000f0f0u);
    return _mm256_shuffle_epi8(s, bytes);
}

/* The sum of the first `many` of four states, which may be none. */
AVX2 static inline uint64_t sum4(__m256i s, int many)
{
    __m256i kept = _mm256_and_si256(s, _mm256_cmpgt_epi64(_mm256_set1_epi64x(many), _mm256_setr_epi64x(0, 1, 2, 3)));
    __m128i two = _mm_xor_si128(_mm256_castsi256_si128(kept), _mm256_extracti128_si256(kept, 1));

    return (uint64_t)_mm_cvtsi128_si64(two) ^ (uint64_t)_mm_extract_epi64(two, 1);
}

/* The sum of `many` states, 1 to 8, encrypted; round keys as PRESENT has them. */
AVX2 static uint64_t sum_of(const uint64_t round[PHX_ROUNDS + 1u], const uint64_t s[8], unsigned many)
{
    __m256i one = _mm256_loadu_si256((const __m256i *)s), two = _mm256_loadu_si256((const __m256i *)(s + 4));
    uint64_t key = round[PHX_ROUNDS] & (0u - (uint64_t)(many & 1u)); /* an even number of times it is nothing */

    if (many <= 4u) {
        for (unsigned i = 0; i < PHX_ROUNDS; i++)
            one = round4(one, round[i]);
        return key ^ sum4(one, (int)many);
    }
    for (unsigned i = 0; i < PHX_ROUNDS; i++) {
        one = round4(one, round[i]);
        two = round4(two, round[i]);
    }
    return key ^ sum4(one, 4) ^ sum4(two, (int)many - 4);
}

/* Round keys as PRESENT has them, of those that the firmware keeps: pieces of 16 bits, each second key sliced. */
static void unpack(uint64_t round[PHX_ROUNDS + 1u], const uint16_t *kept)
{
    memcpy(round, kept, 8u * (PHX_ROUNDS + 1u));
    for (unsigned i = 1; i <= PHX_ROUNDS; i += 2u) {
        /* l, h, m to l, m, h to h, m, l. */
        uint64_t key = swap(swap(round[i], 3, 0x0a0a0a0a0a0a0a0au), 6, 0x00cc00cc00cc00ccu);
        round[i] = swap(swap(key, 15, 0x0000aaaa0000aaaau), 30, 0x00000000ccccccccu);
    }
}

/* All robots of a simulation have one mission key: the last two keys are kept unpacked. */
typedef struct {
    uint32_t number; /* no two keys of a thread have the same; 0 of none */
    phx_mac_key kept;
    uint64_t round[2][PHX_ROUNDS + 1u];
} known_key;

/* Two round keys have all bits of a key between them. */
static int is_same(const phx_mac_key *one, const phx_mac_key *other)
{
    return memcmp(one->round[0], other->round[0], 16) == 0 && memcmp(one->round[1], other->round[1], 16) == 0;
}

static const known_key *known(const phx_mac_key *key)
{
    static __thread known_key keys[2];
    static __thread uint32_t numbers;
    known_key *one = keys + (keys[0].number < keys[1].number ? 0 : 1); /* the older one gives way */

    for (unsigned i = 0; i < 2u; i++)
        if (keys[i].number != 0 && is_same(&keys[i].kept, key))
            return keys + i;
    one->number = ++numbers;
    one->kept = *key;
    unpack(one->round[0], key->round[0]);
    unpack(one->round[1], key->round[1]);
    return one;
}

/* What one robot's node made, another's checks a moment later: MACs of short messages are kept for a while. */
typedef struct {
    uint32_t key; /* its number */
    uint32_t len;
    uint64_t message[4];
    uint8_t mac[PHX_MAC_BYTES];
} made_mac;

enum { SHORT = 32, MADE = 2048 };

static made_mac *made(const known_key *key, const uint8_t *message, uint32_t len, uint64_t words[4])
{
    static __thread made_mac kept[MADE];
    uint64_t mixed = len;

    memcpy(words, message, len);
    for (unsigned i = 0; i < 4u; i++)
        mixed = (mixed ^ words[i] ^ key->number) * 0x9e3779b97f4a7c15u;
    return kept + (mixed >> 40) % MADE;
}

static void mac_of(const known_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    uint32_t blocks = len / 7u, left = len % 7u;
    uint64_t s[8] = {0}, sum = 0;
    uint8_t last[8] = {0};

    for (uint32_t done = 0; done < blocks;) {
        unsigned many = blocks - done < 8u ? blocks - done : 8u;
        for (unsigned i = 0; i < many; i++) {
            uint64_t block = 0;
            memcpy((uint8_t *)&block + 1, message + 7u * (done + i), 7);
            s[i] = __builtin_bswap64(block) | (uint64_t)(done + i + 1u) << 56;
        }
        sum ^= sum_of(key->round[0], s, many);
        done += many;
    }
    memcpy(last, message + 7u * blocks, left);
    last[left] = 0x80;
    sum ^= (uint64_t)load(last) << 32 | load(last + 4);
    s[0] = sum;
    sum = sum_of(key->round[1], s, 1);
    store(mac, (uint32_t)(sum >> 32), (uint32_t)sum);
    phx_host_counts[1] += blocks + 1u;
}

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    if (!(phx_host_uses & PHX_HOST_AVX2) || len > PHX_MAC_MESSAGE_MAX)
        return phx_plain_mac(key, message, len, mac);
    if (len > SHORT) {
        mac_of(known(key), message, len, mac);
    } else {
        const known_key *of = known(key);
        uint64_t words[4] = {0};
        made_mac *kept = made(of, message, len, words);
        if (kept->key != of->number || kept->len != len || memcmp(kept->message, words, sizeof words) != 0) {
            mac_of(of, message, len, kept->mac);
            kept->key = of->number;
            kept->len = len;
            memcpy(kept->message, words, sizeof words);
        }
        memcpy(mac, kept->mac, PHX_MAC_BYTES);
    }
    return 0;
}

#else

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    return phx_plain_mac(key, message, len, mac);
}

#endif

/* As in src/mac.c: every byte is looked at. */
int phx_mac_check(const phx_mac_key *key, const uint8_t *message, uint32_t len, const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t right[PHX_MAC_BYTES], differs = 0;

    if (!(phx_host_uses & PHX_HOST_AVX2) || len > PHX_MAC_MESSAGE_MAX)
        return phx_plain_mac_check(key, message, len, mac);
    (void)phx_mac(key, message, len, right);
    for (unsigned i = 0; i < PHX_MAC_BYTES; i++)
        differs |= right[i] ^ mac[i];
    return PHX_E_BAD_MAC * (int)((0u - differs) >> 31); /* times 0 or 1 */
}

int phx_lightmac(const uint8_t key[PHX_KEY_BYTES], const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    phx_mac_key expanded;
    int error;

    phx_mac_expand(&expanded, key);
    error = phx_mac(&expanded, message, len, mac);
    phx_wipe(&expanded, sizeof expanded);
    return error;
}
