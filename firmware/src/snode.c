/* The s-node (Alg. 3). */
#include <string.h>

#include "internal.h"

size_t phx_snode_size(void)
{
    return sizeof(phx_snode);
}

int phx_snode_make(phx_snode *s, const phx_limits *limits)
{
    int error = phx_node_make(&s->node, limits);

    if (!error)
        phx_snode_power_up(s);
    return error;
}

void phx_snode_power_up(phx_snode *s)
{
    phx_flash kept = s->node.flash;

    memset(s, 0, sizeof *s);
    s->node.flash = kept;
    phx_no_key(&s->node);
}

int phx_snode_load_master(phx_snode *s, const uint8_t key[PHX_KEY_BYTES], uint16_t id)
{
    return phx_node_load_master(&s->node, key, id);
}

int phx_snode_load_mission(phx_snode *s, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                           uint32_t seq, const uint8_t mac[PHX_MAC_BYTES])
{
    return phx_node_load_mission(&s->node, now, k, r, seq, mac);
}

int phx_snode_poll(phx_snode *s, uint32_t now, const uint8_t *reading, uint32_t len, uint8_t *entry)
{
    int error = phx_may_forward(&s->node, now, len);

    return error ? error : phx_entry(&s->node, PHX_ENTRY_INPUT, now, reading, len, entry);
}

int phx_snode_make_auth(phx_snode *s, const uint8_t nonce[PHX_NONCE_BYTES], uint8_t out[PHX_AUTH_OUT_BYTES])
{
    return phx_make_auth(&s->node, PHX_AUTH_S, nonce, out);
}

int phx_snode_check_auth(phx_snode *s, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                         const uint8_t nonce[PHX_NONCE_BYTES], const uint8_t mac[PHX_MAC_BYTES])
{
    return phx_check_auth(&s->node, PHX_AUTH_S, thash, id, nonce, mac);
}
