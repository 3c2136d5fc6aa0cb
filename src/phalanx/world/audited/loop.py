"""Main loop of the simulator: take events in the order of time, and handle each in one stage.

sense → control → actuate → broadcast → deliver → audit → enforce → move

The loop returns when a robot that runs in Python has an event. The caller handles it (`pybot.handle`) and continues.
Source: docs/spec/rebound.md, RoboRebound §3, §4 (the simulation).
"""

from __future__ import annotations

from phalanx.bti import request, trusted
from phalanx.bti.fleet import PLAIN
from phalanx.kernel import kernel
from phalanx.robot import actions, handlers
from phalanx.wire.fields import Row, copy, get_u16
from phalanx.world.radio import channel as radio
from phalanx.world.radio.channel import ATTEMPT, BROADCAST, NOBODY, TX_END
from phalanx.world.radio.reach import rebuild

from . import body
from .events import CONTROL, MESSAGE, next_us, peek, pop, push
from .world import (
    COMPILED,
    PYTHON,
    VERDICTS,
    World,
    clock_ms,
    prefetch_event,
    prefetch_log,
    prefetch_receiver,
)

# Kinds of events besides CONTROL, MESSAGE and the radio's ATTEMPT and TX_END.
ROUND, RETRY, CHECK, MOVE, WAKE = 11, 12, 13, 14, 15
# Event for robots in Python only: the radio has sent the last fragment, or given it up.
SENT = 17
REACHED, FOR_PYTHON = 0, 1


@kernel
def run(world: World, until_us: int) -> int:  # noqa: C901, PLR0912 - the pipeline, in one place
    """Advance the world to `until_us`, or to the first event that a robot in Python has to handle.

    Returns: REACHED; FOR_PYTHON: the event is in `clock.kind`, `clock.robot`, `clock.arg` and `packet`.
    Source: docs/spec/world.md.
    """
    clock = world.clock[0]
    for profile in (trusted.HARDENED, trusted.PAPER):
        trusted.host_use(profile, 1 - int(world.fleet.settings[0].plain))
    while True:
        while clock.next < clock.receivers:
            j = int(world.receivers[clock.next])
            clock.next += 1
            if clock.next + 1 < clock.receivers:  # two ahead: memory is slower than one delivery
                prefetch_receiver(world, int(world.receivers[clock.next + 1]))
            if deliver(world, j):
                return FOR_PYTHON
        if clock.sender != NOBODY:
            i = clock.sender
            clock.sender = NOBODY
            if packet_left(world, i, clock.arrived):
                return FOR_PYTHON
        if next_us(world.queue) > until_us:
            clock.now_us = until_us
            return REACHED
        now_us, kind, i, arg = pop(world.queue)
        clock.now_us = now_us
        prefetch_event(world, peek(world.queue))
        if kind == ATTEMPT:
            if is_refused(world, i):
                ended(world, radio.give_up(world.air, world.queue, i, now_us))
            else:
                radio.attempt(world.air, world.reach, world.queue, i, now_us)
        elif kind == TX_END:
            transmitted(world, i, arg)
        elif kind == CONTROL:
            push(world.queue, now_us + clock.control_us, CONTROL, i, 0)
            if control(world, i):
                return FOR_PYTHON
        elif kind == CHECK:
            push(world.queue, now_us + clock.check_us, CHECK, 0, 0)
            enforce(world)
        elif kind == MOVE:
            push(world.queue, now_us + clock.move_us, MOVE, 0, 0)
            move(world)
        elif world.safe[i] == 0:
            if kind == RETRY:
                if world.retry_us[i] != now_us:  # replaced by an earlier retry
                    continue
                world.retry_us[i] = -1
            if world.runs[i] != COMPILED:
                return for_python(world, kind, i, arg)
            now, busy = clock_ms(world, i), int(world.air.nic[i].long_used)
            if kind == ROUND:
                handlers.on_round(world.fleet, i, world.work, now, arg, busy)
            else:
                handlers.on_retry(world.fleet, i, world.work, now, busy)
            carry_out(world, i, now)


@kernel
def for_python(world: World, kind: int, i: int, arg: int) -> int:
    """Store an event of a robot in Python for the caller of `run`. Returns: FOR_PYTHON."""
    clock = world.clock[0]
    clock.kind, clock.robot, clock.arg = kind, i, arg
    return FOR_PYTHON


# --- a robot's events ---


@kernel
def control(world: World, i: int) -> int:
    """Read a robot's sensors, and handle the reading. Returns: FOR_PYTHON if Python must handle it. Source: Alg. 1."""
    body.advance(world, i)
    if world.safe[i]:
        return 0
    prefetch_log(world, i)
    now = clock_ms(world, i)
    length = body.sensed(world, i, int(world.fleet.robot[i].id), now)
    if world.runs[i] != COMPILED:
        world.packet_len[0] = length
        return for_python(world, CONTROL, i, 0)
    handlers.on_reading(world.fleet, i, world.work, now, world.reading, length)
    carry_out(world, i, now)
    return 0


@kernel
def is_refused(world: World, i: int) -> bool:
    """Return whether robot i's radio retries a packet that exceeds its a-node's airtime limit.

    An a-node counts every attempt. Otherwise unicasts to absent robots would use seven times the airtime of a bucket,
    which caused correct robots to be stopped (docs/adr/0039).
    """
    if not radio.is_retry(world.air, i, world.clock[0].now_us) or i >= len(world.fleet.robot):
        return False
    profile, packet = world.fleet.settings[0].profile, radio.next_packet(world.air, i)
    if profile != trusted.HARDENED or not request.is_audit(packet, len(packet)):
        return False
    return (
        trusted.anode_send(profile, world.fleet.anode[i], clock_ms(world, i), packet, len(packet), world.work.entry) < 0
    )


@kernel
def transmitted(world: World, i: int, arg: int) -> None:
    """End a transmission."""
    end = radio.finish(world.air, world.reach, world.queue, i, arg, world.clock[0].now_us, world.receivers)
    ended(world, end)


@kernel
def ended(world: World, end: radio.End) -> None:
    """Store the receivers of a transmission, and its sender if its radio has room again."""
    clock = world.clock[0]
    clock.next = 0
    clock.receivers = end.receivers
    clock.sender = end.left
    clock.arrived = end.arrived
    n = len(end.packet)
    copy(world.packet, 0, end.packet, 0, n)
    world.packet_len[0] = n
    for k in range(min(2, end.receivers)):
        prefetch_receiver(world, int(world.receivers[k]))


@kernel
def deliver(world: World, j: int) -> int:
    """Deliver the packet to robot j. Returns: FOR_PYTHON if Python must handle it. Source: RoboRebound Alg. 4."""
    if j >= len(world.fleet.robot) or world.safe[j]:
        return 0
    if world.runs[j] != COMPILED:
        return for_python(world, MESSAGE, j, 0)
    prefetch_log(world, j)
    now = clock_ms(world, j)
    handlers.on_packet(world.fleet, j, world.work, now, world.packet, world.packet_len[0])
    if world.work.used[actions.COUNT] > 0:  # rare, in the loop's most frequent event
        carry_out(world, j, now)
    return 0


@kernel
def packet_left(world: World, i: int, arrived: int) -> int:
    """Handle the end of a fragment's transmission by robot i: the next may follow. Source: RoboRebound §5.2."""
    if not request.is_fragment(world.packet, world.packet_len[0]) or i >= len(world.fleet.robot) or world.safe[i]:
        return 0
    if world.runs[i] != COMPILED:
        return for_python(world, SENT, i, arrived)
    now = clock_ms(world, i)
    handlers.on_sent(world.fleet, i, world.work, now, arrived, int(world.air.nic[i].long_used))
    carry_out(world, i, now)
    return 0


# --- a robot's actions ---


@kernel
def carry_out(world: World, i: int, now: int) -> None:
    """Carry out the actions of robot i's event at time `now` of its clock."""
    w, clock = world.work, world.clock[0]
    for k in range(w.used[actions.COUNT]):
        action = w.actions[k]
        if action.kind == actions.TRANSMIT:
            packet = w.sent[action.begin : action.begin + action.length]
            left = transmit(world, i, packet, action.length, _addressed(world, packet, action.number))
            if left < 0 and request.is_fragment(packet, action.length):
                retry_at(world, i, now, request.postpone(world.fleet, i, now))
        elif action.kind == actions.ACTUATE:
            body.actuate(world, i, w.sent[action.begin : action.begin + action.length], action.length)
        elif action.kind == actions.ROUND_AT:
            push(world.queue, clock.now_us + (action.number - now) * 1000, ROUND, i, action.more)
        elif action.kind == actions.RETRY_AT:
            retry_at(world, i, now, action.number)
        else:
            store_verdict(world, i, action.number, action.more)


@kernel
def retry_at(world: World, i: int, now: int, at_ms: int) -> None:
    """Enqueue a retry of robot i at `at_ms` of its clock, unless an earlier one is enqueued."""
    at_us = _retry_us(world, i, now, at_ms)
    if world.retry_us[i] < 0 or at_us < world.retry_us[i]:
        world.retry_us[i] = at_us
        push(world.queue, at_us, RETRY, i, 0)


@kernel
def _addressed(world: World, packet: Row, to: int) -> int:
    """Return the index of a packet's receiver, or BROADCAST; an a-node trusts only the address in the packet."""
    if world.fleet.settings[0].profile != PLAIN:
        to = get_u16(packet, request.AT_DST) if request.is_audit(packet, len(packet)) else 0
    if to <= 0:
        return BROADCAST
    # An unknown id is treated as a robot out of range.
    return to - 1


@kernel
def _retry_us(world: World, i: int, now: int, at_ms: int) -> int:
    """Return the time of a retry, µs; robots in Python use whole milliseconds of their clock."""
    now_us = world.clock[0].now_us
    if world.runs[i] == PYTHON:
        return int(max(at_ms * 1000 - world.boot_us[i], now_us))
    return int(now_us + (at_ms - now) * 1000)


@kernel
def transmit(world: World, i: int, packet: Row, length: int, to: int) -> int:
    """Enqueue a packet in robot i's radio, for the robot with index `to` or BROADCAST. Returns: -1 if it is full."""
    return radio.enqueue(world.air, world.queue, i, packet, length, to, world.clock[0].now_us)


@kernel
def store_verdict(world: World, auditor: int, auditee_id: int, refusal: int) -> None:
    """Store a verdict in the ring that `VerdictReader` reads."""
    clock = world.clock[0]
    row = world.verdicts[clock.verdicts % VERDICTS]
    row[0], row[1], row[2], row[3] = clock.now_us, int(world.fleet.robot[auditor].id), auditee_id, refusal
    clock.verdicts += 1


# --- enforce, move ---


@kernel
def enforce(world: World) -> None:
    """Check all a-nodes' tokens, and stop the robots that lack some. Source: RoboRebound Alg. 4."""
    f = world.fleet
    for i in range(len(f.robot)):
        if world.safe[i] == 0 and trusted.anode_check(f.settings[0].profile, f.anode[i], clock_ms(world, i)) != 0:
            stop(world, i)


@kernel
def stop(world: World, i: int) -> None:
    """Put robot i into Safe Mode: stop its motion and its radio. Source: RoboRebound §3.1."""
    now_us = world.clock[0].now_us
    body.halt(world, i)
    world.safe[i] = 1
    world.safe_us[i] = now_us
    world.fleet.robot[i].alive = 0
    radio.silence(world.air, i)


@kernel
def move(world: World) -> None:
    """Move all bodies to the current time, update the neighbour lists, count contacts. Source: docs/spec/world.md."""
    clock = world.clock[0]
    for i in range(len(world.fleet.robot)):
        body.advance(world, i)
    if rebuild(world.reach, world.pos) > len(world.reach.candidate_ids):
        clock.crowded = 1
    clock.contacts += body.robot_contacts(world.pos, world.last, world.reach, clock.contact_m)
    clock.contacts += body.obstacle_contacts(world.pos, world.last, world.discs, world.boxes, clock.contact_m)
    for i in range(len(world.pos)):
        world.last[i, 0], world.last[i, 1] = world.pos[i, 0], world.pos[i, 1]
