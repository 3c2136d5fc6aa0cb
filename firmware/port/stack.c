/* Host only: after a mission key is loaded, neither it, its last round nor the master key is left where the call's stack was;
   and in Safe Mode a node has none, neither as bytes nor as the flag that says so. */
#include <stdio.h>
#include <string.h>

#include "../src/internal.h"

#define DEPTH 16384u

/* As letters, so that they are not met by chance. */
static const uint8_t master[] = "the master key of it", mission[] = "and its mission key.";

/* More bytes below the caller's frame than any call uses, written, or read through for eight bytes of a key. */
static unsigned __attribute__((noinline)) below(const uint8_t *key)
{
    volatile uint8_t left[DEPTH];
    unsigned found = 0;

    for (uint32_t i = 0; !key && i < DEPTH; i++)
        left[i] = 0xEE;
    for (uint32_t i = 0; key && i + 8u < DEPTH; i++) {
        uint32_t same = 0;
        while (same < 8u && left[i + same] == key[same])
            same++;
        found += same == 8u;
    }
    return found;
}

static int has_none(const phx_node *node)
{
    const uint8_t *bytes = (const uint8_t *)&node->key;
    uint8_t any = node->has_key;

    for (size_t i = 0; i < sizeof node->key; i++)
        any |= bytes[i];
    return !any;
}

int main(void)
{
    static phx_anode node;
    static const phx_limits limits = {1, 10000, 10, 1, 1, 1, 1, 1, 1, 0, 0, 0};
    uint8_t message[PHX_MKEY_BYTES] = {PHX_MKEY}, blind[2 * PHX_KEY_BYTES] = {9}, mac[PHX_MAC_BYTES], k[PHX_HASH_BYTES];
    uint32_t last[4]; /* what the key's expansion ended with */
    unsigned after;
    int error;

    memcpy(blind + PHX_KEY_BYTES, master, PHX_KEY_BYTES);
    phx_sha1(blind, sizeof blind, k);
    for (unsigned i = 0; i < PHX_KEY_BYTES; i++)
        k[i] ^= mission[i];
    memcpy(message + PHX_MKEY_K, k, PHX_KEY_BYTES);
    memcpy(message + PHX_MKEY_R, blind, PHX_KEY_BYTES);
    phx_put32(message + PHX_MKEY_SEQ, 1);
    phx_lightmac(master, message, sizeof message, mac);
    error = phx_anode_make(&node, &limits) || phx_anode_load_master(&node, master, 1);
    below(NULL);
    error |= phx_anode_load_mission(&node, 0, k, blind, 1, mac);
    for (unsigned i = 0; i < 4u; i++)
        last[i] = node.node.key.round[1][4u * PHX_ROUNDS + i];
    after = below(mission) + below(master) + below((const uint8_t *)last);
    if (error || after)
        printf("error %d, %u pieces of keys are left on the stack\n", error, after);
    if (has_none(&node.node) || !phx_anode_check(&node, limits.t_val_ms) || !has_none(&node.node)) {
        printf("a key outlives Safe Mode, or none was there\n");
        error = 1;
    }
    return error || after;
}
