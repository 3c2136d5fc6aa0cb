/* The bucket itself: any bucket that is not above its capacity, any rate, capacity, cost and time. */
#include "proofs.h"

void prove_draw(void)
{
    phx_bucket bucket, before;
    uint32_t now;
    uint32_t per_ms;
    uint64_t capacity, cost, leaked;
    int failed;

    given(bucket.level <= capacity && bucket.filled_at_ms <= now);
    before = bucket;
    leaked = (uint64_t)(now - before.filled_at_ms) * per_ms;
    failed = phx_draw(&bucket, now, per_ms, capacity, cost);
    always(bucket.level <= capacity, "buckets: never above capacity");
    always(bucket.filled_at_ms == now, "buckets: time that has leaked in leaks in once");
    always(failed || bucket.level + cost >= cost, "buckets: never below zero");
    always(bucket.level + (failed ? 0 : cost) <= before.level + leaked || before.level + leaked < leaked,
           "buckets: nothing is handed out that had not leaked in");
    always(!failed || bucket.level < cost, "buckets: what is there is handed out");
    always(!REACHED, "reached");
}
