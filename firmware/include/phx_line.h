/* The serial line between a c-node and the two trusted nodes of its robot. Bytes in, bytes out: the port moves them, and
   does what phx_line_call says before it lets an answer out (line/serve.c is that loop).
   Whatever arrives is the c-node's: it can ask for anything, at any time, and gets an answer or nothing.
   Source: docs/spec/serial.md. */
#ifndef PHX_LINE_H
#define PHX_LINE_H

#include "phx_seal.h"
#include "phx_line_wire.h"

/* One byte more than the longest packet: what is too long is refused by a node. */
#define PHX_LINE_IN_MAX (PHX_CALL_SEND_BYTES + PHX_PACKET_MAX + 1u + PHX_LINE_CRC_BYTES)
#define PHX_LINE_OUT_MAX (PHX_ANSWER_BYTES + PHX_ENTRY_HEADER_BYTES + PHX_PACKET_MAX + PHX_LINE_CRC_BYTES)

/* What a port has to do with the nodes before it answers. */
enum {
    PHX_LINE_KEEP = 1,    /* write both nodes' flash part out */
    PHX_LINE_ACTUATE = 2, /* what phx_line_command gives goes to the actuators */
    PHX_LINE_CLOCK = 4    /* the clock shows told_ms; with PHX_LINE_TOLD_CLOCK only */
};

typedef struct {
    uint32_t len;      /* of what has arrived of a frame, unpacked */
    uint32_t call_len; /* of the call in `in`, once it is whole */
    uint32_t out_len;  /* of the answer with its CRC; it stays until the next call, in case it is asked for again */
    uint32_t out_at;
    uint32_t told_ms;
    uint16_t number;   /* of the last call */
    uint8_t left;      /* bytes until the next length */
    uint8_t gap;       /* a zero stands before them */
    uint8_t lost;      /* too long: nothing counts until the next mark */
    uint8_t greeted;   /* since power-up, in our version */
    uint8_t stage;     /* of the answer that goes out */
    uint8_t run;       /* bytes until its next length */
    uint8_t full;      /* no zero stands behind them */
    uint8_t in[PHX_LINE_IN_MAX];
    uint8_t out[PHX_LINE_OUT_MAX];
} phx_line;

/* CRC-32 (ISO-HDLC). */
uint32_t phx_crc32(const uint8_t *data, uint32_t len);
uint32_t phx_get32(const uint8_t *at);

/* A line begins as zeros. 1: a call is whole, and phx_line_call comes before the next byte. */
int phx_line_byte(phx_line *line, uint8_t byte);
/* The answer goes out from its beginning: once after each call. */
void phx_line_say(phx_line *line);
/* 1: here is the next byte of the answer; 0: it is out. */
int phx_line_next(phx_line *line, uint8_t *byte);

/* `told` is what this board leaves to the c-node. Returns what the port has to do, the enum above. */
uint32_t phx_line_call(phx_line *line, phx_snode *s, phx_anode *a, phx_seals *seals, uint32_t now, uint8_t told);
/* What the call that has just been answered may pass on to the actuators; `len` bytes. */
const uint8_t *phx_line_command(const phx_line *line, uint32_t *len);

#endif
