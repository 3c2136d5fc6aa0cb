/* Where any Cortex-M begins; whatever goes wrong stops the motors. */
#include "board.h"

extern uint8_t stack_top[];
/* systick.c, where it is used. */
__attribute__((weak)) void cortex_m_tick(void);

#define WRONG phx_port_halt

__attribute__((section(".vectors"), used)) static const struct {
    void *stack;
    void (*handlers[15])(void);
} table = {
    stack_top,
    {start, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, WRONG, cortex_m_tick},
};
