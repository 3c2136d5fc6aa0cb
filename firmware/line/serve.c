/* The loop of a board that is asked over a serial line. */
#include "phx_port.h"

static void say(phx_line *line)
{
    uint8_t byte;

    phx_line_say(line);
    while (phx_line_next(line, &byte)) {
        /* As long as the c-node does not listen: a line that stands still must not stop the checks. */
        while (!phx_port_put(byte))
            phx_robot_check();
    }
}

void phx_serve_once(void)
{
    phx_line *line = phx_robot_line();
    uint8_t byte;

    phx_robot_check();
    if (!phx_port_get(&byte) || !phx_line_byte(line, byte))
        return;
    phx_robot_answer();
    say(line);
}

void phx_serve(void)
{
    phx_robot_power_up();
    for (;;)
        phx_serve_once();
}
