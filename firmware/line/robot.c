/* A robot's trusted part, whatever asks it: calls are answered, tokens are checked, motors stand still without a key and in
   Safe Mode. One of these functions runs at a time. */
#include <string.h>

#include "phx_port.h"

#define CHECK_EVERY_MS 10u /* of the 100 that are allowed */

static phx_snode snode;
static phx_anode anode;
static phx_seals seals;
static phx_line line;
static uint32_t checked_ms;

phx_line *phx_robot_line(void)
{
    return &line;
}

void phx_robot_power_up(void)
{
    memset(&line, 0, sizeof line);
    memset(&seals, 0, sizeof seals);
    checked_ms = 0;
    if (phx_keep_load(&snode, &anode))
        phx_port_halt();
    phx_port_actuate(0, 0);
}

/* With a clock that is told, checking is as well. */
void phx_robot_check(void)
{
    uint32_t now = phx_port_now();

    if (phx_port_told() & PHX_LINE_TOLD_CLOCK || now - checked_ms < CHECK_EVERY_MS)
        return;
    checked_ms = now;
    if (phx_anode_check(&anode, now) || !anode.node.has_key)
        phx_port_actuate(0, 0);
}

void phx_robot_answer(void)
{
    const uint8_t *command;
    uint32_t len, todo;

    if (line.in[0] == PHX_CALL_POLL && !(phx_port_told() & PHX_LINE_TOLD_READINGS))
        line.call_len = PHX_CALL_POLL_BYTES + phx_port_sense(line.in + PHX_CALL_POLL_BYTES);
    todo = phx_line_call(&line, &snode, &anode, &seals, phx_port_now(), phx_port_told());
    if (todo & PHX_LINE_KEEP && phx_keep(&snode, &anode))
        phx_port_halt();
    if (todo & PHX_LINE_CLOCK)
        phx_port_set_clock(line.told_ms);
    if (todo & PHX_LINE_ACTUATE) {
        command = phx_line_command(&line, &len);
        phx_port_actuate(command, len);
    }
}
