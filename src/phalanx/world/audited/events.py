"""Queue of events in order of simulated time, in preallocated arrays.

A heap holds the events of the current window (1024 us). Later ones wait unsorted in a timer wheel with one bucket per
window (Varghese and Lauck, SOSP 1987), so the cost per event does not depend on their number.
Events of the same microsecond are popped in the order of insertion, so runs are reproducible.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import I32x1, I64x1, Records, layout
from phalanx.bundle import bundled
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.wire.fields import whole

NOTHING = -1
# Kinds of events of a robot: time to read its sensors; arrival of a packet.
CONTROL, MESSAGE = 10, 16
NEVER_US = np.iinfo(np.int64).max
# A bucket is 1024 µs; one turn of the wheel is 4.2 s, longer than a round of audits.
BUCKETS, SHIFT = 4096, 10
# Fields of `tally`: waiting events; pushes so far; pushes refused because the queue was full; waiting events in the
# heap; last released place; places ever used; window of the heap, in units of 1024 µs.
_WAITING, _PUSHED, _REFUSED, _NEAR, _FREE, _TAKEN, _WINDOW = range(7)


EVENT = layout(
    "t_us i8",
    "number i8",  # of the push
    # Defined by the caller.
    "kind robot arg i4",
    "after i4",  # next place in the same bucket, or next free place
)


class Queue(NamedTuple):
    """Storage for a fixed number of waiting events, each in one place."""

    heap: I32x1  # (C,), places of the events in the heap, earliest first
    event: Annotated[Any, Records(EVENT)]  # (C,)
    bucket: I32x1  # (BUCKETS,), first place of each bucket
    tally: I64x1  # (7,)


pack = bundled(Queue)


def make_queue(capacity: int) -> Queue:
    """Return an empty queue for up to `capacity` waiting events; the radio needs at most two for each robot.

    Raises: UsageError: the capacity is less than 1.
    """
    if capacity < 1:
        raise UsageError(f"queue for {capacity} events", "use at least 1")
    queue = Queue(
        heap=np.zeros(capacity, np.int32),
        event=np.zeros(capacity, EVENT).view(np.recarray),
        bucket=np.full(BUCKETS, NOTHING, np.int32),
        tally=np.zeros(7, np.int64),
    )
    queue.tally[_FREE] = NOTHING
    return pack(queue)


@kernel
def push(queue: Queue, t_us: int, kind: int, robot: int, arg: int) -> int:
    """Add an event. Returns: 0; -1: the queue is full; the event is dropped and counted (`refused`)."""
    tally, place = queue.tally, queue.tally[_FREE]
    if place != NOTHING:
        tally[_FREE] = queue.event[place].after
    elif tally[_TAKEN] < len(queue.event):
        place = tally[_TAKEN]
        tally[_TAKEN] += 1
    else:
        tally[_REFUSED] += 1
        return -1
    event = queue.event[place]
    event.t_us, event.number = t_us, tally[_PUSHED]
    event.kind, event.robot, event.arg = kind, robot, arg
    tally[_WAITING] += 1
    tally[_PUSHED] += 1
    _wait(queue, place)
    return 0


@kernel
def pop(queue: Queue) -> tuple[int, int, int, int]:
    """Remove the earliest event; return (t_us, kind, robot, arg), or NEVER_US and three times NOTHING if none waits."""
    tally, heap = queue.tally, queue.heap
    if tally[_WAITING] == 0:
        return NEVER_US, NOTHING, NOTHING, NOTHING
    _turn(queue)
    place = int(heap[0])
    tally[_WAITING] -= 1
    tally[_NEAR] -= 1
    last = tally[_NEAR]
    moved, at = int(heap[last]), 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and _before(queue, int(heap[below + 1]), int(heap[below])):
            below += 1
        if _before(queue, moved, int(heap[below])):
            break
        heap[at] = heap[below]
        at = below
    heap[at] = moved
    event = queue.event[place]
    event.after = tally[_FREE]
    tally[_FREE] = place
    return event.t_us, whole(event.kind), whole(event.robot), whole(event.arg)


@kernel
def peek(queue: Queue) -> int:
    """Return the robot of the next event if that is in the heap, else NOTHING."""
    return NOTHING if queue.tally[_NEAR] == 0 else whole(queue.event[queue.heap[0]].robot)


@kernel
def next_us(queue: Queue) -> int:
    """Return the time of the earliest event, µs; NEVER_US if none waits."""
    if queue.tally[_WAITING] == 0:
        return NEVER_US
    _turn(queue)
    return queue.event[queue.heap[0]].t_us  # type: ignore[no-any-return]


@kernel
def refused(queue: Queue) -> int:
    """Return the number of pushes dropped because the queue was full; if it is not 0, the run is invalid."""
    return queue.tally[_REFUSED]  # type: ignore[no-any-return]


@kernel
def _wait(queue: Queue, place: int) -> None:
    """Put an event into the heap if its window has come, otherwise into its bucket."""
    event = queue.event[place]
    window = event.t_us >> SHIFT
    if window <= queue.tally[_WINDOW]:
        _rise(queue, place)
    else:
        bucket = window & (BUCKETS - 1)
        event.after = queue.bucket[bucket]
        queue.bucket[bucket] = place


@kernel
def _rise(queue: Queue, place: int) -> None:
    heap, at = queue.heap, queue.tally[_NEAR]
    queue.tally[_NEAR] += 1
    while at > 0:
        above = (at - 1) >> 1
        if _before(queue, int(heap[above]), place):
            break
        heap[at] = heap[above]
        at = above
    heap[at] = place


@kernel
def _turn(queue: Queue) -> None:
    """Advance the wheel until an event is in the heap; at least one must wait."""
    tally, turned = queue.tally, 0
    while tally[_NEAR] == 0:
        if turned == BUCKETS:  # a whole turn without events: skip to the earliest
            tally[_WINDOW] = _earliest(queue) - 1
        turned += 1
        tally[_WINDOW] += 1
        bucket = tally[_WINDOW] & (BUCKETS - 1)
        place = int(queue.bucket[bucket])
        queue.bucket[bucket] = NOTHING
        while place != NOTHING:
            after = int(queue.event[place].after)
            _wait(queue, place)
            place = after


@kernel
def _earliest(queue: Queue) -> int:
    """Return the earliest window of the events in the wheel."""
    window = NEVER_US
    for bucket in range(BUCKETS):
        place = int(queue.bucket[bucket])
        while place != NOTHING:
            window = min(window, queue.event[place].t_us >> SHIFT)
            place = int(queue.event[place].after)
    return int(window)


@kernel
def _before(queue: Queue, one: int, other: int) -> bool:
    first, second = queue.event[one], queue.event[other]
    return bool(first.t_us < second.t_us or (first.t_us == second.t_us and first.number < second.number))
