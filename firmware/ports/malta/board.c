/* MIPS Malta, here QEMU's: MIPS32, with the 16550 UART of a PC. */
#include "board.h"

#define UART(offset) (*(volatile uint8_t *)(0xb80003f8u + (offset)))
#define DATA 0u
#define FIFO 2u
#define LINE 3u
#define STATUS 5u
#define CAME 1u
#define ROOM 32u

const uint32_t board_tick_mask = 0xffffffffu, board_ticks_a_ms = 100000;

/* Where QEMU jumps to. */
__asm__(".section .vectors,\"ax\"\n.global _start\n_start: la $sp, stack_top - 16\n j start\n nop\n.text\n");

/* A shift by a variable of what is wider than a register. */
uint64_t __lshrdi3(uint64_t value, int by);
uint64_t __lshrdi3(uint64_t value, int by)
{
    uint32_t high = (uint32_t)(value >> 32), low = (uint32_t)value;

    if (by >= 32)
        return high >> (by - 32);
    return by == 0 ? value : (uint64_t)(high >> by) << 32 | (low >> by | high << (32 - by));
}

void board_start(void)
{
    UART(FIFO) = 1;
    UART(LINE) = 3; /* 8N1 */
}

uint32_t board_ticks(void)
{
    uint32_t count;

    __asm__ volatile("mfc0 %0, $9" : "=r"(count));
    return count;
}

int phx_port_get(uint8_t *byte)
{
    if (!(UART(STATUS) & CAME))
        return 0;
    *byte = UART(DATA);
    return 1;
}

int phx_port_put(uint8_t byte)
{
    if (!(UART(STATUS) & ROOM))
        return 0;
    UART(DATA) = byte;
    return 1;
}
