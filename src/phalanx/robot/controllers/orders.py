"""Validation of orders: a valid order is for this robot and mission, new, in time, and signed by a key of the mission.

The signature is verified last, and at most WheelsConfig.looks times per control period, so that compromised robots
cannot make others compute all day. Clocks need not agree: each order bounds the offset between the robot's clock and
the signer's. An order more than LATE_MS later than the smallest offset was delayed by an attacker. The smallest offset
may grow by a part in DRIFT. Auditors get the same results from log and state. `at` is the offset of a signer's record
in the state. Source: docs/spec/orders.md; ADR 0031.
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
# Largest drift between two clocks, as a divisor: 500 ppm.
DRIFT = 2000
# Larger than any clock: offset of a signer without orders so far.
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
    to, action = get_u16(packet, ID), int(packet[ACTION])
    if to not in (driven.EVERYBODY, rob_id):
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
    """Return whether an order is newer than the signer's previous ones, and was not delayed by an attacker.

    A stop has no number, so that a lost order does not invalidate it; but it must be the newest order of its signer.
    The same holds for a go, whose number may be new although it is older than a stop that the robot has obeyed.
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
    """Return whether the order is signed by the signer's key."""
    return trusted.order_check(state[at : at + driven.SIGNER_KEY_BYTES], packet, length) == 0


@kernel
def learn(t_ms: int, packet: Row, state: Row, at: int) -> None:
    """Store number, time and clock offset of a valid order, so that it and older ones are no longer accepted."""
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
    """Return whether a signer's record is valid; call it for each checkpoint of others."""
    fine = get_u64(state, at + HIGHEST) >= 0 and get_u64(state, at + LATEST) >= 0 and get_u64(state, at + LEARNT) >= 0
    return fine and get_u64(state, at + LEAST) <= NEVER
