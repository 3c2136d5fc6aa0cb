/* What a port supplies: one small file a board. line/serve.c does the rest. None of these may block for longer than a few
   ms. Source: docs/guides/porting.md. */
#ifndef PHX_PORT_H
#define PHX_PORT_H

#include "phx_line.h"

#define PHX_FLASH_SLOTS 2u

/* Milliseconds since power-up; never fewer than before, and 2^32 - 1 for ever once it is there. */
uint32_t phx_port_now(void);
/* What hangs on the c-node instead of this board: PHX_LINE_TOLD_... */
uint8_t phx_port_told(void);
/* The clock of a bench; no board has one. */
void phx_port_set_clock(uint32_t now);
/* 1: a byte has come. */
int phx_port_get(uint8_t *byte);
/* 1: the byte is on its way; 0: there is no room for it yet. */
int phx_port_put(uint8_t byte);
/* One of the slots, which is erased and written, or read, as a whole. Writing returns 0 once it is safe without power. */
int phx_port_flash_write(uint32_t slot, const uint8_t *data, uint32_t len);
void phx_port_flash_read(uint32_t slot, uint8_t *data, uint32_t len);
/* The command goes to the actuators, or with a length of 0 they stop. */
void phx_port_actuate(const uint8_t *command, uint32_t len);
/* A sensor's reading, at most PHX_PACKET_MAX bytes; 0 where PHX_LINE_TOLD_READINGS. */
uint32_t phx_port_sense(uint8_t *reading);
/* Flash cannot be written: silence, until power-up. */
void phx_port_halt(void);

/* keep.c: the nodes' flash part in both slots. Returns 0, or -1 if no slot could be written. */
int phx_keep(const phx_snode *s, const phx_anode *a);
/* keep.c: both nodes as they are after power-up; zero if nothing was ever kept. Returns as phx_keep. */
int phx_keep_load(phx_snode *s, phx_anode *a);
/* robot.c: both nodes and their line, from power-up on; the call in the line's `in` is done, its answer is in `out`. */
phx_line *phx_robot_line(void);
void phx_robot_power_up(void);
void phx_robot_answer(void);
/* robot.c: tokens are checked and motors stopped, if it is time; to be called every 10 ms. */
void phx_robot_check(void);
/* serve.c: power-up, and then whatever comes over the line is answered, for ever; and one turn of that. */
void phx_serve(void);
void phx_serve_once(void);

#endif
