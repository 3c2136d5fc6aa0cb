/* SHA-1's own memory and arithmetic, in two parts: its compression, any state and any block; and what cuts messages into
   blocks, from any state, for which prove.py has the compression look at its block and return. */
#include <stdlib.h>

#ifdef BLOCK
#include "../src/hash.c"
#endif
#include "proofs.h"

#ifdef BLOCK
void prove_compress(void)
{
    uint32_t h[5];
    uint8_t block[PHX_SHA1_BLOCK];

    compress(h, block);
    always(!REACHED, "reached");
}
#else
/* Nothing that is proved reads what was copied. */
void *memcpy(void *to, const void *from, size_t size)
{
    there(to, size);
    there(from, size);
    return to;
}

void prove_hash(void)
{
    phx_hash hash;
    uint64_t before;
    uint32_t len;
    uint8_t out[PHX_HASH_BYTES], *data;

    given(len <= 130u); /* two blocks, and more than nothing of a third; a longer message is added in pieces */
    data = malloc(len);
    given(data);
    before = hash.bytes;
    phx_hash_add(&hash, data, len);
    always(hash.bytes == before + len, "hash: all bytes are counted");
    phx_hash_end(&hash, out);
    always(hash.bytes % PHX_SHA1_BLOCK == 0, "hash: it ends with a block");
    always(!REACHED, "reached");
}
#endif
