/* Host only: whether an order was signed by whom the mission names. C-nodes ask, and auditors when they replay them. */
#ifndef PHX_ORDER_H
#define PHX_ORDER_H

#include <stdint.h>

/* 0 if the last 64 of `length` bytes are an Ed25519 signature (RFC 8032) under `signer` of all before them, else -1.
   A key of zeros is nobody's: it is a point of small order, under which anybody could sign. */
int phx_order_check(const uint8_t signer[32], const uint8_t *data, uint32_t length);

#endif
