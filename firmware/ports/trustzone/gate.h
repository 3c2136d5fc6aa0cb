/* The one door from the non-secure world into the secure one. */
#ifndef GATE_H
#define GATE_H

#include <stdint.h>

#define GATE_CALL_MAX 2052u  /* bytes of a call at most */
#define GATE_ANSWER_MAX 2062u /* and room that its answer needs */
#define GATE_REFUSED (-66)   /* pointers that are not the c-node's own, or lengths that make no sense */

/* The call is done (docs/spec/serial.md, without frames). Returns the answer's length, or GATE_REFUSED. */
int32_t phx_gate(const uint8_t *call, uint32_t len, uint8_t *answer, uint32_t room);

#endif
