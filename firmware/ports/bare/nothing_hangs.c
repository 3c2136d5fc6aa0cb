/* A board without motors and sensors of its own. */
#include "board.h"

void phx_port_actuate(const uint8_t *command, uint32_t len)
{
    (void)command;
    (void)len;
}

uint32_t phx_port_sense(uint8_t *reading)
{
    (void)reading;
    return 0;
}
