#include "fleet.h"

void phx_anodes_check(phx_anode *nodes, uint32_t n, const uint32_t *now_ms, uint8_t *safe)
{
    for (uint32_t i = 0; i < n; i++)
        safe[i] = (uint8_t)phx_anode_check(nodes + i, now_ms[i]);
}
