/* What stands for hash.c and mac.c in calls.c: any hash and any MAC, over bytes that must be there to be read. A proof
   that holds for these holds for SHA-1 and LightMAC, whose own memory hash.c and mac.c are about. */
#include "proofs.h"

/* Copies of more than this are looked at, not made: nothing that is proved reads what they wrote. */
#define COPIED 32u

void *memcpy(void *to, const void *from, size_t size)
{
    uint8_t *out = to;
    const uint8_t *in = from;

    there(to, size);
    there(from, size);
    for (size_t i = 0; i < size && size <= COPIED; i++)
        out[i] = in[i];
    return to;
}

void phx_hash_start(phx_hash *hash)
{
    hash->bytes = 0;
}

void phx_hash_add(phx_hash *hash, const uint8_t *data, uint32_t len)
{
    there(data, len);
    hash->bytes += len;
}

void phx_hash_end(phx_hash *hash, uint8_t out[PHX_HASH_BYTES])
{
    for (unsigned i = 0; i < PHX_HASH_BYTES; i++)
        out[i] = chance.hash[chance.drawn % DRAWS][i];
    chance.drawn++;
}

void phx_mac_expand(phx_mac_key *key, const uint8_t raw[PHX_KEY_BYTES])
{
    there(raw, PHX_KEY_BYTES);
    key->round[0][0] = raw[0];
}

int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES])
{
    there(key, sizeof *key);
    there(message, len);
    if (len > PHX_MAC_MESSAGE_MAX)
        return PHX_E_TOO_LONG;
    for (unsigned i = 0; i < PHX_MAC_BYTES; i++)
        mac[i] = chance.mac[i];
    return 0;
}

int phx_mac_check(const phx_mac_key *key, const uint8_t *message, uint32_t len, const uint8_t mac[PHX_MAC_BYTES])
{
    there(key, sizeof *key);
    there(message, len);
    there(mac, PHX_MAC_BYTES);
    return chance.right ? 0 : PHX_E_BAD_MAC;
}

void phx_wipe(void *memory, size_t size)
{
    there(memory, size);
    __builtin_memset(memory, 0, size);
}

/* What prove_draw shows of the one in bucket.c. */
int phx_draw(phx_bucket *bucket, uint32_t now, uint32_t per_ms, uint64_t capacity, uint64_t cost)
{
    (void)per_ms;
    (void)cost;
    always(bucket->level <= capacity && bucket->filled_at_ms <= now, "buckets: sound before they are drawn from");
    given(chance.level <= capacity);
    bucket->level = chance.level;
    bucket->filled_at_ms = now;
    return chance.enough ? 0 : -1;
}
