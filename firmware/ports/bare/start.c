/* From reset to phx_serve; sections.ld says where memory lies. */
#include <string.h>

#include "board.h"

extern uint8_t data_from[], data_begin[], data_end[], bss_begin[], bss_end[];

void start(void)
{
    memcpy(data_begin, data_from, (size_t)(data_end - data_begin));
    memset(bss_begin, 0, (size_t)(bss_end - bss_begin));
    board_start();
    phx_serve();
}

/* Nothing is known any more but that the motors have to stand still. */
void phx_port_halt(void)
{
    for (;;)
        phx_port_actuate(0, 0);
}
