/* Host only: hash.c and mac.c for simulators, which compute little else. They give the bytes that src/hash.c and
   src/mac.c give, from which everybody else has them; both are in one library, and phx_host_use says which is called. */
#ifndef PHX_HOST_H
#define PHX_HOST_H

#include "phx.h"

/* From now on, with 1, what this processor does fastest; with 0, as at first, the firmware's own C. */
int phx_host_use(uint32_t fast);
int phx_host_used(void); /* which of the next are in use */
/* What this processor can: 1 hashes by instructions of its own, 2 encrypts eight blocks at once. */
int phx_host_can(void);

/* For auditors: top becomes H(top | bytes), one flush of a chain. */
int phx_chain_extend(uint8_t top[PHX_HASH_BYTES], const uint8_t *bytes, uint32_t len);

/* Blocks that were hashed and encrypted so far, not by the firmware's C: what a simulation cannot do without. */
void phx_host_count(uint64_t counts[2]);

#endif
