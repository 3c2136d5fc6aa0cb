/* systick.c, for a board's port. */
#ifndef SYSTICK_H
#define SYSTICK_H

#include <stdint.h>

void systick_start(uint32_t clock_hz);
/* After each look at the line: it sleeps until the next tick if nothing has come for a while. */
void systick_rest(int came);

#endif
