/* Host only, for valgrind: memory fresh from malloc stands for keys. valgrind follows it through the MAC and complains
   when a branch or an address depends on it. */
#include <stdlib.h>

#include "phx.h"

int main(void)
{
    static const uint8_t message[40] = {1};
    uint8_t *key = malloc(PHX_KEY_BYTES), mac[PHX_MAC_BYTES];

    if (!key)
        return 2;
    phx_lightmac(key, message, sizeof message, mac);
    phx_present80(key, message, mac);
    free(key);
    return 0;
}
