/* Host only, for valgrind: keys count as memory without a value. valgrind follows them through the MAC, through its
   comparison and into the c-node's answers, and complains when a branch or an address depends on one. */
#include <string.h>
#include <valgrind/memcheck.h>

#include "internal.h"

int main(void)
{
    static const uint8_t message[40] = {1};
    uint8_t key[PHX_KEY_BYTES] = {2}, mac[PHX_MAC_BYTES], claimed[PHX_MAC_BYTES] = {3};
    phx_mac_key expanded;
    int right;

    if (!RUNNING_ON_VALGRIND)
        return 2;
    (void)VALGRIND_MAKE_MEM_UNDEFINED(key, sizeof key);
    phx_lightmac(key, message, sizeof message, mac);
    phx_present80(key, message, mac);
    phx_mac_expand(&expanded, key);
    phx_mac(&expanded, message, sizeof message, mac);
    right = phx_mac_check(&expanded, message, sizeof message, claimed);
    /* Whether it was right is no secret; when this was found out is. */
    (void)VALGRIND_MAKE_MEM_DEFINED(&right, sizeof right);
    phx_wipe(&expanded, sizeof expanded);
    if (VALGRIND_CHECK_MEM_IS_DEFINED(&expanded, sizeof expanded))
        return 3;
    return right == PHX_E_BAD_MAC ? 0 : 4;
}
