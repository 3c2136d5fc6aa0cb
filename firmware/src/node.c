/* What s-node and a-node share: keys, Safe Mode, the chain, authenticators (Alg. 2). */
#include <string.h>

#include "internal.h"

void phx_put16(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

void phx_put32(uint8_t *at, uint32_t value)
{
    phx_put16(at, value);
    phx_put16(at + 2, value >> 16);
}

int phx_node_make(phx_node *node, const phx_limits *limits)
{
    if (limits->f_max > PHX_F_MAX || !limits->t_val_ms || !limits->batch_size || !limits->bucket_capacity ||
        !limits->bucket_period_ms || !limits->send_us_per_s || !limits->send_capacity_us || !limits->audit_us_per_s ||
        !limits->audit_capacity_us)
        return PHX_E_ARG;
    memset(&node->flash, 0, sizeof node->flash);
    node->flash.limits = *limits;
    return 0;
}

int phx_node_load_master(phx_node *node, const uint8_t key[PHX_KEY_BYTES], uint16_t id)
{
    if (id == 0)
        return PHX_E_ARG;
    if (node->flash.has_master)
        return PHX_E_SEQ;
    memcpy(node->flash.master, key, PHX_KEY_BYTES);
    node->flash.robot_id = id;
    node->flash.has_master = (uint8_t)phx_is_key(key);
    return 0;
}

static int mkey_check(const phx_node *node, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                      uint32_t seq, const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t message[PHX_MKEY_BYTES];
    phx_mac_key master;
    int error;

    message[0] = PHX_MKEY;
    memcpy(message + PHX_MKEY_K, k, PHX_KEY_BYTES);
    memcpy(message + PHX_MKEY_R, r, PHX_KEY_BYTES);
    phx_put32(message + PHX_MKEY_SEQ, seq);
    phx_mac_expand(&master, node->flash.master);
    error = phx_mac_check(&master, message, sizeof message, mac);
    phx_wipe(&master, sizeof master);
    return error;
}

int phx_node_load_mission(phx_node *node, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                          uint32_t seq, const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t key[PHX_KEY_BYTES];
    phx_hash hash;
    int error = phx_clock(node, now);

    if (error)
        return error;
    if (node->safe)
        return PHX_E_SAFE_MODE;
    error = phx_may_load(node);
    if (error)
        return error;
    error = mkey_check(node, k, r, seq, mac);
    if (error)
        return error;
    /* A second key in one power-up would bring a second time of grace. */
    if (seq <= node->flash.key_seq || node->was_keyed)
        return PHX_E_SEQ;
    node->flash.key_seq = seq;
    phx_hash_start(&hash);
    phx_hash_add(&hash, r, PHX_KEY_BYTES);
    phx_hash_add(&hash, node->flash.master, PHX_KEY_BYTES);
    phx_hash_end(&hash, key);
    for (unsigned i = 0; i < PHX_KEY_BYTES; i++)
        key[i] ^= k[i];
    phx_mac_expand(&node->key, key);
    node->has_key = (uint8_t)phx_is_key(key);
    node->was_keyed = 1;
    phx_wipe(key, sizeof key);
    phx_wipe(&hash, sizeof hash);
    return 0;
}

/* At the clock's end old tokens would come to life again. */
int phx_clock(phx_node *node, uint32_t now)
{
    if (now != UINT32_MAX)
        return 0;
    phx_safe_mode(node);
    return PHX_E_CLOCK;
}

void phx_safe_mode(phx_node *node)
{
    node->safe = 1;
    phx_no_key(node);
}

int phx_may_forward(phx_node *node, uint32_t now, uint32_t len)
{
    int error = phx_clock(node, now);

    if (error)
        return error;
    if (node->safe)
        return PHX_E_SAFE_MODE;
    if (!node->has_key)
        return PHX_E_NO_KEY;
    if (len > PHX_PACKET_MAX)
        return PHX_E_TOO_LONG;
    return len == 0 ? PHX_E_ARG : 0;
}

int phx_entry(phx_node *node, uint8_t type, uint32_t now, const uint8_t *payload, uint32_t len, uint8_t *entry)
{
    int audit = (type == PHX_ENTRY_RECV || type == PHX_ENTRY_SEND) && (payload[0] & PHX_KIND_AUDIT);

    entry[0] = type;
    phx_put32(entry + 1, now);
    phx_put16(entry + 5, len);
    memcpy(entry + PHX_ENTRY_HEADER_BYTES, payload, len);
    if (!audit)
        phx_chain(node, entry, PHX_ENTRY_HEADER_BYTES + len);
    return (int)(PHX_ENTRY_HEADER_BYTES + len);
}

/* The batch is hashed as it comes instead of kept: the same bytes, without ten packets of RAM. */
void phx_chain(phx_node *node, const uint8_t *entry, uint32_t len)
{
    if (node->batched == 0) {
        phx_hash_start(&node->batch);
        phx_hash_add(&node->batch, node->top, PHX_HASH_BYTES);
    }
    phx_hash_add(&node->batch, entry, len);
    if (++node->batched == node->flash.limits.batch_size)
        phx_flush(node);
}

void phx_flush(phx_node *node)
{
    if (node->batched > 0)
        phx_hash_end(&node->batch, node->top);
    node->batched = 0;
}

int phx_make_auth(phx_node *node, uint8_t type, const uint8_t *nonce, uint8_t out[PHX_AUTH_OUT_BYTES])
{
    uint8_t message[PHX_AUTH_S_BYTES];
    int error = phx_may_mac(node);

    if (error)
        return error;
    phx_flush(node);
    memcpy(out, node->top, PHX_HASH_BYTES);
    phx_put16(out + PHX_HASH_BYTES, node->flash.robot_id);
    return phx_mac(&node->key, message, phx_auth_bytes(message, type, node->top, node->flash.robot_id, nonce),
                   out + PHX_HASH_BYTES + 2);
}

int phx_check_auth(const phx_node *node, uint8_t type, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                   const uint8_t *nonce, const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t message[PHX_AUTH_S_BYTES];
    int error = phx_may_mac(node);

    if (error)
        return error;
    return phx_mac_check(&node->key, message, phx_auth_bytes(message, type, thash, id, nonce), mac);
}
