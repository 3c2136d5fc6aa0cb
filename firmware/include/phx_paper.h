/* What only profile `paper` has: authenticators of the a-node. In `hardened` a token request binds the a-chain. */
#ifndef PHX_PAPER_H
#define PHX_PAPER_H

#include "phx.h"

int phx_anode_make_auth(phx_anode *a, uint8_t out[PHX_AUTH_OUT_BYTES]);
int phx_snode_check_auth_a(phx_snode *s, const uint8_t thash[PHX_HASH_BYTES], uint16_t id,
                           const uint8_t mac[PHX_MAC_BYTES]);

#endif
