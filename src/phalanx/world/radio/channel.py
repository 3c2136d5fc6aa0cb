"""Shared radio channel: CSMA/CA with carrier sense inside a disc, hidden terminals, and losses by overlapping packets.

Every robot has a NIC with a short queue of packets, a back-off counter and its own random state. The event loop calls
`attempt` and `finish`; everything else is internal. docs/adr/0011 lists what is modelled.

Rules of this file. Carrier sense and reception consider only the robots in `Reach`. A NIC's next attempt only moves
to a later time, so one event per NIC suffices: an event that comes too early is put back. Random draws use the state
of the NIC concerned, so that no robot's draws depend on the order of the others.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import I32x1, I64x2, I64x3, Records, U8x3, layout
from phalanx.bundle import bundled
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.pool import Pool, borrow, give_back, make_pool
from phalanx.wire.airtime import Rates, ack_us, broadcast_us, rates_of, unicast_us
from phalanx.wire.fields import Row, copy, whole
from phalanx.world.audited.events import Queue, push

from . import nic as card
from .reach import Reach, in_range

# Kinds of events; a TX_END's arg is 0 for a packet, or 1 + the robot to which an acknowledgement goes.
ATTEMPT, TX_END = 1, 2

BROADCAST = -1
NOBODY = -1
SLOTS = 16
SHORT_BYTES = 64
AUDIT_BIT = 0x80

# Rows of `Air.counts[i]`: class of a packet, by its first byte and its destination.
APP_BROADCAST, APP_UNICAST, AUDIT_BROADCAST, AUDIT_UNICAST = 0, 1, 2, 3
# Columns: packets that were sent or given up, receptions due, and successful ones (all counted for the sender); packets
# received by this robot; bytes of packets sent (once per packet); airtime of all attempts; sum over receptions of µs
# since `enqueue`; packets dropped because the NIC was full.
SENT, DUE, ARRIVED, HEARD, BYTES, AIRTIME_US, DELAY_US, DROPPED = 0, 1, 2, 3, 4, 5, 6, 7


SLOT = layout(
    "since i8",  # time at which the packet was enqueued, µs
    "dst i4",  # robot or BROADCAST
    "length i4",  # bytes
)


class Air(NamedTuple):
    """The channel and the NICs of all robots; half a kB per robot."""

    nic: Annotated[Any, Records(card.NIC)]  # (N,)
    # Indexed by slot first: most rings hold one packet, so memory of the later slots is rarely touched.
    short: U8x3  # (SLOTS, N, SHORT_BYTES), packets of the ring
    long: Pool  # rows of long_bytes: at most one longer packet per ring
    slot: Annotated[Any, Records(SLOT, 2)]  # (SLOTS, N)
    counts: I64x3  # (N, 4, 8), rows APP_BROADCAST …, columns SENT …
    tried: I64x2  # (N, 4), bytes of all attempts, by class: an unacknowledged unicast packet is retried
    rates: Rates  # bits and durations of symbols
    half_exponents: int  # twice the exponent of the path loss
    capture: float  # ratio by which a broadcast must exceed the power of all overlapping packets
    data_capture: float  # the same for unicast packets and acknowledgements
    loss: float  # probability that a reception fails regardless of interference
    tries: int  # largest number of transmissions of a unicast packet


pack = bundled(Air)


class End(NamedTuple):
    """Outcome of a transmission or an acknowledgement."""

    receivers: int  # number of robots that received the packet now; their ids are in the caller's array
    left: int  # robot whose NIC has finished with the packet, or NOBODY
    arrived: int  # for `left`: 1, or 0 if a unicast packet was given up
    packet: Row  # its bytes, valid until the next call of `enqueue`


def make_air(robots: int, config: RadioConfig, seed: int) -> Air:
    """Return a silent channel; `seed`, ≥ 0, and a robot's number determine all its back-offs.

    Raises: UsageError: no robots, or a negative seed.
    """
    if robots < 1:
        raise UsageError(f"{robots} robots", "use at least 1")
    if seed < 0:
        raise UsageError(f"seed is {seed}", "use 0 or more")
    air = Air(
        nic=card.make_nics(robots, seed),
        short=np.zeros((SLOTS, robots, SHORT_BYTES), np.uint8),
        long=make_pool(robots, config.long_bytes),
        slot=np.zeros((SLOTS, robots), SLOT).view(np.recarray),
        counts=np.zeros((robots, 4, 8), np.int64),
        tried=np.zeros((robots, 4), np.int64),
        rates=rates_of(config),
        half_exponents=round(2 * config.exponent),
        capture=10 ** (config.capture_db / 10),
        data_capture=10 ** (config.data_capture_db / 10),
        loss=float(config.loss),
        tries=config.tries,
    )
    return pack(air)


def delivery(air: Air, kind: int) -> float:
    """Return the delivery ratio, 0 to 1, of APP_BROADCAST or another class; NaN if no reception was due."""
    due = int(air.counts[:, kind, DUE].sum())
    return int(air.counts[:, kind, ARRIVED].sum()) / due if due else float("nan")


@kernel
def enqueue(air: Air, queue: Queue, robot: int, packet: Row, length: int, dst: int, now_us: int) -> int:
    """Enqueue a copy of a packet in the robot's NIC. Returns: 0; -1: the NIC is full or off, or the length is invalid.

    `dst` is a robot, or BROADCAST. An unknown destination is treated as a robot out of range.
    """
    nic = air.nic[robot]
    is_long = length > SHORT_BYTES
    if (
        nic.off
        or length < 1
        or length > max(SHORT_BYTES, air.long.rows.shape[1])
        or nic.waiting == SLOTS
        or (is_long and nic.long_used)
    ):
        if length > 0:
            air.counts[robot, _class(int(packet[0]), dst), DROPPED] += 1
        return -1
    slot = (int(nic.head) + int(nic.waiting)) % SLOTS
    if is_long:
        nic.long_used, nic.long_row = 1, borrow(air.long)
    target = air.long.rows[nic.long_row] if is_long else air.short[slot, robot]
    copy(target, 0, packet, 0, length)
    taken = air.slot[slot, robot]
    taken.dst, taken.length, taken.since = dst, length, now_us
    nic.waiting += 1
    if nic.waiting == 1:
        if now_us < nic.busy_until and nic.slots == 0:
            nic.slots = card.draw(nic)
        _contend(nic, queue, robot, now_us)
    return 0


@kernel
def silence(air: Air, robot: int) -> None:
    """Turn the robot's radio off: drop its packets; it receives and acknowledges nothing, and is not waited for.

    A transmission in progress continues to its end.
    Source: RoboRebound §3.6 (Safe Mode).
    """
    nic = air.nic[robot]
    nic.off, nic.tries = 1, air.tries
    if nic.attempt_at != card.NEVER:  # no transmission in progress: drop all packets
        nic.attempt_at, nic.waiting = card.NEVER, 0
    nic.waiting = min(int(nic.waiting), 1)


@kernel
def attempt(air: Air, reach: Reach, queue: Queue, robot: int, now_us: int) -> None:
    """Handle an ATTEMPT: transmit the robot's next packet, or defer the attempt.

    Source: IEEE 802.11-2020 §10.23.2 (EDCA), as in ns-3; docs/adr/0011.
    """
    nic = air.nic[robot]
    nic.queued = 0
    if nic.attempt_at == card.NEVER:
        return
    if nic.attempt_at > now_us:
        nic.queued = 1
        push(queue, nic.attempt_at, ATTEMPT, robot, 0)
        return
    nic.attempt_at = card.NEVER
    slot = int(nic.head)
    length, dst = whole(air.slot[slot, robot].length), whole(air.slot[slot, robot].dst)
    if dst == BROADCAST:
        took_us, answer_us = broadcast_us(air.rates, length), 0
    else:
        took_us, answer_us = unicast_us(air.rates, length), card.SIFS_US + ack_us(air.rates)
    nic.tries += 1
    kind = _class(int(_bytes(air, robot, slot)[0]), dst)
    air.counts[robot, kind, AIRTIME_US] += took_us
    air.tried[robot, kind] += length
    _transmit(air, reach, queue, robot, now_us, now_us + took_us, answer_us, 0)


@kernel
def is_retry(air: Air, robot: int, now_us: int) -> bool:
    """Return whether an ATTEMPT at this time retransmits a packet."""
    nic = air.nic[robot]
    return bool(nic.tries > 0 and nic.attempt_at != card.NEVER and nic.attempt_at <= now_us)


@kernel
def next_packet(air: Air, robot: int) -> Row:
    """Return the packet that the robot transmits now or next."""
    nic = air.nic[robot]
    return _bytes(air, robot, int(nic.head))


@kernel
def give_up(air: Air, queue: Queue, robot: int, now_us: int) -> End:
    """Drop the packet that is waiting for a retry."""
    nic = air.nic[robot]
    nic.queued, nic.attempt_at = 0, card.NEVER
    arrived = 1 if nic.delivered else 0
    packet = _bytes(air, robot, int(nic.head))
    return End(0, _done(air, queue, robot, now_us), arrived, packet)


@kernel
def finish(air: Air, reach: Reach, queue: Queue, robot: int, arg: int, now_us: int, receivers: I32x1) -> End:
    """Handle a TX_END: decide which robots received the packet, and whether the NIC has finished with it.

    `receivers`, (≥ N,), is filled with the indices of the receivers; `robot` and `arg` are those of the event.
    Source: IEEE 802.11-2020 §10.23.2, as in ns-3; docs/adr/0011.
    """
    if arg > 0:
        return _finish_ack(air, queue, robot, arg - 1, now_us)
    nic = air.nic[robot]
    slot = int(nic.head)
    dst = whole(air.slot[slot, robot].dst)
    packet = _bytes(air, robot, slot)
    count = 0
    if dst == BROADCAST:
        end = in_range(reach, robot)
        for at in range(reach.near[robot], end):
            other = int(reach.ids[at])
            if card.received(air.nic[other], robot, now_us, air.capture, air.loss):
                receivers[count] = other
                count += 1
        _account(air, robot, slot, receivers, count, now_us)
        return End(count, _done(air, queue, robot, now_us), 1, packet)
    if not (0 <= dst < len(air.nic) and card.received(air.nic[dst], robot, now_us, air.data_capture, air.loss)):
        arrived = 1 if nic.delivered else 0
        return End(0, _retry(air, queue, robot, now_us), arrived, packet)
    if not nic.delivered:
        nic.delivered = 1
        receivers[0] = dst
        count = 1
        _account(air, robot, slot, receivers, count, now_us)
    # The gap before the acknowledgement counts as part of it: robots that received the packet cannot start there.
    _transmit(air, reach, queue, dst, now_us, now_us + card.SIFS_US + ack_us(air.rates), 0, 1 + robot)
    return End(count, NOBODY, 0, packet)


@kernel
def _finish_ack(air: Air, queue: Queue, robot: int, sender: int, now_us: int) -> End:
    nic = air.nic[sender]
    packet = _bytes(air, sender, int(nic.head))
    if card.received(nic, robot, now_us, air.data_capture, air.loss):
        return End(0, _done(air, queue, sender, now_us), 1, packet)
    return End(0, _retry(air, queue, sender, now_us), 1, packet)


@kernel
def _retry(air: Air, queue: Queue, robot: int, now_us: int) -> int:
    nic = air.nic[robot]
    if nic.tries >= air.tries:
        return _done(air, queue, robot, now_us)
    nic.window = min(2 * int(nic.window) + 1, card.WINDOW_MAX)
    nic.slots = card.draw(nic)
    _contend(nic, queue, robot, now_us)
    return NOBODY


@kernel
def _done(air: Air, queue: Queue, robot: int, now_us: int) -> int:
    nic = air.nic[robot]
    slot = int(nic.head)
    sent = air.slot[slot, robot]
    counts = air.counts[robot, _class(int(_bytes(air, robot, slot)[0]), int(sent.dst))]
    counts[SENT] += 1
    counts[BYTES] += int(sent.length)
    counts[DUE] += int(nic.due) if sent.dst == BROADCAST else 1
    if sent.length > SHORT_BYTES:
        nic.long_used = 0
        give_back(air.long, int(nic.long_row))
    nic.waiting -= 1
    nic.head = (slot + 1) % SLOTS if nic.waiting else 0  # restart an empty ring at slot 0, whose memory is cached
    nic.tries, nic.delivered, nic.window = 0, 0, card.WINDOW_MIN
    nic.slots = card.draw(nic)  # even with an empty queue: consecutive packets need a back-off
    if nic.waiting:
        _contend(nic, queue, robot, now_us)
    return robot


@kernel
def _transmit(
    air: Air, reach: Reach, queue: Queue, robot: int, now_us: int, end_us: int, answer_us: int, arg: int
) -> None:
    """Transmit from now to end_us; robots in range defer until then, or until the end of the answer."""
    nic = air.nic[robot]
    card.hold(nic, now_us, end_us + answer_us)
    nic.own_until = end_us
    nic.hears, nic.hears_until = NOBODY, now_us
    due = 0
    end = in_range(reach, robot)
    for at in range(reach.near[robot], end):
        other = air.nic[reach.ids[at]]
        if other.off:
            continue
        due += 1
        level = card.strength(float(reach.square[at]), air.half_exponents)
        heard = card.listen(other, robot, level, air.capture, now_us, end_us)
        # Only robots that decode the packet know that an answer follows.
        card.hold(other, now_us, end_us + answer_us if heard else end_us)
    nic.due = due
    push(queue, end_us, TX_END, robot, arg)


@kernel
def _contend(nic: card.Nic, queue: Queue, robot: int, now_us: int) -> None:
    """Schedule the NIC's attempt at the end of its back-off, at the next slot boundary."""
    idle_from = nic.busy_until + card.AIFS_US
    begun = (now_us - idle_from) // card.SLOT_US + 1 if now_us > idle_from else 0
    nic.attempt_at = idle_from + card.SLOT_US * max(int(nic.slots), begun)
    if not nic.queued:
        nic.queued = 1
        push(queue, nic.attempt_at, ATTEMPT, robot, 0)


@kernel
def _class(first_byte: int, dst: int) -> int:
    return (AUDIT_BROADCAST if first_byte & AUDIT_BIT else APP_BROADCAST) + (dst != BROADCAST)


@kernel
def _bytes(air: Air, robot: int, slot: int) -> Row:
    length = whole(air.slot[slot, robot].length)
    if length > SHORT_BYTES:
        return air.long.rows[air.nic[robot].long_row, :length]
    return air.short[slot, robot, :length]


@kernel
def _account(air: Air, robot: int, slot: int, receivers: I32x1, count: int, now_us: int) -> None:
    sent = air.slot[slot, robot]
    row = _class(int(_bytes(air, robot, slot)[0]), int(sent.dst))
    air.counts[robot, row, ARRIVED] += count
    air.counts[robot, row, DELAY_US] += count * (now_us - sent.since)
    for at in range(count):
        air.counts[receivers[at], row, HEARD] += 1
