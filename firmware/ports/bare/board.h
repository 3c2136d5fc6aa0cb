/* What a board without an operating system supplies beside phx_port.h: ports/bare/ does the rest. */
#ifndef BOARD_H
#define BOARD_H

#include "phx_port.h"

/* Called once, before anything else is. */
void board_start(void);
/* A counter that runs upwards and begins anew behind board_tick_mask; looked at far more often than it does. */
uint32_t board_ticks(void);
extern const uint32_t board_tick_mask, board_ticks_a_ms;

/* start.c: memory as the program wants it, then board_start, then phx_serve. */
void start(void);

#endif
