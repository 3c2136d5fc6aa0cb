/* SHA-1's own memory and arithmetic: any state, then any bytes of any length that is laid out, then the end. What a
   longer message does is the same again: a state may have counted any number of bytes. */
#include <stdlib.h>

#include "proofs.h"

#define BYTES_MOST 130u /* two blocks, and what is left of a third */

void prove_hash(void)
{
    phx_hash hash;
    uint64_t before;
    uint32_t len;
    uint8_t out[PHX_HASH_BYTES], *data;

    given(len <= BYTES_MOST);
    data = malloc(len);
    given(data);
    before = hash.bytes;
    phx_hash_add(&hash, data, len);
    always(hash.bytes == before + len, "hash: all bytes are counted");
    phx_hash_end(&hash, out);
    always(hash.bytes % PHX_SHA1_BLOCK == 0, "hash: it ends with a block");
    always(!REACHED, "reached");
}
