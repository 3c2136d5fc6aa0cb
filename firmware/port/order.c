/* Orders are checked by Monocypher, each once: a robot and all its auditors ask the same question in one process. */
#include "order.h"

#include <string.h>

#include "monocypher/monocypher-ed25519.h"
#include "monocypher/monocypher.h"

enum { KEY = 32, SIGNATURE = 64, DIGEST = 32, REMEMBERED = 4096 };
enum { UNKNOWN, SIGNED, FORGED };

/* What was found of orders lately, by their hash. Each thread's own: kernels run without Python's lock. */
static __thread struct {
    uint8_t digest[DIGEST];
    uint8_t found;
} memo[REMEMBERED];

int phx_order_check(const uint8_t signer[32], const uint8_t *data, uint32_t length)
{
    static const uint8_t nobody[KEY];
    crypto_blake2b_ctx hash;
    uint8_t digest[DIGEST];
    uint32_t at;

    if (length < SIGNATURE || memcmp(signer, nobody, KEY) == 0)
        return -1;
    crypto_blake2b_init(&hash, DIGEST);
    crypto_blake2b_update(&hash, signer, KEY);
    crypto_blake2b_update(&hash, data, length);
    crypto_blake2b_final(&hash, digest);
    at = (digest[0] | (uint32_t)digest[1] << 8) % REMEMBERED;
    if (memo[at].found == UNKNOWN || memcmp(memo[at].digest, digest, DIGEST) != 0) {
        const uint8_t *signature = data + (length - SIGNATURE);
        memo[at].found = crypto_ed25519_check(signature, signer, data, length - SIGNATURE) == 0 ? SIGNED : FORGED;
        memcpy(memo[at].digest, digest, DIGEST);
    }
    return memo[at].found == SIGNED ? 0 : -1;
}
