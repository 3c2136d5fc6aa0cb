"""The world goes on: events in the order of microseconds, each handled by one stage.

sense → control → actuate → broadcast → deliver → audit → enforce → move

A robot that runs in Python stops the loop when it has an event: whoever called handles it (`pybot`) and calls again.
Source: docs/spec/rebound.md, RoboRebound §3, §4 (the simulation).
"""

from __future__ import annotations

from phalanx.bti import request, rounds, trusted
from phalanx.bti.audit import ACMD, INPUT, OUTPUT_HEAD_BYTES, OUTPUT_LENGTH, SEND
from phalanx.bti.log import ENTRY_HEAD_BYTES
from phalanx.kernel import kernel
from phalanx.robot import node
from phalanx.sim.radio import channel as radio
from phalanx.sim.radio.channel import ATTEMPT, BROADCAST, NOBODY, TX_END
from phalanx.sim.radio.reach import rebuild
from phalanx.wire.fields import Row, copy, get_u16

from . import body
from .ahead import prefetch_event, prefetch_receiver
from .events import CONTROL, MESSAGE, next_us, peek, pop, push
from .motion import obstacle_contacts, robot_contacts
from .world import PYTHON, VERDICTS, World, clock_ms

# Kinds of events beside CONTROL, MESSAGE and the radio's ATTEMPT and TX_END.
ROUND, RETRY, CHECK, MOVE, WAKE = 11, 12, 13, 14, 15
# What only Python sees: its last fragment is gone.
SENT = 17
REACHED, FOR_PYTHON = 0, 1
# A ROUND's arg: the robot has listened before it.
LISTENED = 1


@kernel
def run(world: World, until_us: int) -> int:  # noqa: C901, PLR0912 - the pipeline, in one place
    """The world at `until_us`, or at the first event that a robot in Python has to handle.

    Returns: REACHED or FOR_PYTHON; then `clock.kind`, `clock.robot`, `clock.arrived` and `frame` tell the event.
    Source: docs/spec/world.md.
    """
    clock = world.clock[0]
    for profile in (trusted.BOUND, trusted.PAPER):
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
            if frame_left(world, i, clock.arrived):
                return FOR_PYTHON
        if next_us(world.queue) > until_us:
            clock.now_us = until_us
            return REACHED
        now_us, kind, i, arg = pop(world.queue)
        clock.now_us = now_us
        prefetch_event(world, peek(world.queue))
        if kind == ATTEMPT:
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
            if kind == ROUND:
                if arg != LISTENED:
                    push(world.queue, now_us + clock.audit_us, ROUND, i, 0)
                    listens_us = 1000 * request.listens(world.fleet, i, clock_ms(world, i), world.work.small[1])
                    if listens_us > 0:
                        push(world.queue, now_us + listens_us, ROUND, i, LISTENED)
                        continue
            elif kind == RETRY:
                world.retry_us[i] = -1
            if world.runs[i] == PYTHON:
                clock.kind = kind
                clock.robot = i
                return FOR_PYTHON
            audit_timer(world, i, kind)


# --- sense, control, actuate, broadcast ---


@kernel
def control(world: World, i: int) -> int:
    """The robot's sensors are read and its controller acts on them. Returns: whether Python has to. Source: Alg. 1."""
    body.advance(world, i)
    if world.safe[i]:
        return 0
    now = clock_ms(world, i)
    length = body.sensed(world, i, int(world.fleet.robot[i].id), now)
    if world.runs[i] == PYTHON:
        world.clock[0].kind = CONTROL
        world.clock[0].robot = i
        world.frame_len[0] = length
        return 1
    n = node.take(world.fleet, i, world.work, INPUT, now, world.reading, length)
    if n <= 0:
        return 0
    length = node.think(world.fleet, i, world.work, n)
    out = world.work.out
    at = 0
    while at < length:
        kind, size = int(out[at]), get_u16(out, at + OUTPUT_LENGTH)
        at += OUTPUT_HEAD_BYTES
        payload = out[at : at + size]
        n = node.take(world.fleet, i, world.work, kind, now, payload, size)
        if n > 0 and kind == ACMD:
            body.actuate(world, i, payload, size)
        elif n > 0:
            transmit(world, i, world.work.entry[ENTRY_HEAD_BYTES:n], n - ENTRY_HEAD_BYTES, BROADCAST)
        at += size
    return 0


@kernel
def transmit(world: World, i: int, frame: Row, length: int, to: int) -> int:
    """The frame is in the robot's radio, for `to` (a robot's index) or BROADCAST; -1 if it is full."""
    return radio.enqueue(world.air, world.queue, i, frame, length, to, world.clock[0].now_us)


# --- deliver ---


@kernel
def transmitted(world: World, i: int, arg: int) -> None:
    """A transmission is over: its receivers are noted, and who may send the next frame."""
    clock = world.clock[0]
    end = radio.finish(world.air, world.reach, world.queue, i, arg, clock.now_us, world.receivers)
    clock.next = 0
    clock.receivers = end.receivers
    clock.sender = end.left
    clock.arrived = end.arrived
    n = len(end.frame)
    copy(world.frame, 0, end.frame, 0, n)
    world.frame_len[0] = n
    for k in range(min(2, end.receivers)):
        prefetch_receiver(world, int(world.receivers[k]))


@kernel
def deliver(world: World, j: int) -> int:
    """The frame has arrived at robot j. Returns: whether Python has to take it. Source: RoboRebound Alg. 4."""
    if j >= len(world.fleet.robot) or world.safe[j]:
        return 0
    if world.runs[j] == PYTHON:
        world.clock[0].kind = MESSAGE
        world.clock[0].robot = j
        return 1
    now = clock_ms(world, j)
    told = node.hear(world.fleet, j, world.work, now, world.frame, world.frame_len[0])
    t = world.work.told
    if told == node.REPLY:
        judged(world, j, t[node.TOLD_TEE], t[node.TOLD_REFUSAL])
    if told == node.HELLO or (told == node.REPLY and t[node.TOLD_REFUSAL] == 0):
        pass_on(world, j, now, t[node.TOLD_LENGTH], t[node.TOLD_TO] - 1)
    return 0


@kernel
def frame_left(world: World, i: int, arrived: int) -> int:
    """A robot's radio is done with a frame; if it was a fragment the next may follow. Source: RoboRebound §5.2."""
    is_fragment = int(world.frame[0]) & request.AUDIT != 0 and world.frame[request.AT_SUB] == request.FRAGMENT
    if not is_fragment or i >= len(world.fleet.robot) or world.safe[i]:
        return 0
    if world.runs[i] == PYTHON:
        world.clock[0].kind = SENT
        world.clock[0].robot = i
        return 1
    if arrived == 0:
        request.not_arrived(world.fleet, i, clock_ms(world, i))
    pump(world, i)
    return 0


# --- audit ---


@kernel
def judged(world: World, auditor: int, auditee_id: int, refusal: int) -> None:
    """A verdict is kept for whoever watches."""
    clock = world.clock[0]
    row = world.verdicts[clock.verdicts % VERDICTS]
    row[0], row[1], row[2], row[3] = clock.now_us, int(world.fleet.robot[auditor].id), auditee_id, refusal
    clock.verdicts += 1


@kernel
def audit_timer(world: World, i: int, kind: int) -> None:
    """A round begins, or more auditors are asked. Source: RoboRebound §3.7."""
    f, now = world.fleet, clock_ms(world, i)
    if kind == ROUND:
        rounds.begin_round(f, i)
        n = request.hello(f, i, now, world.work.frame)
    elif rounds.retry(f, i) > 0:
        n = request.seek(f, i, now, world.work.frame)
    else:
        return
    if n > 0:
        pass_on(world, i, now, n, BROADCAST)
    pump(world, i)


@kernel
def pump(world: World, i: int) -> None:
    """The next fragment of an audit request is in the radio, if there is one and there is room."""
    f, clock = world.fleet, world.clock[0]
    if world.air.nic[i].long_used:
        return
    now = clock_ms(world, i)
    n = node.next_frame(f, i, world.work, now)
    if n > 0:
        if pass_on(world, i, now, n, world.work.told[node.TOLD_TO] - 1) < 0:
            rounds.withdraw(f, i)
            f.robot[i].quota = 0
        return
    at_ms = rounds.next_retry(f, i, now)
    at_us = clock.now_us + (at_ms - now) * 1000
    # One that is due before the one that waits gets an event of its own; the later one comes all the same.
    if at_ms >= 0 and (world.retry_us[i] < 0 or at_us < world.retry_us[i]):
        world.retry_us[i] = at_us
        push(world.queue, at_us, RETRY, i, 0)


@kernel
def pass_on(world: World, i: int, now: int, length: int, to: int) -> int:
    """The AUDIT frame in `work.frame` through the a-node into the radio; -1 if one of them refuses. Source: Alg. 4."""
    n = node.take(world.fleet, i, world.work, SEND, now, world.work.frame, length)
    if n <= 0:
        return -1
    return transmit(world, i, world.work.entry[ENTRY_HEAD_BYTES:n], n - ENTRY_HEAD_BYTES, to)


# --- enforce, move ---


@kernel
def enforce(world: World) -> None:
    """Each a-node has checked its tokens; those without enough of them have stopped their robot. Source: Alg. 4."""
    f = world.fleet
    for i in range(len(f.robot)):
        if world.safe[i] == 0 and trusted.anode_check(f.settings[0].profile, f.anode[i], clock_ms(world, i)) != 0:
            stop(world, i)


@kernel
def stop(world: World, i: int) -> None:
    """The robot is in Safe Mode: it stands where it is, and its radio is silent. Source: RoboRebound §3.1."""
    now_us = world.clock[0].now_us
    body.halt(world, i)
    world.safe[i] = 1
    world.safe_us[i] = now_us
    world.fleet.robot[i].alive = 0
    radio.silence(world.air, i)


@kernel
def move(world: World) -> None:
    """Everybody is where physics puts them now, and who hears whom is known again. Source: docs/spec/world.md."""
    clock = world.clock[0]
    for i in range(len(world.fleet.robot)):
        body.advance(world, i)
    if rebuild(world.reach, world.pos) > len(world.reach.maybe):
        clock.crowded = 1
    clock.contacts += robot_contacts(world.pos, world.last, world.reach, clock.contact_m)
    clock.contacts += obstacle_contacts(world.pos, world.last, world.discs, world.boxes, clock.contact_m)
    for i in range(len(world.pos)):
        world.last[i, 0], world.last[i, 1] = world.pos[i, 0], world.pos[i, 1]
