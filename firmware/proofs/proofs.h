/* What calls.c and models.c share. `nondet` and __ESBMC words are the model checker's. */
#ifndef PROOFS_H
#define PROOFS_H

#include "internal.h"
#include "phx_seal.h"

#define DRAWS 4u

/* What hashes, MACs, their comparison and buckets come to: anything. Each hash of a call is another. */
struct chance {
    uint8_t hash[DRAWS][PHX_HASH_BYTES], mac[PHX_MAC_BYTES];
    _Bool right, enough;
    uint64_t level;
    unsigned drawn;
};
extern struct chance chance;

#define always(what, why) __ESBMC_assert(what, why)
#define given(what) __ESBMC_assume(what)

static inline void there(const void *bytes, size_t size)
{
    always(size == 0 || __ESBMC_r_ok((void *)bytes, size), "memory: what is read or written is there");
}

#endif
