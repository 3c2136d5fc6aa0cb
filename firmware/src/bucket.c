/* Leaky buckets: token requests and airtime. */
#include "internal.h"

/* Takes `cost` from what has leaked in, or nothing. */
int phx_draw(phx_bucket *bucket, uint32_t now, uint32_t per_ms, uint64_t capacity, uint64_t cost)
{
    uint64_t refill = (uint64_t)(now - bucket->filled_at_ms) * per_ms;

    bucket->level = refill < capacity - bucket->level ? bucket->level + refill : capacity;
    bucket->filled_at_ms = now;
    if (bucket->level < cost)
        return -1;
    bucket->level -= cost;
    return 0;
}
