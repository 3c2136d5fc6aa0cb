/* LightMAC over PRESENT-80: 64-bit tag, 8-bit counter, so 7 message bytes a block (Luykx et al., FSE 2016; Bogdanov
   et al., CHES 2007). Only this file compares MACs. No branch and no index depends on a key or on a state. */
#include <string.h>

#include "internal.h"

/* All 16 S-boxes of a round at once: the bits of a nibble as boolean functions (14 gates, Courtois et al. 2011), each
   variable in every fourth bit of a word. */
static uint64_t substitute(uint64_t s)
{
    const uint64_t every = 0x1111111111111111u;
    uint64_t x0 = s, x1 = s >> 1, x2 = s >> 2, x3 = s >> 3;
    uint64_t t1 = x1 ^ x2, t2 = x2 & t1, t3 = x3 ^ t2, y0 = x0 ^ t3, y1, y2, y3;

    t2 = (t1 & t3) ^ x2;
    t1 ^= y0;
    y1 = t1 ^ (x0 | t2);
    t2 ^= ~x0;
    y3 = y1 ^ t2;
    y2 = t3 ^ (t2 | t1);
    return (y0 & every) | (y1 & every) << 1 | (y2 & every) << 2 | (y3 & every) << 3;
}

static uint64_t swap(uint64_t x, unsigned by, uint64_t mask)
{
    uint64_t t = (x ^ (x >> by)) & mask;

    return x ^ t ^ (t << by);
}

/* Bit 16h + 4m + l goes to bit 16l + 4h + m: first m and l change places, then h and what is m now. */
static uint64_t permute(uint64_t s)
{
    s = swap(s, 3, 0x0a0a0a0a0a0a0a0au);
    s = swap(s, 6, 0x00cc00cc00cc00ccu);
    s = swap(s, 12, 0x0000f0f00000f0f0u);
    return swap(s, 24, 0x00000000ff00ff00u);
}

static uint64_t encrypt(const uint64_t round[PHX_ROUNDS + 1u], uint64_t s)
{
    for (unsigned i = 0; i < PHX_ROUNDS; i++)
        s = permute(substitute(s ^ round[i]));
    return s ^ round[PHX_ROUNDS];
}

static uint64_t load(const uint8_t bytes[8])
{
    uint64_t value = 0;

    for (unsigned i = 0; i < 8u; i++)
        value = (value << 8) | bytes[i];
    return value;
}

static void store(uint8_t bytes[8], uint64_t value)
{
    for (unsigned i = 0; i < 8u; i++)
        bytes[i] = (uint8_t)(value >> (56u - 8u * i));
}

static void expand(uint64_t round[PHX_ROUNDS + 1u], const uint8_t raw[10])
{
    uint64_t high = load(raw), low = ((uint64_t)raw[8] << 8) | raw[9]; /* bits 79..16 and 15..0 of the register */

    round[0] = high;
    for (unsigned i = 1; i <= PHX_ROUNDS; i++) {
        uint64_t turned = (high & 7u) << 61 | low << 45 | high >> 19; /* by 61 to the left */
        low = (high >> 3) & 0xffffu;
        high = (substitute(turned) & 0xf000000000000000u) | (turned & 0x0fffffffffffffffu);
        high ^= i >> 1;
        low ^= (uint64_t)(i & 1u) << 15;
        round[i] = high;
    }
}

void phx_mac_expand(phx_mac_key *key, const uint8_t raw[PHX_KEY_BYTES])
{
    expand(key->round[0], raw);
    expand(key->round[1], raw + PHX_KEY_BYTES / 2u);
}

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t last[8] = {0};
    uint64_t sum = 0;

    if (len > PHX_MAC_MESSAGE_MAX)
        return PHX_E_TOO_LONG;
    for (uint64_t counter = 1; len >= 7u; counter++) {
        uint8_t block[8];
        block[0] = (uint8_t)counter;
        memcpy(block + 1, message, 7);
        sum ^= encrypt(key->round[0], load(block));
        message += 7;
        len -= 7u;
    }
    memcpy(last, message, len);
    last[len] = 0x80;
    store(mac, encrypt(key->round[1], sum ^ load(last)));
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
    uint64_t round[PHX_ROUNDS + 1u];

    expand(round, key);
    store(cipher, encrypt(round, load(plain)));
    phx_wipe(round, sizeof round);
    return 0;
}
