/* What the host's sources share: what is asked for, and what the processor has. */
#ifndef PHX_HOST_SHARED_H
#define PHX_HOST_SHARED_H

#include "host.h"

enum { PHX_HOST_SHA = 1, PHX_HOST_AVX2 = 2 };

extern int phx_host_uses; /* of these, what the next call may take */
extern uint64_t phx_host_counts[2]; /* blocks hashed, and encrypted */

#endif
