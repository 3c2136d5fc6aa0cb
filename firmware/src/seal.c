/* The sealed radio (docs/spec/sealed-radio.md): what the a-node sends is signed with its time, and what it takes is new. */
#include <string.h>

#include "internal.h"
#include "phx_seal.h"

static uint32_t get32(const uint8_t *at)
{
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* The seal has time and sender; they and the packet's hash are what its MAC is over. */
static void sealed_bytes(uint8_t out[PHX_SEALED_BYTES], const uint8_t *seal, const uint8_t *packet, uint32_t len)
{
    phx_hash hash;

    out[0] = PHX_SEALED;
    memcpy(out + PHX_SEALED_T, seal + PHX_SEAL_T, PHX_SEAL_MAC);
    phx_hash_start(&hash);
    phx_hash_add(&hash, packet, len);
    phx_hash_end(&hash, out + PHX_SEALED_HASH);
}

int phx_sealed_make(phx_anode *a)
{
    if (a->node.flash.has_master)
        return PHX_E_SEQ;
    a->node.flash.sealed = 1;
    return 0;
}

int phx_sealed_send(phx_seals *seals, phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry)
{
    uint8_t message[PHX_SEALED_BYTES], *seal;
    int size = phx_may_forward(&a->node, now, len);

    if (size < 0)
        return size;
    if (len > PHX_PACKET_MAX - PHX_SEAL_BYTES)
        return PHX_E_TOO_LONG;
    /* No two packets have the same time. But who could seal times to come in any number could hold packets back until then. */
    if (seals->t >= now && (seals->t - now >= PHX_SEAL_AHEAD_MS || seals->t == UINT32_MAX))
        return PHX_E_AIRTIME;
    size = phx_anode_send(a, now, packet, len, entry);
    if (size < 0)
        return size;
    seals->t = seals->t < now ? now : seals->t + 1u;
    seal = entry + size;
    phx_put32(seal + PHX_SEAL_T, seals->t);
    phx_put16(seal + PHX_SEAL_SRC, a->node.flash.robot_id);
    sealed_bytes(message, seal, entry + PHX_ENTRY_HEADER_BYTES, len);
    phx_mac(&a->node.key, message, sizeof message, seal + PHX_SEAL_MAC);
    return size + (int)PHX_SEAL_BYTES;
}

/* How much later a packet is than its sender's quickest. Clocks begin anywhere; if ours runs faster, all of it comes ever
   later, as slowly as clocks drift. */
static int64_t late_ms(const phx_source *of, uint32_t now, uint32_t t)
{
    uint32_t since = now - of->quickest_ms;

    return (int64_t)(since - (since >> PHX_SEAL_DRIFT_SHIFT)) - ((int64_t)t - of->quickest_t);
}

/* The sender's place, or a new one: a free one, or that of the sender whose newest packet is oldest, by its own time, and
   older than a token may be. Places fill in order. */
static phx_source *place_of(phx_seals *seals, uint32_t now, uint16_t src, uint32_t t_val_ms)
{
    phx_source *place = 0;
    int64_t oldest = t_val_ms;

    for (unsigned i = 0; i < PHX_SOURCES; i++) {
        phx_source *each = &seals->sources[i];
        int64_t age = late_ms(each, now, each->newest);
        if (each->src == src || each->src == 0)
            return each;
        if (age > oldest) {
            oldest = age;
            place = each;
        }
    }
    return place;
}

/* By words: processors of 32 bits have no shift of 64, but call a library that is not there. */
static void shift(uint32_t seen[2], uint32_t by)
{
    if (by >= 32u) {
        seen[1] = seen[0];
        seen[0] = 0;
        by -= 32u;
    }
    if (by) {
        seen[1] = seen[1] << by | seen[0] >> (32u - by);
        seen[0] <<= by;
    }
}

/* A true seal counts once, and not late. */
static int take(phx_seals *seals, uint32_t now, uint16_t src, uint32_t t, uint32_t t_val_ms)
{
    phx_source *of = place_of(seals, now, src, t_val_ms);
    uint32_t away;
    int64_t late;

    if (!of)
        return PHX_E_FULL;
    if (of->src != src) {
        of->src = src;
        of->seen[0] = 1;
        of->seen[1] = 0;
        of->newest = of->quickest_t = t;
        of->quickest_ms = now;
        return 0;
    }
    away = t > of->newest ? t - of->newest : of->newest - t;
    if (t <= of->newest && (away >= PHX_SEAL_WINDOW_MS || of->seen[away >> 5] >> (away & 31u) & 1u))
        return PHX_E_REPEATED;
    late = late_ms(of, now, t);
    if (late > PHX_SEAL_LATE_MS)
        return PHX_E_LATE;
    if (late < 0) {
        of->quickest_t = t;
        of->quickest_ms = now;
    }
    if (t <= of->newest) {
        of->seen[away >> 5] |= (uint32_t)1 << (away & 31u);
        return 0;
    }
    if (away < PHX_SEAL_WINDOW_MS)
        shift(of->seen, away);
    else
        of->seen[0] = of->seen[1] = 0;
    of->seen[0] |= 1u;
    of->newest = t;
    return 0;
}

int phx_sealed_recv(phx_seals *seals, phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry)
{
    uint8_t message[PHX_SEALED_BYTES];
    const uint8_t *seal;
    uint16_t src;
    int error = phx_may_forward(&a->node, now, len);

    if (error)
        return error;
    if (len <= PHX_SEAL_BYTES)
        return PHX_E_ARG;
    len -= PHX_SEAL_BYTES;
    seal = packet + len;
    sealed_bytes(message, seal, packet, len);
    error = phx_mac_check(&a->node.key, message, sizeof message, seal + PHX_SEAL_MAC);
    if (error)
        return error;
    src = (uint16_t)(seal[PHX_SEAL_SRC] | seal[PHX_SEAL_SRC + 1u] << 8);
    if (src == 0)
        return PHX_E_ARG;
    if (src == a->node.flash.robot_id)
        return PHX_E_SELF;
    error = take(seals, now, src, get32(seal + PHX_SEAL_T), a->node.flash.limits.t_val_ms);
    return error ? error : phx_anode_recv(a, now, packet, len, entry);
}
