/* The trusted nodes of RoboRebound: s-node (sensors) and a-node (radio, actuators, tokens).
   Data in, data out: the port reads the sensors, moves packets, stops the motors in Safe Mode, and hands in `now`,
   the milliseconds since power-up of the clock that both nodes share. `now` never falls, and stays at 2^32 - 1 once
   it is there. Memory is the caller's; nothing is kept but what lies in a node. Pointers may not overlap.
   Functions return >= 0, or one of the errors below, and then have changed nothing but what time does anyway: a bucket
   fills, and a clock at its end means Safe Mode.
   Source: RoboRebound Alg. 2-4; docs/spec/rebound-nodes.md. */
#ifndef PHX_H
#define PHX_H

#include <stddef.h>
#include <stdint.h>

#include "phx_wire.h"

enum {
    PHX_E_NO_KEY = -1,    /* no mission key (or master key) is loaded */
    PHX_E_SAFE_MODE = -2, /* in Safe Mode, until power-up */
    PHX_E_TOO_LONG = -3,  /* longer than PHX_PACKET_MAX */
    PHX_E_BAD_MAC = -4,   /* not made by a node with this key over these bytes */
    PHX_E_SEQ = -5,       /* too late: a key is loaded, or the sequence number was used */
    PHX_E_BUCKET = -6,    /* too many token requests */
    PHX_E_SELF = -7,      /* nobody audits itself */
    PHX_E_FUTURE = -8,    /* the token is of a time that has not come */
    PHX_E_AIRTIME = -9,   /* this sort of packet has had its share of the channel */
    PHX_E_CLOCK = -10,    /* the clock is at its end; the node is in Safe Mode now */
    PHX_E_ARG = -11,      /* robot id 0, an empty packet, one without its header or seal, limits that make no sense */
    PHX_E_REPEATED = -12, /* the seal was seen before, or is far behind its sender's newest */
    PHX_E_LATE = -13,     /* the packet was held back */
    PHX_E_FULL = -14      /* more senders than there is room for */
};

#define PHX_F_MAX 15u                      /* largest f_max */
#define PHX_TOKENS (PHX_F_MAX + 1u)        /* auditors remembered at most */
#define PHX_ROUNDS 31u                     /* of PRESENT */
#define PHX_SHA1_BLOCK 64u
#define PHX_MAC_MESSAGE_MAX 1791u          /* 255 blocks of 7 bytes and 6 more */
#define PHX_AUTH_OUT_BYTES 30u             /* tHash, robot id, MAC */
#define PHX_TREQ_OUT_BYTES 32u             /* t, tHash_a, MAC */

/* What the paper calls parameters; set at manufacture. All but f_max and airtimes are at least 1. */
typedef struct {
    uint32_t f_max;                        /* colluding robots that are survived, at most PHX_F_MAX */
    uint32_t t_val_ms;                     /* a token is good for so long */
    uint32_t batch_size;                   /* entries hashed at once */
    uint32_t bucket_capacity;              /* token requests in one burst */
    uint32_t bucket_period_ms;             /* one more token request each such period */
    uint32_t send_us_per_s;                /* airtime of ordinary packets */
    uint32_t send_capacity_us;
    uint32_t audit_us_per_s;               /* airtime of AUDIT packets */
    uint32_t audit_capacity_us;
    uint32_t airtime_fixed_us;             /* of any packet, however short */
    uint32_t airtime_ns_per_byte_broadcast;
    uint32_t airtime_ns_per_byte_unicast;
} phx_limits;

typedef struct {
    uint64_t bytes;                        /* hashed so far */
    uint32_t h[5];
    uint8_t block[PHX_SHA1_BLOCK];         /* the bytes that do not fill a block yet */
} phx_hash;

/* Both keys of LightMAC, expanded once. */
typedef struct {
    uint16_t round[2][4u * (PHX_ROUNDS + 1u)];
} phx_mac_key;

/* Kept without power. The port writes it out before it answers the call that changed it. */
typedef struct {
    phx_limits limits;
    uint32_t key_seq;
    uint16_t robot_id;
    uint8_t has_master;
    uint8_t master[PHX_KEY_BYTES];
    uint8_t sealed;                        /* the port has its radio go through phx_seal.h */
} phx_flash;

/* What s-node and a-node have in common; at the front, what every packet needs, whole words first: with bytes before the
 * batch the model checker has no memory for the proof of RECV. */
typedef struct {
    uint32_t batched;                      /* entries in the batch, which is hashed as it comes */
    phx_hash batch;
    uint8_t has_key;
    uint8_t was_keyed;                     /* since power-up */
    uint8_t safe;
    uint8_t top[PHX_HASH_BYTES];
    phx_flash flash;
    phx_mac_key key;                       /* of the mission */
} phx_node;

/* A leaky bucket, in units of what it hands out. */
typedef struct {
    uint64_t level;
    uint32_t filled_at_ms;
} phx_bucket;

typedef struct {
    uint32_t t;
    uint16_t auditor;                      /* 0: free */
} phx_token;

typedef struct {
    phx_node node;
} phx_snode;

typedef struct {
    phx_node node;
    uint32_t keyed_at_ms;
    phx_bucket requests;                   /* ms: a request costs bucket_period_ms */
    phx_bucket send;                       /* ns of airtime */
    phx_bucket audit;
    phx_token tokens[PHX_TOKENS];
} phx_anode;

size_t phx_snode_size(void);
size_t phx_anode_size(void);

/* Manufacture: everything zero but the limits. */
int phx_snode_make(phx_snode *s, const phx_limits *limits);
int phx_anode_make(phx_anode *a, const phx_limits *limits);
/* RAM is gone, flash stays: a robot lives again only with a mission key that is newer than its last. */
void phx_snode_power_up(phx_snode *s);
void phx_anode_power_up(phx_anode *a);

int phx_snode_load_master(phx_snode *s, const uint8_t key[PHX_KEY_BYTES], uint16_t id);
int phx_anode_load_master(phx_anode *a, const uint8_t key[PHX_KEY_BYTES], uint16_t id);
/* k: mission key XOR H(r | master key); mac: over MKEY. Once in a power-up, and each seq once. */
int phx_snode_load_mission(phx_snode *s, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                           uint32_t seq, const uint8_t mac[PHX_MAC_BYTES]);
int phx_anode_load_mission(phx_anode *a, uint32_t now, const uint8_t k[PHX_KEY_BYTES], const uint8_t r[PHX_KEY_BYTES],
                           uint32_t seq, const uint8_t mac[PHX_MAC_BYTES]);

/* The four that forward write the entry (header, then the same bytes; entry has room for PHX_ENTRY_HEADER_BYTES + len)
   and return its length. AUDIT packets are not chained. On an error nothing may be forwarded. */
int phx_snode_poll(phx_snode *s, uint32_t now, const uint8_t *reading, uint32_t len, uint8_t *entry);
int phx_anode_recv(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry);
int phx_anode_send(phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry);
int phx_anode_actuate(phx_anode *a, uint32_t now, const uint8_t *cmd, uint32_t len, uint8_t *entry);

/* out: tHash (20), robot id (2), MAC (8); the chain is flushed. The nonce is the MAC of the token request; `paper` has
   none in its authenticators and ignores it. */
int phx_snode_make_auth(phx_snode *s, const uint8_t nonce[PHX_NONCE_BYTES], uint8_t out[PHX_AUTH_OUT_BYTES]);
int phx_snode_check_auth(phx_snode *s, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                         const uint8_t nonce[PHX_NONCE_BYTES], const uint8_t mac[PHX_MAC_BYTES]);

/* out: t (4), tHash_a (20), MAC (8); the chain is flushed. In `paper` neither is done and tHash_a is zero. */
int phx_anode_token_request(phx_anode *a, uint32_t now, uint16_t auditor, uint8_t out[PHX_TREQ_OUT_BYTES]);
/* mac: the token's. Whoever calls it vouches that the log of `auditee` was replayed and found right. */
int phx_anode_issue_token(phx_anode *a, uint16_t auditee, uint32_t t, const uint8_t thash_a[PHX_HASH_BYTES],
                          const uint8_t treq_mac[PHX_MAC_BYTES], const uint8_t hckpt[PHX_HASH_BYTES],
                          uint8_t mac[PHX_MAC_BYTES]);
int phx_anode_check_token(phx_anode *a, uint16_t auditor, uint16_t auditee, uint32_t t,
                          const uint8_t hckpt[PHX_HASH_BYTES], const uint8_t mac[PHX_MAC_BYTES]);
int phx_anode_install_token(phx_anode *a, uint32_t now, uint16_t auditor, uint32_t t,
                            const uint8_t hckpt[PHX_HASH_BYTES], const uint8_t mac[PHX_MAC_BYTES]);
/* CheckTokens, to be called every 100 ms at least: 0, or 1 in Safe Mode. */
int phx_anode_check(phx_anode *a, uint32_t now);
int phx_anode_is_safe(const phx_anode *a);

/* The primitives, for auditors, operators and tests. */
int phx_sha1(const uint8_t *data, uint32_t len, uint8_t out[PHX_HASH_BYTES]);
int phx_lightmac(const uint8_t key[PHX_KEY_BYTES], const uint8_t *message, uint32_t len, uint8_t mac[PHX_MAC_BYTES]);
int phx_present80(const uint8_t key[10], const uint8_t plain[8], uint8_t cipher[8]);

#endif
