/* TrustZone-M, here Arm's MPS2 image AN505 (Cortex-M33): both nodes in the secure world, the c-node in the other one. The
   c-node has memory and an UART of its own, and one door, the gate. SysTick, the motor register and all that is not given
   away below are the secure world's. Whatever faults stops the motors, until power-up. */
#include <arm_cmse.h>
#include <string.h>

#include "board.h"
#include "gate.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYST_CSR REGISTER(0xe000e010u)
#define SYST_RVR REGISTER(0xe000e014u)
#define SYST_CVR REGISTER(0xe000e018u)
#define VTOR_NS REGISTER(0xe002ed08u)
#define AIRCR REGISTER(0xe000ed0cu)
#define SCR REGISTER(0xe000ed10u)
#define SAU_CTRL REGISTER(0xe000edd0u)
#define SAU_RNR REGISTER(0xe000edd8u)
#define SAU_RBAR REGISTER(0xe000eddcu)
#define SAU_RLAR REGISTER(0xe000ede0u)
/* Of this chip: who may use which memory and which device. */
#define SPC_BUS_ERROR REGISTER(0x50080010u)
#define SPC_NSC REGISTER(0x50080014u)
#define SPC_UARTS REGISTER(0x50080084u)
#define MPC(offset) REGISTER(0x58008000u + (offset))
#define MOTORS REGISTER(0x50302000u)
#define UART(offset) REGISTER(0x50200000u + (offset))

#define KEY (0x05fau << 16)
#define SECURE_FIRST (1u << 14)      /* its interrupts before all of the c-node's */
#define SECURE_RESET (1u << 3)       /* nobody else resets */
#define SECURE_DEEP_SLEEP (1u << 3)  /* nobody else stops the clock */
#define UART_1 (1u << 6)
#define CLOCK_HZ 20000000u
#define NOT_SECURE 0x28000000u, 0x281fffffu
#define UART_OF_C_NODE 0x40201000u, 0x40201fffu
#define SEAL 0xfef5eda5u

const uint32_t board_tick_mask = 0xffffffffu, board_ticks_a_ms = 1;
extern uint8_t gates_begin[], gates_end[];
extern uint32_t stack_top[];
static volatile uint32_t ticks;
typedef void __attribute__((cmse_nonsecure_call)) c_node(void);

uint32_t board_ticks(void)
{
    return ticks;
}

/* What happens to the motors, for whoever listens at the secure UART. */
static void tell(const char *what)
{
    uint32_t digit = 1000000000u, rest = phx_port_now();

    while (*what)
        UART(0) = (uint8_t)*what++;
    for (; digit > 0; digit /= 10u)
        UART(0) = '0' + rest / digit % 10u;
    UART(0) = '\n';
}

void phx_port_actuate(const uint8_t *command, uint32_t len)
{
    (void)command;
    if (MOTORS == (len > 0))
        return;
    MOTORS = len > 0;
    tell(MOTORS ? "motors on " : "motors off ");
}

uint32_t phx_port_sense(uint8_t *reading)
{
    (void)reading;
    return 0;
}

/* SysTick of the secure world: no interrupt of the c-node's comes before it, and none that it turns off is it. */
void cortex_m_tick(void)
{
    ticks++;
    phx_robot_check();
}

__attribute__((cmse_nonsecure_entry)) int32_t phx_gate(const uint8_t *call, uint32_t len, uint8_t *answer, uint32_t room)
{
    phx_line *line = phx_robot_line();
    int32_t said = GATE_REFUSED;

    if (len < PHX_CALL_CHECK_BYTES || len > GATE_CALL_MAX || room < GATE_ANSWER_MAX ||
        !cmse_check_address_range((void *)call, len, CMSE_NONSECURE | CMSE_MPU_READ) ||
        !cmse_check_address_range(answer, room, CMSE_NONSECURE | CMSE_MPU_READWRITE))
        return said;
    /* Neither a check of the tokens nor an interrupt of the c-node's comes in between: one function at a time. */
    __asm__ volatile("cpsid i" ::: "memory");
    memcpy(line->in, call, len);
    line->call_len = len;
    phx_robot_answer();
    said = (int32_t)(line->out_len - PHX_LINE_CRC_BYTES);
    memcpy(answer, line->out, (uint32_t)said);
    __asm__ volatile("cpsie i" ::: "memory");
    return said;
}

static void give(uint32_t region, uint32_t from, uint32_t to, uint32_t gates)
{
    SAU_RNR = region;
    SAU_RBAR = from;
    SAU_RLAR = (to & ~31u) | gates << 1 | 1u;
}

void board_start(void)
{
    UART(0x10) = 16;
    UART(0x08) = 1;
    give(0, NOT_SECURE, 0);
    give(1, UART_OF_C_NODE, 0);
    give(2, (uint32_t)gates_begin, (uint32_t)gates_end - 1u, 1);
    SAU_CTRL = 1;
    SPC_NSC = 1;
    SPC_BUS_ERROR = 1;
    SPC_UARTS = UART_1;
    /* The whole of this memory; how its blocks are numbered is the chip's affair. */
    for (uint32_t i = 0; i <= MPC(0x10); i++) {
        MPC(0x18) = i;
        MPC(0x1c) = 0xffffffffu;
    }
    AIRCR = KEY | SECURE_FIRST | SECURE_RESET;
    SCR = SECURE_DEEP_SLEEP;
}

void phx_serve(void)
{
    const uint32_t *table = (const uint32_t *)0x28000000u;
    c_node *begin;

    phx_robot_power_up();
    SYST_RVR = CLOCK_HZ / 1000u - 1u;
    SYST_CVR = 0;
    SYST_CSR = 7;
    VTOR_NS = (uint32_t)table;
    __asm__ volatile("msr msp_ns, %0" ::"r"(table[0]));
    /* A return to the secure world that was never called finds this, and faults. */
    stack_top[0] = stack_top[1] = SEAL;
    begin = (c_node *)cmse_nsfptr_create(table[1]);
    begin();
    phx_port_halt();
}
