/* Flash of a board that has none, as QEMU's: memory that a reset leaves as it is. */
#include <string.h>

#include "board.h"

#define SLOT_BYTES 512u

/* Behind all that start.c, or what loads the program, fills with zeros (sections.ld). */
extern uint8_t kept_begin[];

int phx_port_flash_write(uint32_t slot, const uint8_t *data, uint32_t len)
{
    memset(kept_begin + slot * SLOT_BYTES, 0xff, SLOT_BYTES);
    memcpy(kept_begin + slot * SLOT_BYTES, data, len);
    return 0;
}

void phx_port_flash_read(uint32_t slot, uint8_t *data, uint32_t len)
{
    memcpy(data, kept_begin + slot * SLOT_BYTES, len);
}
