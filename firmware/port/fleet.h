/* Host only: one call for the nodes of many robots, which lie behind one another in memory. */
#ifndef PHX_FLEET_H
#define PHX_FLEET_H

#include "phx.h"

void phx_anodes_check(phx_anode *nodes, uint32_t n, const uint32_t *now_ms, uint8_t *safe);

#endif
