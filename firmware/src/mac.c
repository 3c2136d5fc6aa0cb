/* LightMAC over PRESENT-80: 64-bit tag, 8-bit counter, so 7 message bytes a block (Luykx et al., FSE 2016; Bogdanov
   et al., CHES 2007). Only this file compares MACs. No branch and no index depends on a key or on a state.

   Two blocks at once (after Reis, Aranha, Lopez: PRESENT runs fast, CHES 2017). Bit 16h + 4m + l of a block, which is
   bit l of the nibble 4h + m, lies in word l, in place 4h + m of the block's half. The permutation sends l, h, m to
   m, l, h. So exchanging l with m is all of it, if from then on places are read as 4m + h; then l is exchanged with the
   other half of the place, and they are read as at first. The same exchanges take blocks apart and put them together: no
   bit of a block is ever moved one by one. */
#include <string.h>

#include "internal.h"

#define HALF 0xffffu

/* All S-boxes at once: the bits of a nibble as boolean functions (14 gates, Courtois et al. 2011). A macro, as are the
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
        w0 ^= (key)[0] | (uint32_t)(key)[0] << 16; \
        w1 ^= (key)[1] | (uint32_t)(key)[1] << 16; \
        w2 ^= (key)[2] | (uint32_t)(key)[2] << 16; \
        w3 ^= (key)[3] | (uint32_t)(key)[3] << 16; \
    } while (0)

/* Bits of `low` change places with those of `high` that are `by` places up. */
#define EXCHANGE(low, high, by, mask) do { \
        uint32_t t = ((low >> by) ^ high) & mask; \
        high ^= t; \
        low ^= t << by; \
    } while (0)

/* Of the number of each word and that of each place: the word's with the place's low half, and with its high half. */
#define TURN_LOW() do { \
        EXCHANGE(w0, w1, 1, 0x55555555u); \
        EXCHANGE(w2, w3, 1, 0x55555555u); \
        EXCHANGE(w0, w2, 2, 0x33333333u); \
        EXCHANGE(w1, w3, 2, 0x33333333u); \
    } while (0)
#define TURN_HIGH() do { \
        EXCHANGE(w0, w1, 4, 0x0f0f0f0fu); \
        EXCHANGE(w2, w3, 4, 0x0f0f0f0fu); \
        EXCHANGE(w0, w2, 8, 0x00ff00ffu); \
        EXCHANGE(w1, w3, 8, 0x00ff00ffu); \
    } while (0)
/* w: of each of two blocks the low word, then the high ones. They come out sliced: word l, place 4h + m. */
static void encrypt(const uint16_t *round, uint32_t w[4])
{
    uint32_t w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];

    EXCHANGE(w0, w1, 16, HALF); /* to one h of both each */
    EXCHANGE(w2, w3, 16, HALF);
    for (unsigned i = 1;; i += 2u, round += 8) {
        ADD_KEY(round); /* word h, place 4m + l */
        TURN_LOW();
        SUBSTITUTE(w0, w1, w2, w3);
        TURN_HIGH();
        ADD_KEY(round + 4);
        if (i == PHX_ROUNDS)
            break;
        SUBSTITUTE(w0, w1, w2, w3);
    }
    w[0] = w0;
    w[1] = w1;
    w[2] = w2;
    w[3] = w3;
}

/* Word l, place 4h + m to word h, place 4m + l, or back. */
static void turned(uint32_t w[4], unsigned back)
{
    uint32_t w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];

    for (unsigned n = 0; n < 2u; n++) {
        if (n == back)
            TURN_LOW();
        else
            TURN_HIGH();
    }
    w[0] = w0;
    w[1] = w1;
    w[2] = w2;
    w[3] = w3;
}

/* What came out sliced as words of two blocks. */
static void whole(uint32_t w[4])
{
    turned(w, 0);
    EXCHANGE(w[0], w[1], 16, HALF);
    EXCHANGE(w[2], w[3], 16, HALF);
}

static uint32_t load(const uint8_t bytes[4])
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static void store(uint8_t bytes[8], uint32_t high, uint32_t low)
{
    for (unsigned i = 0; i < 4u; i++) {
        bytes[i] = (uint8_t)(high >> (24u - 8u * i));
        bytes[4u + i] = (uint8_t)(low >> (24u - 8u * i));
    }
}

/* A register of 80 bits: 79..48, 47..16, 15..0. Each round's key is turned as blocks are when it is added. */
static void expand(uint16_t *round, const uint8_t raw[PHX_KEY_BYTES / 2u])
{
    uint32_t high = load(raw), mid = load(raw + 4), low = (uint32_t)raw[8] << 8 | raw[9], w[4];

    for (unsigned i = 0;;) {
        uint32_t up = mid << 29 | low << 13 | high >> 19; /* by 61 to the left */
        uint32_t x0 = up >> 28, x1 = up >> 29, x2 = up >> 30, x3 = up >> 31;
        w[0] = mid & HALF;
        w[1] = mid >> 16;
        w[2] = high & HALF;
        w[3] = high >> 16;
        if (i % 2u != 0)
            turned(w, 1);
        *round++ = (uint16_t)w[0];
        *round++ = (uint16_t)w[1];
        *round++ = (uint16_t)w[2];
        *round++ = (uint16_t)w[3];
        if (i++ == PHX_ROUNDS)
            break;
        SUBSTITUTE(x0, x1, x2, x3);
        low = (mid >> 3 & HALF) ^ (i & 1u) << 15;
        mid = (high << 13 | mid >> 19) ^ i >> 1;
        high = (up & 0x0fffffffu) | x3 << 31 | (x2 & 1u) << 30 | (x1 & 1u) << 29 | (x0 & 1u) << 28;
    }
    phx_wipe(w, sizeof w);
}

void phx_mac_expand(phx_mac_key *key, const uint8_t raw[PHX_KEY_BYTES])
{
    expand(key->round[0], raw);
    expand(key->round[1], raw + PHX_KEY_BYTES / 2u);
}

/* A block of the message, after its number. */
static void numbered(uint32_t *w, uint32_t number, const uint8_t message[7])
{
    w[0] = load(message + 3);
    w[2] = number << 24 | (uint32_t)message[0] << 16 | (uint32_t)message[1] << 8 | message[2];
}

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t last[8] = {0};
    uint32_t sum[4] = {0}, w[4];

    if (len > PHX_MAC_MESSAGE_MAX)
        return PHX_E_TOO_LONG;
    for (uint32_t number = 1; len >= 7u; number += 2u) {
        uint32_t more = len >= 14u ? 7u : 0, mask = more ? ~(uint32_t)0 : HALF;
        numbered(w, number, message);
        numbered(w + 1, number + 1u, message + more); /* or the same again, which does not count */
        encrypt(key->round[0], w);
        for (unsigned i = 0; i < 4u; i++)
            sum[i] ^= w[i] & mask;
        message += 7u + more;
        len -= 7u + more;
    }
    whole(sum);
    memcpy(last, message, len);
    last[len] = 0x80;
    w[0] = sum[0] ^ sum[1] ^ load(last + 4);
    w[2] = sum[2] ^ sum[3] ^ load(last);
    w[1] = w[3] = 0;
    encrypt(key->round[1], w);
    whole(w);
    store(mac, w[2], w[0]);
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
    uint16_t round[4u * (PHX_ROUNDS + 1u)];
    uint32_t w[4] = {load(plain + 4), 0, load(plain), 0};

    expand(round, key);
    encrypt(round, w);
    whole(w);
    store(cipher, w[2], w[0]);
    phx_wipe(round, sizeof round);
    return 0;
}
