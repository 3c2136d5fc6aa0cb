"""A queue of events in the order of simulated time, in arrays that are made once.

A heap holds the events that are due within this millisecond. Later ones wait unsorted in a timer wheel of buckets, a
millisecond each (Varghese and Lauck, SOSP 1987). So an event costs the same however many wait.
Events of one microsecond come out in the order in which they went in, so a run is the same every time.
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
# Kinds of events of a robot: its sensors are due, a packet has arrived.
CONTROL, MESSAGE = 10, 16
NEVER_US = np.iinfo(np.int64).max
# A bucket is 1024 µs; once round the wheel is 4.2 s, longer than a round of audits.
BUCKETS, SHIFT = 4096, 10
# Fields of `tally`: events that wait; pushes so far; pushes refused because the queue was full; waiting events that are
# in the heap; the place released last; places ever used; the millisecond that the heap holds.
_WAITING, _PUSHED, _REFUSED, _NEAR, _FREE, _TAKEN, _WINDOW = range(7)


EVENT = layout(
    "t_us i8",
    "number i8",  # of the push
    # Their meaning is the caller's.
    "kind robot arg i4",
    "after i4",  # the next place of the same bucket, or the next that is free
)


class Queue(NamedTuple):
    """Room for a fixed number of events, each of which has a place while it waits."""

    heap: I32x1  # (C,), places of the events that are near, the earliest first
    event: Annotated[Any, Records(EVENT)]  # (C,)
    bucket: I32x1  # (BUCKETS,): the first place of each
    tally: I64x1  # (7,)


pack = bundled(Queue)


def make_queue(capacity: int) -> Queue:
    """Return an empty queue for `capacity` waiting events; the radio needs at most two for each robot.

    Raises: UsageError: no room for a single event.
    """
    if capacity < 1:
        raise UsageError(f"queue for {capacity} events", "at least 1")
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
    """Add an event. Returns: 0; -1: the queue is full, and the event is dropped and counted (`refused`)."""
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
    """Return the robot of the next event if it is due within this millisecond, else NOTHING."""
    return NOTHING if queue.tally[_NEAR] == 0 else whole(queue.event[queue.heap[0]].robot)


@kernel
def next_us(queue: Queue) -> int:
    """Return when the earliest event is due, µs; NEVER_US if none waits."""
    if queue.tally[_WAITING] == 0:
        return NEVER_US
    _turn(queue)
    return queue.event[queue.heap[0]].t_us  # type: ignore[no-any-return]


@kernel
def refused(queue: Queue) -> int:
    """Return how many pushes found the queue full, ever: a run in which this is not 0 is wrong."""
    return queue.tally[_REFUSED]  # type: ignore[no-any-return]


@kernel
def _wait(queue: Queue, place: int) -> None:
    """Put an event into the heap if its millisecond has come, otherwise into its bucket."""
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
    """Turn the wheel until an event is in the heap; at least one must wait."""
    tally, turned = queue.tally, 0
    while tally[_NEAR] == 0:
        if turned == BUCKETS:  # nothing for a whole turn: the rest is far away
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
    """Return the earliest millisecond in which an event in the wheel is due."""
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
