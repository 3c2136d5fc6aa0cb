/* What is kept without power: twice, each with a number and a CRC, so that whenever power fails one is whole. Whatever
   was kept before is followed by an answer, or never was: a mission number whose keeping was cut short was not used. */
#include <string.h>

#include "phx_port.h"

typedef struct {
    uint32_t number; /* rises */
    phx_flash s;
    phx_flash a;
    uint32_t crc;
} kept;

static uint32_t crc_of(const kept *k)
{
    return phx_crc32((const uint8_t *)k, (uint32_t)offsetof(kept, crc));
}

/* Its number, or 0 if it is blank, torn or another firmware's. */
static uint32_t read_slot(uint32_t slot, kept *k)
{
    phx_port_flash_read(slot, (uint8_t *)k, sizeof *k);
    return crc_of(k) == k->crc ? k->number : 0;
}

static int write_slot(uint32_t slot, const kept *k)
{
    kept back;

    if (phx_port_flash_write(slot, (const uint8_t *)k, sizeof *k))
        return -1;
    return read_slot(slot, &back) == k->number ? 0 : -1;
}

/* The newer one; which of both it is. */
static uint32_t newest(kept *k)
{
    kept other;
    uint32_t number = read_slot(0, k);

    if (read_slot(1, &other) <= number)
        return 0;
    *k = other;
    return 1;
}

int phx_keep(const phx_snode *s, const phx_anode *a)
{
    kept k;
    uint32_t number = read_slot(newest(&k), &k);

    /* Padding is zero, so that the CRC is of what is kept alone. */
    memset(&k, 0, sizeof k);
    k.number = number + 1u;
    k.s = s->node.flash;
    k.a = a->node.flash;
    k.crc = crc_of(&k);
    /* They were alike: while the first is written the second counts. */
    return write_slot(0, &k) || write_slot(1, &k) ? -1 : 0;
}

int phx_keep_load(phx_snode *s, phx_anode *a)
{
    kept k, other;
    uint32_t slot = newest(&k);

    memset(s, 0, sizeof *s);
    memset(a, 0, sizeof *a);
    if (read_slot(slot, &k) == 0)
        return 0;
    s->node.flash = k.s;
    a->node.flash = k.a;
    /* Power failed between the two: with one alone the next failure could take both. */
    return read_slot(1u - slot, &other) == k.number ? 0 : write_slot(1u - slot, &k);
}
