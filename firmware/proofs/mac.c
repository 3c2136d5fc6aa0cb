/* LightMAC's own memory and arithmetic: any key, any message of any length that a node makes a MAC over, and any before it. */
#include <stdlib.h>

#include "proofs.h"

void prove_mac(void)
{
    phx_mac_key key;
    uint32_t len;
    uint8_t mac[PHX_MAC_BYTES], *message;

    given(len <= PHX_MKEY_BYTES); /* no message is longer than that of a mission key */
    message = malloc(len);
    given(message);
    always(phx_mac(&key, message, len, mac) == 0, "a MAC is made");
    always(!REACHED, "reached");
}

void prove_expand(void)
{
    phx_mac_key key;
    uint8_t raw[PHX_KEY_BYTES];

    phx_mac_expand(&key, raw);
    always(!REACHED, "reached");
}
