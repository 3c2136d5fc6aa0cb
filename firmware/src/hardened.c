/* Profile `hardened`, the default: the printed protocol with its holes closed (docs/spec/rebound-nodes.md). */
#include <string.h>

#include "internal.h"

/* Whether there is a key is a flag, never its value: an all-zero key that everybody knows is none. */
int phx_is_key(const uint8_t key[PHX_KEY_BYTES])
{
    (void)key;
    return 1;
}

void phx_no_key(phx_node *node)
{
    node->has_key = 0;
    phx_wipe(&node->key, sizeof node->key);
}

int phx_may_mac(const phx_node *node)
{
    if (node->safe)
        return PHX_E_SAFE_MODE;
    return node->has_key ? 0 : PHX_E_NO_KEY;
}

int phx_may_load(const phx_node *node)
{
    return node->flash.has_master ? 0 : PHX_E_NO_KEY;
}

/* Chain, tokens and buckets are still zero: without a key nothing is chained, installed or drawn. The first broadcast may
   be due at once, so airtime starts full; requests start empty, as printed. */
void phx_anode_mission_starts(phx_anode *a, uint32_t now)
{
    a->requests.filled_at_ms = now;
    a->send.level = (uint64_t)a->node.flash.limits.send_capacity_us * 1000u;
    a->audit.level = (uint64_t)a->node.flash.limits.audit_capacity_us * 1000u;
}

static uint64_t airtime_ns(const phx_limits *limits, int unicast, uint32_t len)
{
    uint32_t per_byte = unicast ? limits->airtime_ns_per_byte_unicast : limits->airtime_ns_per_byte_broadcast;

    return (uint64_t)limits->airtime_fixed_us * 1000u + (uint64_t)per_byte * len;
}

/* Audits never see AUDIT packets, so what they may do to the channel is bounded here. us per s are ns per ms. */
int phx_send_rules(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len)
{
    const phx_limits *limits = &a->node.flash.limits;
    int failed;

    if (packet[0] & PHX_KIND_AUDIT) {
        int unicast;
        if (len < PHX_AUDIT_HEADER_BYTES)
            return PHX_E_ARG;
        unicast = packet[PHX_AUDIT_DST] != 0 || packet[PHX_AUDIT_DST + 1u] != 0;
        failed = phx_draw(&a->audit, now, limits->audit_us_per_s, (uint64_t)limits->audit_capacity_us * 1000u,
                          airtime_ns(limits, unicast, len));
    } else {
        failed = phx_draw(&a->send, now, limits->send_us_per_s, (uint64_t)limits->send_capacity_us * 1000u,
                          airtime_ns(limits, 0, len));
    }
    return failed ? PHX_E_AIRTIME : 0;
}

/* Nobody answers for an AUDIT packet, so nobody may send one in another's name. */
void phx_mark_source(const phx_node *node, uint8_t *packet)
{
    phx_put16(packet + PHX_AUDIT_SRC, node->flash.robot_id);
}

uint32_t phx_auth_bytes(uint8_t out[PHX_AUTH_S_BYTES], uint8_t type, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                        const uint8_t *nonce)
{
    out[0] = type;
    memcpy(out + PHX_AUTH_S_THASH, thash, PHX_HASH_BYTES);
    phx_put16(out + PHX_AUTH_S_ID, id);
    memcpy(out + PHX_AUTH_S_NONCE, nonce, PHX_NONCE_BYTES);
    return PHX_AUTH_S_BYTES;
}

/* What the log must end in: a robot cannot show an old log to a new request. */
void phx_request_top(phx_node *node, uint8_t thash[PHX_HASH_BYTES])
{
    phx_flush(node);
    memcpy(thash, node->top, PHX_HASH_BYTES);
}

uint32_t phx_treq_bytes(uint8_t out[PHX_TREQ_BYTES], uint32_t t, uint16_t auditee, uint16_t auditor,
                        const uint8_t thash[PHX_HASH_BYTES])
{
    out[0] = PHX_TREQ;
    phx_put32(out + PHX_TREQ_T, t);
    phx_put16(out + PHX_TREQ_AUDITEE, auditee);
    phx_put16(out + PHX_TREQ_AUDITOR, auditor);
    memcpy(out + PHX_TREQ_THASH_A, thash, PHX_HASH_BYTES);
    return PHX_TREQ_BYTES;
}

/* The newest token of each auditor; of more than f_max + 1 auditors those with the newest, as no check needs more.
   Places fill in order. */
int phx_keep_token(phx_anode *a, uint32_t now, uint16_t auditor, uint32_t t)
{
    unsigned place = 0;

    if (t > now)
        return PHX_E_FUTURE;
    for (unsigned i = 0; i <= a->node.flash.limits.f_max; i++) {
        if (a->tokens[i].auditor == auditor || a->tokens[i].auditor == 0) {
            place = i;
            break;
        }
        if (a->tokens[i].t < a->tokens[place].t)
            place = i;
    }
    if (t >= a->tokens[place].t) {
        a->tokens[place].auditor = auditor;
        a->tokens[place].t = t;
    }
    return 0;
}
