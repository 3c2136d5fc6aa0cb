/* The clock of a robot: milliseconds since power-up, counted by the board. */
#include "board.h"

uint32_t phx_port_now(void)
{
    static uint32_t last, rest, ms;
    uint32_t ticks = board_ticks();

    rest += (ticks - last) & board_tick_mask;
    last = ticks;
    for (; rest >= board_ticks_a_ms; rest -= board_ticks_a_ms)
        if (ms != UINT32_MAX)
            ms++;
    return ms;
}

uint8_t phx_port_told(void)
{
    return PHX_LINE_TOLD_READINGS;
}

void phx_port_set_clock(uint32_t now)
{
    (void)now;
}
