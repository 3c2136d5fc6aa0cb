/* The sealed radio: for an a-node that does not hold the radio itself. What it sends carries a seal that only a-nodes of the
   mission can make; what has none, was heard before or was held back it does not take. So whatever a c-node says past its
   a-node, or says again, no a-node hears. The rules of phx.h hold here as well. Source: docs/spec/sealed-radio.md. */
#ifndef PHX_SEAL_H
#define PHX_SEAL_H

#include "phx.h"

#define PHX_SOURCES 64u         /* senders remembered at most */
#define PHX_SEAL_WINDOW_MS 64u  /* a packet is taken so far behind its sender's newest: the bits of `seen` */
#define PHX_SEAL_LATE_MS 2000   /* and so much later than its sender's quickest */
#define PHX_SEAL_AHEAD_MS 256u  /* of the clock: packets of a burst have a time each */
#define PHX_SEAL_DRIFT_SHIFT 11 /* two clocks drift apart by 1/2048 at most */

typedef struct {
    uint32_t seen[2];              /* bit n: newest - n has come */
    uint32_t newest;            /* of its times */
    uint32_t quickest_t;        /* of all its packets the one with the least now - t, drift left out */
    uint32_t quickest_ms;       /* when that came, of our clock */
    uint16_t src;               /* 0: free */
} phx_source;

/* Zeros at power-up. */
typedef struct {
    phx_source sources[PHX_SOURCES];
    uint32_t t;                 /* of our last seal */
} phx_seals;

/* Manufacture, before there is a master key: all that is sent and taken is sealed, for ever. */
int phx_sealed_make(phx_anode *a);
/* As phx_anode_send, and behind the entry the packet's seal: both lengths are returned. The packet leaves room for it in
   PHX_PACKET_MAX. */
int phx_sealed_send(phx_seals *seals, phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry);
/* As phx_anode_recv, of a packet and its seal; the entry has the packet alone. */
int phx_sealed_recv(phx_seals *seals, phx_anode *a, uint32_t now, const uint8_t *packet, uint32_t len, uint8_t *entry);

#endif
