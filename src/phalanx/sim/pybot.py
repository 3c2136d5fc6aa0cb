"""Robots that run in Python inside the compiled loop: its events are handed to a CNode, whose actions go back."""

from __future__ import annotations

import numpy as np

from phalanx.robot.attacks import Attack
from phalanx.robot.cnode import EVERYBODY, Action, Actuate, CNode, Retry, Transmit, Verdict

from . import body, loop
from .events import push
from .radio import BROADCAST
from .world import World


def handle(world: World, robots: dict[int, CNode]) -> None:
    """The event at which the loop stopped has been handled by its robot's c-node, found by index in `robots`.

    Source: none.
    """
    clock = world.clock[0]
    i, kind = int(clock.robot), int(clock.kind)
    cnode = robots[i]
    now_ms = loop.clock_ms(world, i)
    perform(world, i, _actions(world, cnode, kind, now_ms))
    if kind == loop.WAKE and isinstance(cnode, Attack):
        wake(world, i, cnode)


def _actions(world: World, cnode: CNode, kind: int, now_ms: int) -> list[Action]:
    if kind == loop.CONTROL:
        return cnode.on_sensor(now_ms, world.reading[: world.frame_len[0]].tobytes())
    if kind == loop.MESSAGE:
        return cnode.on_message(now_ms, world.frame[: world.frame_len[0]].tobytes())
    if kind == loop.ROUND:
        return cnode.on_round(now_ms)
    if kind == loop.RETRY:
        return cnode.on_retry(now_ms)
    if kind == loop.SENT:
        return cnode.on_sent(now_ms, arrived=bool(world.clock[0].arrived))
    assert kind == loop.WAKE
    return cnode.on_wake(now_ms) if isinstance(cnode, Attack) and cnode.lies(now_ms) else []


def wake(world: World, i: int, attack: Attack) -> None:
    """The attack's next turn is among the events, if it has one. Source: none."""
    if not attack.period_ms:
        return
    now_us = int(world.clock[0].now_us)
    start_us = attack.plan.start_ms * 1000 - int(world.boot_us[i])
    push(world.queue, max(now_us + attack.period_ms * 1000, start_us), loop.WAKE, i, 0)


def perform(world: World, i: int, actions: list[Action]) -> None:
    """What the a-node let through happens. Source: none."""
    for action in actions:
        if isinstance(action, Transmit):
            frame = np.frombuffer(bytearray(action.frame), np.uint8)
            # An id that nobody has is a robot out of range.
            to = BROADCAST if action.to == EVERYBODY else action.to - 1 if action.to > 0 else len(world.pos)
            loop.transmit(world, i, frame, len(frame), to)
        elif isinstance(action, Actuate):
            command = np.frombuffer(bytearray(action.command), np.uint8)
            body.actuate(world, i, command, len(command))
        elif isinstance(action, Retry):
            if world.retry_us[i] < 0:
                world.retry_us[i] = action.at_ms * 1000 - int(world.boot_us[i])
                push(world.queue, int(world.retry_us[i]), loop.RETRY, i, 0)
        elif isinstance(action, Verdict):
            loop.judged(world, i, action.auditee, int(action.refusal))
