"""List of neighbours in a controller's state: records `neighbour` by rising id, after the controller's own fields.

`head` is the length of those fields, whose last two bytes are the number of neighbours. The order is the same in any
replay.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.wire import table
from phalanx.wire.fields import F32_BYTES, Row, are_fine, copy, get_u16, get_u64, put_u16, put_u64, whole

EACH_BYTES = table.NEIGHBOUR.size
HEARD, PLACE = map(table.NEIGHBOUR.at, ("heard", "x_m"))
STATE_BYTES, SENSOR_BYTES = table.STATE.size, table.SENSOR.size
ID, MOTION = map(table.STATE.at, ("id", "x_m"))  # position and velocity; the same in a reading and in the list
MOTION_BYTES = STATE_BYTES - MOTION
NUMBERS = MOTION_BYTES // F32_BYTES
COUNT_BYTES = table.FLOCK_MEMORY.size - table.FLOCK_MEMORY.at("count")


@kernel
def is_reading(rob_id: int, reading: Row, length: int) -> bool:
    """Return whether these bytes are a reading of this robot, a `sensor` with finite numbers."""
    is_own = length == SENSOR_BYTES and reading[0] == table.KIND_SENSOR and get_u16(reading, ID) == rob_id
    return is_own and are_fine(reading, MOTION, NUMBERS)


@kernel
def sender(rob_id: int, packet: Row, length: int) -> int:
    """Return the id of the other robot that sent this packet, if it is a `state` with finite numbers, else 0."""
    if length != STATE_BYTES or packet[0] != table.KIND_STATE or not are_fine(packet, MOTION, NUMBERS):
        return 0
    rob = get_u16(packet, ID)
    return rob if rob != rob_id else 0


@kernel
def count(state: Row, head: int) -> int:
    """Return the number of neighbours."""
    return get_u16(state, head - COUNT_BYTES)


@kernel
def end(state: Row, head: int) -> int:
    """Return the length of the encoded list."""
    return head + EACH_BYTES * count(state, head)


@kernel
def are_neighbours(state: Row, head: int, rob_id: int) -> bool:
    """Return whether the list is valid in the state of `rob_id`; the row must be long enough for it."""
    last = whole(0)
    for at in range(head, end(state, head), EACH_BYTES):
        rob = get_u16(state, at)
        if rob <= last or rob == rob_id or get_u64(state, at + HEARD) < 0 or not are_fine(state, at + PLACE, NUMBERS):
            return False
        last = rob
    return True


@kernel
def place_of(rob: int, state: Row, head: int) -> int:
    """Return the position of `rob` in the list, or where to insert it."""
    low, high = whole(0), count(state, head)
    while low < high:
        middle = (low + high) >> 1
        if get_u16(state, head + EACH_BYTES * middle) < rob:
            low = middle + 1
        else:
            high = middle
    return head + EACH_BYTES * low


@kernel
def is_at(rob: int, at: int, state: Row, head: int) -> bool:
    """Return whether the entry at `at` is that of `rob`."""
    return at < end(state, head) and get_u16(state, at) == rob


@kernel
def put(rob: int, t_ms: int, packet: Row, at: int, state: Row, head: int) -> None:
    """Store `packet` as the latest state of `rob` at `at`, its place in the list; there must be room for it."""
    if not is_at(rob, at, state, head):
        copy(state, at + EACH_BYTES, state, at, end(state, head) - at)
        put_u16(state, head - COUNT_BYTES, count(state, head) + 1)
    put_u16(state, at, rob)
    put_u64(state, at + HEARD, t_ms)
    copy(state, at + PLACE, packet, MOTION, MOTION_BYTES)


@kernel
def oldest(state: Row, head: int) -> int:
    """Return the offset of the neighbour with the oldest state; of several, that with the lowest id."""
    found = head
    for at in range(head, end(state, head), EACH_BYTES):
        if get_u64(state, at + HEARD) < get_u64(state, found + HEARD):
            found = at
    return found


@kernel
def remove(at: int, state: Row, head: int) -> None:
    """Remove the neighbour at `at`."""
    copy(state, at, state, at + EACH_BYTES, end(state, head) - EACH_BYTES - at)
    put_u16(state, head - COUNT_BYTES, count(state, head) - 1)


@kernel
def remember(rob: int, n_max: int, t_ms: int, packet: Row, state: Row, head: int) -> None:
    """Store `packet` as the latest state of `rob`; if it is new and the list is full, replace the oldest neighbour."""
    at = place_of(rob, state, head)
    if count(state, head) == n_max and not is_at(rob, at, state, head):
        remove(oldest(state, head), state, head)
        at = place_of(rob, state, head)
    put(rob, t_ms, packet, at, state, head)


@kernel
def forget(forget_ms: int, t_ms: int, state: Row, head: int) -> None:
    """Remove neighbours whose state is older than `forget_ms` at `t_ms`, keeping the order of the others."""
    kept = head
    for at in range(head, end(state, head), EACH_BYTES):
        if t_ms - get_u64(state, at + HEARD) <= forget_ms:
            if kept != at:
                copy(state, kept, state, at, EACH_BYTES)
            kept += EACH_BYTES
    put_u16(state, head - COUNT_BYTES, (kept - head) // EACH_BYTES)
