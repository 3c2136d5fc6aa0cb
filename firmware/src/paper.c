/* Profile `paper`: Algorithms 2-4 as printed, holes and all, for experiments. Never for robots. */
#include <string.h>

#include "internal.h"
#include "phx_paper.h"

/* As printed: a key that is zero is none. */
int phx_is_key(const uint8_t key[PHX_KEY_BYTES])
{
    uint8_t any = 0;

    for (unsigned i = 0; i < PHX_KEY_BYTES; i++)
        any |= key[i];
    return any != 0;
}

/* As printed: "no key" is the key zero, and MACs are made with it. */
void phx_no_key(phx_node *node)
{
    static const uint8_t zero[PHX_KEY_BYTES] = {0};

    node->has_key = 0;
    phx_mac_expand(&node->key, zero);
}

int phx_may_mac(const phx_node *node)
{
    (void)node;
    return 0;
}

int phx_may_load(const phx_node *node)
{
    (void)node;
    return 0;
}

void phx_anode_mission_starts(phx_anode *a, uint32_t now)
{
    (void)a;
    (void)now;
}

int phx_send_rules(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len)
{
    (void)a;
    (void)now;
    (void)packet;
    (void)len;
    return 0;
}

void phx_mark_source(const phx_node *node, uint8_t *packet)
{
    (void)node;
    (void)packet;
}

uint32_t phx_auth_bytes(uint8_t out[PHX_AUTH_S_BYTES], uint8_t type, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                        const uint8_t *nonce)
{
    (void)nonce;
    out[0] = type;
    memcpy(out + PHX_AUTH_S_PAPER_THASH, thash, PHX_HASH_BYTES);
    phx_put16(out + PHX_AUTH_S_PAPER_ID, id);
    return PHX_AUTH_S_PAPER_BYTES;
}

int phx_anode_make_auth(phx_anode *a, uint8_t out[PHX_AUTH_OUT_BYTES])
{
    return phx_make_auth(&a->node, PHX_AUTH_A_PAPER, NULL, out);
}

int phx_snode_check_auth_a(phx_snode *s, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                           const uint8_t mac[PHX_MAC_BYTES])
{
    return phx_check_auth(&s->node, PHX_AUTH_A_PAPER, thash, id, NULL, mac);
}

void phx_request_top(phx_node *node, uint8_t thash[PHX_HASH_BYTES])
{
    (void)node;
    memset(thash, 0, PHX_HASH_BYTES);
}

uint32_t phx_treq_bytes(uint8_t out[PHX_TREQ_BYTES], uint32_t t, uint16_t auditee, uint16_t auditor,
                        const uint8_t thash[PHX_HASH_BYTES])
{
    (void)thash;
    out[0] = PHX_TREQ_PAPER;
    phx_put32(out + PHX_TREQ_PAPER_T, t);
    phx_put16(out + PHX_TREQ_PAPER_AUDITEE, auditee);
    phx_put16(out + PHX_TREQ_PAPER_AUDITOR, auditor);
    return PHX_TREQ_PAPER_BYTES;
}

/* The last token to arrive of each auditor, whatever its time; of more than 2 f_max + 1 auditors the oldest gives way to a
   newer. Places fill in order. */
int phx_keep_token(phx_anode *a, uint32_t now, uint16_t auditor, uint32_t t)
{
    uint32_t most = 2u * a->node.flash.limits.f_max + 1u, end = most < PHX_TOKENS ? most : PHX_TOKENS;
    phx_token *oldest = a->tokens;

    (void)now;
    for (uint32_t i = 0; i < end; i++) {
        phx_token *each = &a->tokens[i];
        if (each->auditor == auditor || each->auditor == 0) {
            each->auditor = auditor;
            each->t = t;
            return 0;
        }
        if (each->t < oldest->t)
            oldest = each;
    }
    if (t > oldest->t) {
        oldest->auditor = auditor;
        oldest->t = t;
    }
    return 0;
}
