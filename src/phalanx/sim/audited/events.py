"""A queue of events in the order of simulated time, in arrays that are made once.

A heap holds what is due within this millisecond; what is due later waits in a wheel of buckets, a millisecond each, in
no order, until its turn comes (Varghese and Lauck, SOSP 1987). So an event costs the same whatever waits.
Events of one microsecond come out in the order in which they went in, so that a run is the same every time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.bundle import bundled
from phalanx.errors import UsageError
from phalanx.kernel import kernel

NOTHING = -1
NEVER_US = np.iinfo(np.int64).max
# A bucket is 1024 µs; once round the wheel is 4.2 s, longer than a round of audits.
BUCKETS, SHIFT = 4096, 10
# What `tally` counts: events that wait, pushes so far, pushes refused for want of room; of those that wait, how many
# are in the heap; the first free place; and the millisecond that the heap is of.
_WAITING, _PUSHED, _REFUSED, _NEAR, _FREE, _WINDOW = range(6)


class Queue(NamedTuple):
    """Room for a fixed number of events, each of which has a place while it waits."""

    heap: NDArray[np.int32]  # (C,), places of the events that are near, the earliest first
    key: NDArray[np.int64]  # (C, 2): time in µs, number of the push
    data: NDArray[np.int64]  # (C, 3): kind, robot, arg; what they mean is the caller's affair
    after: NDArray[np.int32]  # (C,): the next place of the same bucket, or the next that is free
    bucket: NDArray[np.int32]  # (BUCKETS,): the first place of each
    tally: NDArray[np.int64]  # (6,)


pack = bundled(Queue)


def make_queue(capacity: int) -> Queue:
    """An empty queue in which so many may wait at once; the radio keeps at most two a robot there.

    Raises: UsageError: no room for a single event.
    """
    if capacity < 1:
        raise UsageError(f"queue for {capacity} events", "at least 1")
    after = np.arange(1, capacity + 1, dtype=np.int32)
    after[-1] = NOTHING
    queue = Queue(
        heap=np.zeros(capacity, np.int32),
        key=np.zeros((capacity, 2), np.int64),
        data=np.zeros((capacity, 3), np.int64),
        after=after,
        bucket=np.full(BUCKETS, NOTHING, np.int32),
        tally=np.zeros(6, np.int64),
    )
    return pack(queue)


@kernel
def push(queue: Queue, t_us: int, kind: int, robot: int, arg: int) -> int:
    """0, and the event waits for its time; or -1 if the queue is full: then it is only counted, see `refused`."""
    tally, place = queue.tally, queue.tally[_FREE]
    if place == NOTHING:
        tally[_REFUSED] += 1
        return -1
    tally[_FREE] = queue.after[place]
    queue.key[place, 0], queue.key[place, 1] = t_us, tally[_PUSHED]
    queue.data[place, 0], queue.data[place, 1], queue.data[place, 2] = kind, robot, arg
    tally[_WAITING] += 1
    tally[_PUSHED] += 1
    _wait(queue, place)
    return 0


@kernel
def pop(queue: Queue) -> tuple[int, int, int, int]:
    """The earliest event as (t_us, kind, robot, arg), taken out; NEVER_US and three times NOTHING if none waits."""
    tally, heap = queue.tally, queue.heap
    if tally[_WAITING] == 0:
        return NEVER_US, NOTHING, NOTHING, NOTHING
    _turn(queue)
    place = heap[0]
    tally[_WAITING] -= 1
    tally[_NEAR] -= 1
    last = tally[_NEAR]
    moved, at = heap[last], 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and _before(queue, heap[below + 1], heap[below]):
            below += 1
        if _before(queue, moved, heap[below]):
            break
        heap[at] = heap[below]
        at = below
    heap[at] = moved
    queue.after[place] = tally[_FREE]
    tally[_FREE] = place
    return queue.key[place, 0], queue.data[place, 0], queue.data[place, 1], queue.data[place, 2]


@kernel
def next_us(queue: Queue) -> int:
    """When the earliest event is due, µs; NEVER_US if none waits."""
    if queue.tally[_WAITING] == 0:
        return NEVER_US
    _turn(queue)
    return queue.key[queue.heap[0], 0]  # type: ignore[no-any-return]


@kernel
def refused(queue: Queue) -> int:
    """How many pushes found no room, ever: a run in which this is not 0 is wrong."""
    return queue.tally[_REFUSED]  # type: ignore[no-any-return]


@kernel
def _wait(queue: Queue, place: int) -> None:
    """The event is in the heap if its time has come or is past, or else in its bucket."""
    window = queue.key[place, 0] >> SHIFT
    if window <= queue.tally[_WINDOW]:
        _rise(queue, place)
    else:
        bucket = window & (BUCKETS - 1)
        queue.after[place] = queue.bucket[bucket]
        queue.bucket[bucket] = place


@kernel
def _rise(queue: Queue, place: int) -> None:
    heap, at = queue.heap, queue.tally[_NEAR]
    queue.tally[_NEAR] += 1
    while at > 0:
        above = (at - 1) >> 1
        if _before(queue, heap[above], place):
            break
        heap[at] = heap[above]
        at = above
    heap[at] = place


@kernel
def _turn(queue: Queue) -> None:
    """Something waits: the wheel turns until some of it is in the heap."""
    tally, turned = queue.tally, 0
    while tally[_NEAR] == 0:
        if turned == BUCKETS:  # nothing for a whole turn: the rest is far away
            tally[_WINDOW] = _earliest(queue) - 1
        turned += 1
        tally[_WINDOW] += 1
        bucket = tally[_WINDOW] & (BUCKETS - 1)
        place = queue.bucket[bucket]
        queue.bucket[bucket] = NOTHING
        while place != NOTHING:
            after = queue.after[place]
            _wait(queue, place)
            place = after


@kernel
def _earliest(queue: Queue) -> int:
    """The earliest millisecond in which anything in the wheel is due."""
    window = NEVER_US
    for bucket in range(BUCKETS):
        place = queue.bucket[bucket]
        while place != NOTHING:
            window = min(window, queue.key[place, 0] >> SHIFT)
            place = queue.after[place]
    return int(window)


@kernel
def _before(queue: Queue, one: int, other: int) -> bool:
    keys = queue.key
    return bool(keys[one, 0] < keys[other, 0] or (keys[one, 0] == keys[other, 0] and keys[one, 1] < keys[other, 1]))
