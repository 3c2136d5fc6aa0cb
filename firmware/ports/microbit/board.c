/* BBC micro:bit: nRF51, a Cortex-M0, which has no SysTick. */
#include "board.h"

#define UART(offset) (*(volatile uint32_t *)(0x40002000u + (offset)))
#define TIMER(offset) (*(volatile uint32_t *)(0x40008000u + (offset)))
#define START 0x000u
#define START_TX 0x008u
#define CAPTURE 0x040u
#define RX_READY 0x108u
#define TX_READY 0x11cu
#define ENABLE 0x500u
#define BITS 0x508u
#define PRESCALER 0x510u
#define RXD 0x518u
#define TXD 0x51cu
#define BAUD 0x524u
#define CAPTURED 0x540u

const uint32_t board_tick_mask = 0xffffffffu, board_ticks_a_ms = 1000;
static uint8_t is_free;

void board_start(void)
{
    UART(BAUD) = 0x01d7e000u; /* 115200 */
    UART(ENABLE) = 4;
    UART(START) = 1;
    UART(START_TX) = 1;
    is_free = 1;
    TIMER(BITS) = 3;      /* 32 */
    TIMER(PRESCALER) = 4; /* 1 MHz */
    TIMER(START) = 1;
}

uint32_t board_ticks(void)
{
    TIMER(CAPTURE) = 1;
    return TIMER(CAPTURED);
}

int phx_port_get(uint8_t *byte)
{
    if (!UART(RX_READY))
        return 0;
    UART(RX_READY) = 0;
    *byte = (uint8_t)UART(RXD);
    return 1;
}

int phx_port_put(uint8_t byte)
{
    if (!is_free && !UART(TX_READY))
        return 0;
    is_free = 0;
    UART(TX_READY) = 0;
    UART(TXD) = byte;
    return 1;
}
