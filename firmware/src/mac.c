/* LightMAC over PRESENT-80: 64-bit tag, 8-bit counter, so 7 message bytes a block (Luykx et al., FSE 2016; Bogdanov
   et al., CHES 2007). Only this file compares MACs. No branch and no index depends on a key or on a state.

   Two blocks at once (after Reis, Aranha, Lopez: PRESENT runs fast, CHES 2017). Bit 16h + 4m + l of a block, which is
   bit l of the nibble 4h + m, lies in word l, in place 4h + m of the block's half. The permutation sends l, h, m to
   m, l, h. So exchanging l with m is all of it, if from then on places are read as 4m + h; then l is exchanged with the
   other half of the place, and they are read as at first. No bit of a block is ever moved one by one. */
#include <string.h>

#include "internal.h"

/* All S-boxes at once: the bits of a nibble as boolean functions (14 gates, Courtois et al. 2011). A macro, as is the
   next: a compiler that is told to be small would call a function, and keep the words in memory. */
#define SUBSTITUTE(x0, x1, x2, x3) do { \
        uint32_t t1 = x1 ^ x2, t2 = x2 & t1, t3 = x3 ^ t2, y0 = x0 ^ t3; \
        t2 = (t1 & t3) ^ x2; \
        t1 ^= y0; \
        x1 = t1 ^ (x0 | t2); \
        t2 ^= ~x0; \
        x0 = y0; \
        x3 = x1 ^ t2; \
        x2 = t3 ^ (t2 | t1); \
    } while (0)

/* The same to both blocks. */
#define ADD_KEY(key) do { \
        uint32_t k0 = (uint32_t)(key), k2 = (uint32_t)((key) >> 32); \
        w0 ^= (k0 & half) | k0 << 16; \
        w1 ^= k0 >> 16 | (k0 & ~half); \
        w2 ^= (k2 & half) | k2 << 16; \
        w3 ^= k2 >> 16 | (k2 & ~half); \
    } while (0)

/* Bits of `low` change places with those of `high` that are `by` places up. */
#define EXCHANGE(low, high, by, mask) do { \
        uint32_t t = ((low >> by) ^ high) & mask; \
        high ^= t; \
        low ^= t << by; \
    } while (0)

static uint32_t swap(uint32_t x, unsigned by, uint32_t mask)
{
    uint32_t t = (x ^ (x >> by)) & mask;

    return x ^ t ^ (t << by);
}

/* l, h, m to l, m, h, and back. Halves are handled alone: 64 bits are two registers. */
static uint64_t turned(uint64_t words)
{
    uint32_t low = (uint32_t)words, high = (uint32_t)(words >> 32);

    low = swap(swap(low, 3, 0x0a0a0a0au), 6, 0x00cc00ccu);
    high = swap(swap(high, 3, 0x0a0a0a0au), 6, 0x00cc00ccu);
    return (uint64_t)high << 32 | low;
}

/* A block, h, m, l, as its four words: l, m, h, as before each second round and in the end; and back. */
static uint64_t sliced(uint64_t block)
{
    uint32_t low = swap((uint32_t)block, 15, 0x0000aaaau), high = swap((uint32_t)(block >> 32), 15, 0x0000aaaau);

    EXCHANGE(low, high, 2, 0x33333333u);
    return (uint64_t)high << 32 | low;
}

/* Two blocks, sliced and turned; what comes of them is sliced only. */
static void encrypt(const uint64_t round[PHX_ROUNDS + 1u], uint64_t block[2])
{
    const uint32_t half = 0xffffu;
    uint32_t a0 = (uint32_t)block[0], a2 = (uint32_t)(block[0] >> 32);
    uint32_t b0 = (uint32_t)block[1], b2 = (uint32_t)(block[1] >> 32);
    uint32_t w0 = (a0 & half) | b0 << 16, w1 = a0 >> 16 | (b0 & ~half);
    uint32_t w2 = (a2 & half) | b2 << 16, w3 = a2 >> 16 | (b2 & ~half);

    for (unsigned i = 0;; i += 2u) {
        ADD_KEY(round[i]);
        SUBSTITUTE(w0, w1, w2, w3);
        EXCHANGE(w0, w1, 1, 0x55555555u);
        EXCHANGE(w2, w3, 1, 0x55555555u);
        EXCHANGE(w0, w2, 2, 0x33333333u);
        EXCHANGE(w1, w3, 2, 0x33333333u);
        ADD_KEY(round[i + 1u]);
        if (i + 1u == PHX_ROUNDS)
            break;
        SUBSTITUTE(w0, w1, w2, w3);
        EXCHANGE(w0, w1, 4, 0x0f0f0f0fu);
        EXCHANGE(w2, w3, 4, 0x0f0f0f0fu);
        EXCHANGE(w0, w2, 8, 0x00ff00ffu);
        EXCHANGE(w1, w3, 8, 0x00ff00ffu);
    }
    block[0] = (uint64_t)((w2 & half) | w3 << 16) << 32 | ((w0 & half) | w1 << 16);
    block[1] = (uint64_t)(w2 >> 16 | (w3 & ~half)) << 32 | (w0 >> 16 | (w1 & ~half));
}

static uint64_t load(const uint8_t bytes[8])
{
    uint32_t high = (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
    uint32_t low = (uint32_t)bytes[4] << 24 | (uint32_t)bytes[5] << 16 | (uint32_t)bytes[6] << 8 | bytes[7];

    return (uint64_t)high << 32 | low;
}

static void store(uint8_t bytes[8], uint64_t value)
{
    for (unsigned i = 0; i < 8u; i++)
        bytes[i] = (uint8_t)(value >> (56u - 8u * i));
}

static void expand(uint64_t round[PHX_ROUNDS + 1u], const uint8_t raw[10])
{
    uint64_t high = load(raw), low = ((uint64_t)raw[8] << 8) | raw[9]; /* bits 79..16 and 15..0 of the register */

    round[0] = turned(sliced(high));
    for (unsigned i = 1; i <= PHX_ROUNDS; i++) {
        uint64_t up = (high & 7u) << 61 | low << 45 | high >> 19; /* by 61 to the left */
        uint32_t x0 = (uint32_t)(up >> 60), x1 = x0 >> 1, x2 = x0 >> 2, x3 = x0 >> 3;
        low = (high >> 3) & 0xffffu;
        SUBSTITUTE(x0, x1, x2, x3);
        x0 = (x0 & 1u) | (x1 & 1u) << 1 | (x2 & 1u) << 2 | (x3 & 1u) << 3;
        high = (up & 0x0fffffffffffffffu) | (uint64_t)x0 << 60;
        high ^= i >> 1;
        low ^= (uint64_t)(i & 1u) << 15;
        round[i] = i % 2u == 0 ? turned(sliced(high)) : sliced(high);
    }
}

void phx_mac_expand(phx_mac_key *key, const uint8_t raw[PHX_KEY_BYTES])
{
    expand(key->round[0], raw);
    expand(key->round[1], raw + PHX_KEY_BYTES / 2u);
}

/* A block of the message, after its number; sliced and turned. */
static uint64_t numbered(uint32_t number, const uint8_t message[7])
{
    uint8_t block[8];

    block[0] = (uint8_t)number;
    memcpy(block + 1, message, 7);
    return turned(sliced(load(block)));
}

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t last[8] = {0};
    uint64_t sum = 0, block[2];

    if (len > PHX_MAC_MESSAGE_MAX)
        return PHX_E_TOO_LONG;
    for (uint32_t number = 1; len >= 7u; number += 2u) {
        uint32_t two = len >= 14u;
        block[0] = numbered(number, message);
        block[1] = two ? numbered(number + 1u, message + 7) : 0;
        encrypt(key->round[0], block);
        sum ^= two ? block[0] ^ block[1] : block[0];
        message += two ? 14 : 7;
        len -= two ? 14u : 7u;
    }
    memcpy(last, message, len);
    last[len] = 0x80;
    block[0] = turned(sum ^ sliced(load(last)));
    block[1] = 0;
    encrypt(key->round[1], block);
    store(mac, sliced(block[0]));
    return 0;
}

int phx_mac_check(const phx_mac_key *key, const uint8_t *message, uint32_t len, const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t right[PHX_MAC_BYTES], differs = 0;
    int error = phx_mac(key, message, len, right);

    if (error)
        return error;
    for (unsigned i = 0; i < PHX_MAC_BYTES; i++)
        differs |= right[i] ^ mac[i];
    return PHX_E_BAD_MAC * (int)((0u - differs) >> 31); /* times 0 or 1 */
}

/* A compiler leaves out a memset of what nobody reads again. */
void phx_wipe(void *memory, size_t size)
{
    volatile uint8_t *bytes = memory;

    while (size-- > 0)
        *bytes++ = 0;
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

int phx_present80(const uint8_t key[10], const uint8_t plain[8], uint8_t cipher[8])
{
    uint64_t round[PHX_ROUNDS + 1u], block[2] = {0, 0};

    expand(round, key);
    block[0] = turned(sliced(load(plain)));
    encrypt(round, block);
    store(cipher, sliced(block[0]));
    phx_wipe(round, sizeof round);
    return 0;
}
