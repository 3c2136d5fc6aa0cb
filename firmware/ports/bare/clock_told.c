/* The clock of a bench: it shows what it is told. No robot has it. */
#include "board.h"

static uint32_t told_ms;

uint32_t phx_port_now(void)
{
    return told_ms;
}

uint8_t phx_port_told(void)
{
    return PHX_LINE_TOLD_READINGS | PHX_LINE_TOLD_CLOCK;
}

void phx_port_set_clock(uint32_t now)
{
    told_ms = now;
}
