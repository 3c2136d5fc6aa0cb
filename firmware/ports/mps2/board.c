/* Arm's MPS2 boards, here those of QEMU: the UART of CMSDK. UART and CLOCK_HZ come with the image (targets.mk). */
#include "board.h"
#include "systick.h"

#define AT(offset) (*(volatile uint32_t *)(UART + (offset)))
#define DATA AT(0x00u)
#define STATE AT(0x04u)
#define CTRL AT(0x08u)
#define BAUDDIV AT(0x10u)
#define TX 1u /* in STATE: there is no room; in CTRL: on */
#define RX 2u /* in STATE: a byte is there; in CTRL: on */
#define BAUD 115200u

void board_start(void)
{
    BAUDDIV = CLOCK_HZ / BAUD;
    CTRL = TX | RX;
    systick_start(CLOCK_HZ);
}

int phx_port_get(uint8_t *byte)
{
    int came = (STATE & RX) != 0;

    systick_rest(came);
    if (!came)
        return 0;
    *byte = (uint8_t)DATA;
    return 1;
}

int phx_port_put(uint8_t byte)
{
    if (STATE & TX)
        return 0;
    DATA = byte;
    return 1;
}
