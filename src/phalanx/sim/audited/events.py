"""A queue of events in the order of simulated time: a binary heap in arrays that are made once.

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
_WAITING, _PUSHED, _REFUSED = 0, 1, 2


class Queue(NamedTuple):
    """Room for a fixed number of events."""

    keys: NDArray[np.int64]  # (C, 2), heap: time in µs, number of the push
    data: NDArray[np.int64]  # (C, 3): kind, robot, arg; what they mean is the caller's affair
    tally: NDArray[np.int64]  # (3,): events that wait, pushes so far, pushes refused for want of room


pack = bundled(Queue)


def make_queue(capacity: int) -> Queue:
    """An empty queue in which so many may wait at once; the radio keeps at most two a robot there.

    Raises: UsageError: no room for a single event.
    """
    if capacity < 1:
        raise UsageError(f"queue for {capacity} events", "at least 1")
    queue = Queue(np.zeros((capacity, 2), np.int64), np.zeros((capacity, 3), np.int64), np.zeros(3, np.int64))
    return pack(queue)


@kernel
def push(queue: Queue, t_us: int, kind: int, robot: int, arg: int) -> int:
    """0, and the event waits for its time; or -1 if the queue is full: then it is only counted, see `refused`."""
    keys, data, tally = queue.keys, queue.data, queue.tally
    at = tally[_WAITING]
    if at == len(keys):
        tally[_REFUSED] += 1
        return -1
    number = tally[_PUSHED]
    tally[_WAITING] += 1
    tally[_PUSHED] += 1
    while at > 0:
        above = (at - 1) >> 1
        if keys[above, 0] <= t_us:  # of two at the same time the older stays above
            break
        _move(keys, data, above, at)
        at = above
    keys[at, 0], keys[at, 1] = t_us, number
    data[at, 0], data[at, 1], data[at, 2] = kind, robot, arg
    return 0


@kernel
def pop(queue: Queue) -> tuple[int, int, int, int]:
    """The earliest event as (t_us, kind, robot, arg), taken out; NEVER_US and three times NOTHING if none waits."""
    keys, data, tally = queue.keys, queue.data, queue.tally
    if tally[_WAITING] == 0:
        return NEVER_US, NOTHING, NOTHING, NOTHING
    first = (keys[0, 0], data[0, 0], data[0, 1], data[0, 2])
    tally[_WAITING] -= 1
    last = tally[_WAITING]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and _before(keys, below + 1, below):
            below += 1
        if _before(keys, last, below):
            break
        _move(keys, data, below, at)
        at = below
    _move(keys, data, last, at)
    return first


@kernel
def next_us(queue: Queue) -> int:
    """When the earliest event is due, µs; NEVER_US if none waits."""
    return queue.keys[0, 0] if queue.tally[_WAITING] else NEVER_US


@kernel
def refused(queue: Queue) -> int:
    """How many pushes found no room, ever: a run in which this is not 0 is wrong."""
    return queue.tally[_REFUSED]  # type: ignore[no-any-return]


@kernel
def _before(keys: NDArray[np.int64], a: int, b: int) -> bool:
    return bool(keys[a, 0] < keys[b, 0] or (keys[a, 0] == keys[b, 0] and keys[a, 1] < keys[b, 1]))


@kernel
def _move(keys: NDArray[np.int64], data: NDArray[np.int64], source: int, target: int) -> None:
    keys[target, 0], keys[target, 1] = keys[source, 0], keys[source, 1]
    data[target, 0], data[target, 1], data[target, 2] = data[source, 0], data[source, 1], data[source, 2]
