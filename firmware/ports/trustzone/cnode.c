/* A c-node in the non-secure world that was taken over: it gets its robot going, and then does what it should not. Which of
   these is told by QEMU (tests/test_trustzone.py); what comes of it is said at its own UART. */
#include <string.h>

#include "gate.h"
#include "phx_line.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define WHICH REGISTER(0x28100000u)
#define UART(offset) REGISTER(0x40201000u + (offset))
#define AIRCR REGISTER(0xe000ed0cu)
#define SYST_CSR REGISTER(0xe000e010u)
#define SYST_RVR REGISTER(0xe000e014u)
#define T_VAL_MS 500u

enum {
    HONEST, HOLD_ON, REPEAT, SLEEP, WRITE_MOTORS, WRITE_MOTORS_SECURE, WRITE_NODES, READ_NODES, JUMP_INSIDE, JUMP_BESIDE,
    POINTERS, RESET, HANDLERS, PREEMPT, REENTER
};

extern uint8_t data_from[], data_begin[], data_end[], bss_begin[], bss_end[], stack_top[];
static const uint8_t master[PHX_KEY_BYTES] = {1, 2, 3};
static uint8_t call[GATE_CALL_MAX], answer[GATE_ANSWER_MAX];
static volatile uint32_t reenter, entered;
static volatile int32_t wrong;

static void begin(void);
static void stuck(void)
{
    for (;;) {
    }
}

static int32_t mixed_up(const uint8_t *asked, const uint8_t *got)
{
    return got[PHX_ANSWER_NUMBER] != asked[PHX_CALL_CHECK_NUMBER] || got[PHX_ANSWER_NUMBER + 1] != asked[PHX_CALL_CHECK_NUMBER + 1];
}

/* Calls of the interrupt's own, whose numbers are no others'. */
static void enter_again(void)
{
    static uint8_t inner[PHX_CALL_CHECK_BYTES] = {PHX_CALL_CHECK, 0, 0x80}, got[GATE_ANSWER_MAX];

    inner[PHX_CALL_CHECK_NUMBER]++;
    if (phx_gate(inner, sizeof inner, got, sizeof got) != PHX_ANSWER_BYTES || mixed_up(inner, got))
        wrong++;
    entered++;
}

static volatile uint32_t preempt;
static void tick(void)
{
    if (reenter)
        enter_again();
    while (preempt) {
    }
}

__attribute__((section(".vectors"), used)) static const struct {
    void *stack;
    void (*handlers[15])(void);
} table = {
    stack_top,
    {begin, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, stuck, tick},
};

static void say(const char *what, int32_t number)
{
    uint32_t digit = 10000u, rest = number < 0 ? (uint32_t)-number : (uint32_t)number;

    while (*what)
        UART(0) = (uint8_t)*what++;
    UART(0) = number < 0 ? '-' : '+';
    for (; digit > 0; digit /= 10u)
        UART(0) = '0' + rest / digit % 10u;
    UART(0) = '\n';
}

static void put32(uint8_t *at, uint32_t value)
{
    for (unsigned i = 0; i < 4; i++)
        at[i] = (uint8_t)(value >> 8 * i);
}

static int32_t ask(uint8_t tag, uint32_t len)
{
    static uint8_t number;

    call[0] = tag;
    call[PHX_CALL_CHECK_NUMBER] = ++number;
    if (phx_gate(call, len, answer, sizeof answer) < 0)
        return GATE_REFUSED;
    return (int32_t)phx_get32(answer + PHX_ANSWER_CODE);
}

static int32_t drive(void)
{
    memset(call, 0, sizeof call);
    return ask(PHX_CALL_ACTUATE, PHX_CALL_ACTUATE_BYTES + 4u);
}

/* From a new board to a robot on a mission that has no token and will get none. */
static void set_out(void)
{
    uint8_t message[PHX_MKEY_BYTES] = {PHX_MKEY};

    memset(call, 0, sizeof call);
    call[PHX_CALL_HELLO_VERSION] = PHX_LINE_VERSION;
    say("hello ", ask(PHX_CALL_HELLO, PHX_CALL_HELLO_BYTES));
    memset(call, 0, sizeof call);
    for (unsigned at = PHX_CALL_LIMITS_BATCH_SIZE; at < PHX_CALL_LIMITS_AIRTIME_FIXED_US; at += 4u)
        put32(call + at, 1);
    put32(call + PHX_CALL_LIMITS_T_VAL_MS, T_VAL_MS);
    ask(PHX_CALL_LIMITS, PHX_CALL_LIMITS_BYTES);
    memcpy(call + PHX_CALL_LOAD_MASTER_KEY, master, sizeof master);
    call[PHX_CALL_LOAD_MASTER_ID] = 7;
    call[PHX_CALL_LOAD_MASTER_ID + 1] = 0;
    ask(PHX_CALL_LOAD_MASTER, PHX_CALL_LOAD_MASTER_BYTES);
    memset(call, 0, sizeof call);
    put32(call + PHX_CALL_LOAD_MISSION_SEQ, 1);
    put32(message + PHX_MKEY_SEQ, 1);
    phx_lightmac(master, message, sizeof message, call + PHX_CALL_LOAD_MISSION_MAC);
    say("mission ", ask(PHX_CALL_LOAD_MISSION, PHX_CALL_LOAD_MISSION_BYTES));
}

static void jump(uint32_t address)
{
    ((void (*)(void))address)();
}

static void pointers(void)
{
    memset(call, 0, sizeof call);
    say("from secure ", phx_gate((const uint8_t *)0x30000000u, 8, answer, sizeof answer));
    say("to secure ", phx_gate(call, 8, (uint8_t *)0x30000000u, sizeof answer));
    say("to motors ", phx_gate(call, 8, (uint8_t *)0x50302000u, sizeof answer));
    say("over the edge ", phx_gate(call, 8, (uint8_t *)0x281fff00u, sizeof answer));
    say("around the end ", phx_gate((const uint8_t *)0xfffffff8u, 16, answer, sizeof answer));
    say("too long ", phx_gate(call, GATE_CALL_MAX + 1u, answer, sizeof answer));
    say("too short ", phx_gate(call, 2, answer, sizeof answer));
    say("no room ", phx_gate(call, 8, answer, 8));
    say("drive ", drive());
}

static void attack(uint32_t which)
{
    switch (which) {
    case HOLD_ON:
        __asm__ volatile("cpsid i\n cpsid f");
        stuck();
        break;
    case REPEAT:
        __asm__ volatile("cpsid i\n cpsid f");
        while (drive() > 0) {
        }
        say("refused ", drive());
        break;
    case SLEEP:
        REGISTER(0xe000ed10u) = 4; /* deep sleep */
        for (;;)
            __asm__ volatile("cpsid i\n wfi");
    case WRITE_MOTORS:
        for (;;)
            REGISTER(0x40302000u) = 1;
    case WRITE_MOTORS_SECURE:
        REGISTER(0x50302000u) = 1;
        break;
    case WRITE_NODES:
        REGISTER(0x30000100u) = 0;
        break;
    case READ_NODES:
        say("read ", (int32_t)REGISTER(0x30000100u));
        break;
    case JUMP_INSIDE:
        jump(0x10000201u);
        break;
    case JUMP_BESIDE:
        jump((uint32_t)phx_gate + 4u);
        break;
    case POINTERS:
        pointers();
        break;
    case RESET:
        AIRCR = 0x05fa0004u;
        say("still here ", drive());
        break;
    case HANDLERS:
        /* Its own fault handlers, turned on, before it faults. */
        REGISTER(0xe000ed24u) = 7u << 16;
        REGISTER(0x40302000u) = 1;
        say("went on ", 0);
        break;
    case PREEMPT:
        /* An interrupt that never ends, as soon as it can come: in the gate as well, if that let it in. */
        preempt = 1;
        SYST_RVR = 3000;
        SYST_CSR = 7;
        while (drive() > 0) {
        }
        break;
    case REENTER:
        /* An interrupt that calls the gate, again and again, whatever it interrupts: the gate as well, if that let it in. */
        reenter = 1;
        SYST_RVR = 1000;
        SYST_CSR = 7;
        while (drive() > 0)
            wrong += mixed_up(call, answer);
        SYST_CSR = 0;
        say("refused ", drive());
        say("mixed up ", wrong);
        say("entered ", entered > 9u);
        break;
    default:
        break;
    }
}

static void begin(void)
{
    uint32_t which = WHICH;

    memcpy(data_begin, data_from, (size_t)(data_end - data_begin));
    memset(bss_begin, 0, (size_t)(bss_end - bss_begin));
    UART(0x10) = 16;
    UART(0x08) = 1;
    set_out();
    say("drive ", drive());
    attack(which);
    say("done ", (int32_t)which);
    stuck();
}
