/* The a-node (Alg. 4): radio, actuators, tokens. */
#include <string.h>

#include "internal.h"

size_t phx_anode_size(void)
{
    return sizeof(phx_anode);
}

int phx_anode_make(phx_anode *a, const phx_limits *limits)
{
    int error = phx_node_make(&a->node, limits);

    if (!error)
        phx_anode_power_up(a);
    return error;
}

void phx_anode_power_up(phx_anode *a)
{
    phx_flash kept = a->node.flash;

    memset(a, 0, sizeof *a);
    a->node.flash = kept;
    phx_no_key(&a->node);
}

int phx_anode_load_master(phx_anode *a, const uint8_t key[PHX_KEY_BYTES], uint16_t id)
{
    return phx_node_load_master(&a->node, key, id);
}

int phx_anode_load_mission(phx_anode *a, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                           uint32_t seq, const uint8_t mac[PHX_MAC_BYTES])
{
    int error = phx_node_load_mission(&a->node, now, k, r, seq, mac);

    if (error)
        return error;
    a->keyed_at_ms = now;
    phx_anode_mission_starts(a, now);
    return 0;
}

int phx_anode_recv(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry)
{
    int error = phx_may_forward(&a->node, now, len);

    return error ? error : phx_entry(&a->node, PHX_ENTRY_RECV, now, packet, len, entry);
}

int phx_anode_send(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry)
{
    int error = phx_may_forward(&a->node, now, len);
    int size;

    if (!error)
        error = phx_send_rules(a, now, packet, len);
    if (error)
        return error;
    size = phx_entry(&a->node, PHX_ENTRY_SEND, now, packet, len, entry);
    if (packet[0] & PHX_KIND_AUDIT)
        phx_mark_source(&a->node, entry + PHX_ENTRY_HEADER_BYTES);
    return size;
}

int phx_anode_actuate(phx_anode *a, uint32_t now, const uint8_t *cmd, uint32_t len, uint8_t *entry)
{
    int error = phx_may_forward(&a->node, now, len);

    return error ? error : phx_entry(&a->node, PHX_ENTRY_ACMD, now, cmd, len, entry);
}

int phx_anode_token_request(phx_anode *a, uint32_t now, uint16_t auditor, uint8_t out[PHX_TREQ_OUT_BYTES])
{
    const phx_limits *limits = &a->node.flash.limits;
    uint8_t message[PHX_TREQ_BYTES], *thash = out + 4;
    int error = phx_clock(&a->node, now);

    if (!error)
        error = phx_may_mac(&a->node);
    if (error)
        return error;
    if (auditor == 0)
        return PHX_E_ARG;
    if (phx_draw(&a->requests, now, 1, (uint64_t)limits->bucket_capacity * limits->bucket_period_ms,
                 limits->bucket_period_ms))
        return PHX_E_BUCKET;
    phx_put32(out, now);
    phx_request_top(&a->node, thash);
    return phx_mac(&a->node.key, message, phx_treq_bytes(message, now, a->node.flash.robot_id, auditor, thash),
                   thash + PHX_HASH_BYTES);
}

static void token_bytes(uint8_t out[PHX_TOKEN_BYTES], uint16_t auditor, uint16_t auditee, uint32_t t,
                        const uint8_t hckpt[PHX_HASH_BYTES])
{
    out[0] = PHX_TOKEN;
    phx_put16(out + PHX_TOKEN_AUDITOR, auditor);
    phx_put16(out + PHX_TOKEN_AUDITEE, auditee);
    phx_put32(out + PHX_TOKEN_T, t);
    memcpy(out + PHX_TOKEN_HCKPT, hckpt, PHX_HASH_BYTES);
}

int phx_anode_issue_token(phx_anode *a, uint16_t auditee, uint32_t t, const uint8_t thash_a[PHX_HASH_BYTES],
                          const uint8_t treq_mac[PHX_MAC_BYTES], const uint8_t hckpt[PHX_HASH_BYTES],
                          uint8_t mac[PHX_MAC_BYTES])
{
    uint16_t self = a->node.flash.robot_id;
    uint8_t message[PHX_TREQ_BYTES];
    uint8_t token[PHX_TOKEN_BYTES];
    int error = phx_may_mac(&a->node);

    if (error)
        return error;
    if (auditee == self)
        return PHX_E_SELF;
    error = phx_mac_check(&a->node.key, message, phx_treq_bytes(message, t, auditee, self, thash_a), treq_mac);
    if (error)
        return error;
    token_bytes(token, self, auditee, t, hckpt);
    return phx_mac(&a->node.key, token, sizeof token, mac);
}

int phx_anode_check_token(phx_anode *a, uint16_t auditor, uint16_t auditee, uint32_t t,
                          const uint8_t hckpt[PHX_HASH_BYTES], const uint8_t mac[PHX_MAC_BYTES])
{
    uint8_t token[PHX_TOKEN_BYTES];
    int error = phx_may_mac(&a->node);

    if (error)
        return error;
    token_bytes(token, auditor, auditee, t, hckpt);
    return phx_mac_check(&a->node.key, token, sizeof token, mac);
}

int phx_anode_install_token(phx_anode *a, uint32_t now, uint16_t auditor, uint32_t t,
                            const uint8_t hckpt[PHX_HASH_BYTES], const uint8_t mac[PHX_MAC_BYTES])
{
    int error = phx_clock(&a->node, now);

    if (!error)
        error = phx_anode_check_token(a, auditor, a->node.flash.robot_id, t, hckpt, mac);
    if (!error && auditor == 0)
        error = PHX_E_ARG;
    return error ? error : phx_keep_token(a, now, auditor, t);
}

int phx_anode_check(phx_anode *a, uint32_t now)
{
    const phx_limits *limits = &a->node.flash.limits;
    uint32_t valid = 0;

    if (phx_clock(&a->node, now) || a->node.safe)
        return 1;
    /* Grace: with a new key nobody can have a token yet. */
    if (!a->node.was_keyed || now - a->keyed_at_ms < limits->t_val_ms)
        return 0;
    for (unsigned i = 0; i < PHX_TOKENS && a->tokens[i].auditor != 0; i++)
        valid += (uint64_t)a->tokens[i].t + limits->t_val_ms >= now;
    if (valid < limits->f_max + 1u)
        phx_safe_mode(&a->node);
    return a->node.safe;
}

int phx_anode_is_safe(const phx_anode *a)
{
    return a->node.safe;
}
