/* What the sources share with each other and with nobody else. */
#ifndef PHX_INTERNAL_H
#define PHX_INTERNAL_H

#include "phx.h"

/* hash.c */
void phx_hash_start(phx_hash *hash);
void phx_hash_add(phx_hash *hash, const uint8_t *data, uint32_t len);
void phx_hash_end(phx_hash *hash, uint8_t out[PHX_HASH_BYTES]);

/* mac.c */
void phx_mac_expand(phx_mac_key *key, const uint8_t raw[PHX_KEY_BYTES]);
int phx_mac(const phx_mac_key *key, const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES]);
int phx_mac_check(const phx_mac_key *key, const uint8_t *message, uint32_t len, const uint8_t mac[PHX_MAC_BYTES]);
void phx_wipe(void *memory, size_t size);

/* node.c */
void phx_put16(uint8_t *at, uint32_t value);
void phx_put32(uint8_t *at, uint32_t value);
int phx_node_make(phx_node *node, const phx_limits *limits);
int phx_node_load_master(phx_node *node, const uint8_t key[PHX_KEY_BYTES], uint16_t id);
int phx_node_load_mission(phx_node *node, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                          uint32_t seq, const uint8_t mac[PHX_MAC_BYTES]);
int phx_clock(phx_node *node, uint32_t now);
int phx_may_forward(phx_node *node, uint32_t now, uint32_t len);
void phx_safe_mode(phx_node *node);
int phx_entry(phx_node *node, uint8_t type, uint32_t now, const uint8_t *payload, uint32_t len, uint8_t *entry);
void phx_chain(phx_node *node, const uint8_t *entry, uint32_t len);
void phx_flush(phx_node *node);
int phx_make_auth(phx_node *node, uint8_t type, const uint8_t *nonce, uint8_t out[PHX_AUTH_OUT_BYTES]);
int phx_check_auth(const phx_node *node, uint8_t type, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                   const uint8_t *nonce, const uint8_t mac[PHX_MAC_BYTES]);

/* bucket.c */
int phx_draw(phx_bucket *bucket, uint32_t now, uint32_t per_ms, uint64_t capacity, uint64_t cost);

/* The profile: hardened.c or paper.c, whichever is linked. */
int phx_is_key(const uint8_t key[PHX_KEY_BYTES]);          /* whether these bytes count as a key */
void phx_no_key(phx_node *node);                           /* the mission key is gone */
int phx_may_mac(const phx_node *node);                     /* whether the mission key may be used */
int phx_may_load(const phx_node *node);                    /* whether the master key may be used */
void phx_anode_mission_starts(phx_anode *a, uint32_t now); /* what begins with a key */
int phx_send_rules(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len);
void phx_mark_source(const phx_node *node, uint8_t *packet);
uint32_t phx_auth_bytes(uint8_t out[PHX_AUTH_S_BYTES], uint8_t type, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                        const uint8_t *nonce);
void phx_request_top(phx_node *node, uint8_t thash[PHX_HASH_BYTES]); /* what of the chain a token request binds */
uint32_t phx_treq_bytes(uint8_t out[PHX_TREQ_BYTES], uint32_t t, uint16_t auditee, uint16_t auditor,
                        const uint8_t thash[PHX_HASH_BYTES]);
int phx_keep_token(phx_anode *a, uint32_t now, uint16_t auditor, uint32_t t); /* of a token that was checked */

#endif
