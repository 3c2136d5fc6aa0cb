"""The orders a robot obeys: for it, of its mission, new, in time, and signed by a key that the mission names.

Only an order that could be obeyed has its signature checked, and at most WheelsConfig.looks of these from one reading
to the next: a compromised robot cannot make others compute all day. Clocks need not agree: a robot learns from every
order by how much its own is ahead of the signer's, at least; what comes LATE_MS later was held back. The least may
grow by a part in DRIFT. Auditors decide alike from log and state, where `at` is a signer's record. Source:
docs/spec/orders.md; ADR 0031.
"""

from __future__ import annotations

from phalanx.bti import trusted
from phalanx.kernel import kernel
from phalanx.wire import driven
from phalanx.wire.fields import Row, get_u16, get_u32, get_u64, put_u64, whole

MISSION, WHO, NUMBER, SAID = map(driven.ORDER.at, ("mission", "signer", "number", "said"))
ID, ACTION, BODY = map(driven.ORDER.at, ("id", "action", "body"))
THRESHOLD, COUNT, POINTS = (BODY + driven.ORDER_ROUTE.at(name) for name in ("threshold_mm", "count", "points"))
HIGHEST, LATEST, LEAST, LEARNT = map(driven.SIGNER.at, ("number", "said", "least", "learnt"))
EACH_BYTES = driven.SIGNER.size
WHEELS_BYTES, LED_BYTES, ROUTE_BYTES, POINT_BYTES = (
    driven.ORDER_WHEELS.size,
    driven.ORDER_LED.size,
    driven.ORDER_ROUTE.size,
    driven.WAYPOINT.size,
)
POINT_X, POINT_Y = map(driven.WAYPOINT.at, ("x_mm", "y_mm"))
WAYPOINTS_MAX = 32
THRESHOLD_MAX_MM = 1000
LATE_MS = 1000
# Of two clocks, the one may gain a part in so many on the other: 500 ppm.
DRIFT = 2000
# No clock gets there: a signer that was never heard.
NEVER = 1 << 62


@kernel
def is_order(mission: int, rob_id: int, packet: Row, length: int) -> bool:
    """Return whether the packet has an order's form, for this robot and mission; its signature is not checked."""
    size = length - BODY - driven.SIGNATURE_BYTES
    if (
        size < 0
        or packet[0] != driven.KIND_ORDER
        or get_u32(packet, MISSION) != mission
        or packet[WHO] >= driven.SIGNERS
    ):
        return False
    told, action = get_u16(packet, ID), int(packet[ACTION])
    if told not in (driven.EVERYBODY, rob_id):
        return False
    if action == driven.TELL_WHEELS:
        return size == WHEELS_BYTES
    if action == driven.TELL_LED:
        return size == LED_BYTES
    if action == driven.TELL_ROUTE:
        return size >= ROUTE_BYTES and _is_route(packet, size)
    return size == 0 and action in (driven.TELL_NOTHING, driven.TELL_STOP, driven.TELL_GO)


@kernel
def _is_route(packet: Row, size: int) -> bool:
    count = whole(packet[COUNT])
    has_points = count <= WAYPOINTS_MAX and size == ROUTE_BYTES + POINT_BYTES * count
    return has_points and 1 <= get_u16(packet, THRESHOLD) <= THRESHOLD_MAX_MM


@kernel
def is_new_order(t_ms: int, packet: Row, state: Row, at: int) -> bool:
    """Return whether a signer's order is one that the robot has not heard and that nobody held back.

    A stop needs no number, so that none is too old to stop; but its signer must have said nothing since, nor since a
    go, whose number may be new though it is older than the stop that was heard.
    """
    number, said = get_u64(packet, NUMBER), get_u64(packet, SAID)
    if packet[ACTION] in (driven.TELL_STOP, driven.TELL_GO) and said <= get_u64(state, at + LATEST):
        return False
    if packet[ACTION] == driven.TELL_STOP:
        if number != 0:
            return False
    elif number <= get_u64(state, at + HIGHEST) or said < 0:
        return False
    return t_ms - said <= _least_ms(t_ms, state, at) + LATE_MS


@kernel
def is_signed(packet: Row, length: int, state: Row, at: int) -> bool:
    """Return whether it was said by whom the mission names."""
    return trusted.order_check(state[at : at + driven.SIGNER_KEY_BYTES], packet, length) == 0


@kernel
def learn(t_ms: int, packet: Row, state: Row, at: int) -> None:
    """Its signer said this; from now on that is old."""
    said = get_u64(packet, SAID)
    if t_ms - said < _least_ms(t_ms, state, at):
        put_u64(state, at + LEAST, t_ms - said)
        put_u64(state, at + LEARNT, t_ms)
    if packet[ACTION] != driven.TELL_STOP:
        put_u64(state, at + HIGHEST, get_u64(packet, NUMBER))
    put_u64(state, at + LATEST, max(said, get_u64(state, at + LATEST)))


@kernel
def _least_ms(t_ms: int, state: Row, at: int) -> int:
    since_ms = max(0, t_ms - get_u64(state, at + LEARNT))
    return int(get_u64(state, at + LEAST) + since_ms // DRIFT)


@kernel
def is_signer(state: Row, at: int) -> bool:
    """Return whether what is remembered of a signer can be; to be asked of every foreign checkpoint."""
    fine = get_u64(state, at + HIGHEST) >= 0 and get_u64(state, at + LATEST) >= 0 and get_u64(state, at + LEARNT) >= 0
    return fine and get_u64(state, at + LEAST) <= NEVER
