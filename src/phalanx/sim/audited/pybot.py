"""Robots that run in Python inside the compiled loop: its events are handed to a CNode, whose actions go back."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Final, Protocol

from phalanx.bti import request, rounds
from phalanx.bti.fleet import PLAIN
from phalanx.robot.attacks.liar import Liar
from phalanx.robot.cnode import EVERYBODY, Action, Actuate, CNode, Retry, Transmit, Verdict
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.robot.planner import Planner, advice_of, overheard
from phalanx.sim.radio.channel import BROADCAST
from phalanx.wire.fields import get_u16, row

from . import body, loop
from .events import CONTROL, MESSAGE, push
from .world import CLOCK, World

# What hears of each kind of event.
METHODS = {
    CONTROL: "on_sensor",
    MESSAGE: "on_message",
    loop.ROUND: "on_round",
    loop.RETRY: "on_retry",
    loop.SENT: "on_sent",
    loop.WAKE: "on_wake",
}


class Looks(Protocol):
    """What sensors see beside the robot itself: a protocol's stage, or a lidar and bumpers."""

    def look(self, rob_id: int, t_s: float, place_m: tuple[float, float], *, lies: bool) -> bytes:
        """A robot is there, and its sensors are read; what they say behind its own motion."""
        ...


NO_PLANNERS: Mapping[int, Planner] = {}
# What an event says. A record of numpy takes 5 us for a field, and all of them as a tuple 1.
_EVENT: Final = itemgetter(*map(list(CLOCK.names or ()).index, ("robot", "kind", "now_us", "body", "arrived")))


def handle(
    world: World,
    robots: dict[int, CNode],
    planners: Mapping[int, Planner] = NO_PLANNERS,
    stage: Looks | None = None,
) -> None:
    """The event at which the loop stopped has been handled by its robot's c-node, found by index in `robots`.

    `planners` advise some of them; on a `stage` their sensors see more than themselves.
    """
    i, kind, now_us, driven, arrived = _EVENT(world.clock.item())
    cnode = robots[i]
    now_ms = (now_us + int(world.boot_us[i])) // 1000
    if i in planners:
        _plan(world, cnode, planners[i], kind, now_ms)
    seen = _look(world, cnode, stage, now_us, now_ms) if stage and kind == CONTROL else b""
    actions = cnode.checked(METHODS[kind], _actions(world, cnode, kind, now_ms, seen, arrived=bool(arrived)))
    if cnode.is_own:
        _check_commands(driven, cnode, actions)
    perform(world, cnode, actions, now_us)
    if kind == loop.WAKE and isinstance(cnode, Liar):
        wake(world, cnode, now_us)


def _look(world: World, cnode: CNode, stage: Looks, now_us: int, now_ms: int) -> bytes:
    x_m, y_m = world.pos[cnode.i].tolist()
    lies = isinstance(cnode, Liar) and cnode.lies(now_ms)
    return stage.look(cnode.id, now_us / 1e6, (x_m, y_m), lies=lies)


def _plan(world: World, cnode: CNode, planner: Planner, kind: int, now_ms: int) -> None:
    if kind == MESSAGE:
        overheard(planner, now_ms, world.frame[: world.frame_len[0]].tobytes())
    elif kind == CONTROL:
        advice = advice_of(planner, now_ms, world.reading[: world.frame_len[0]].tobytes())
        if advice:
            cnode.on_advice(advice)


def _check_commands(driven: int, cnode: CNode, actions: list[Action]) -> None:
    # The body would do nothing, and the audits, which ask whether it is what the controller said, find nothing wrong.
    known = body.COMMANDS[driven]
    for action in actions:
        if isinstance(action, Actuate) and (len(action.command), action.command[0]) != (known.size, known.tag):
            raise OwnMistake(
                f"robot {cnode.id}: no command of its body's: "
                f"{len(action.command)} bytes, the first {action.command[0]}",
                f"{known.size} bytes, the first {known.tag}: docs/own-controller.md has the layout",
                cnode.controller,
            )


def _actions(world: World, cnode: CNode, kind: int, now_ms: int, seen: bytes, *, arrived: bool) -> list[Action]:
    if kind == CONTROL:
        return cnode.on_sensor(now_ms, world.reading[: world.frame_len[0]].tobytes() + seen)
    if kind == MESSAGE:
        return cnode.on_message(now_ms, world.frame[: world.frame_len[0]].tobytes())
    if kind == loop.ROUND:
        return cnode.on_round(now_ms)
    if kind == loop.RETRY:
        return cnode.on_retry(now_ms)
    if kind == loop.SENT:
        return cnode.on_sent(now_ms, arrived=arrived)
    assert kind == loop.WAKE
    return cnode.on_wake(now_ms) if isinstance(cnode, Liar) and cnode.lies(now_ms) else []


def wake(world: World, liar: Liar, now_us: int) -> None:
    """The liar's next turn is among the events, if it has one."""
    if not liar.period_ms:
        return
    start_us = liar.plan.start_ms * 1000 - int(world.boot_us[liar.i])
    push(world.queue, max(now_us + liar.period_ms * 1000, start_us), loop.WAKE, liar.i, 0)


def _addressed(cnode: CNode, action: Transmit) -> int:
    """Whom the frame goes to: with an a-node, which hands it to the radio, what the frame itself says, or everybody."""
    if cnode.profile == PLAIN:
        return action.to
    dst = int(get_u16(row(action.frame), request.AT_DST)) if action.frame[0] & request.AUDIT else 0
    return dst or EVERYBODY


def perform(world: World, cnode: CNode, actions: list[Action], now_us: int) -> None:
    """What the a-node let through happens."""
    i = cnode.i
    for action in actions:
        if isinstance(action, Transmit):
            frame = row(action.frame)
            to = _addressed(cnode, action)
            # An id that nobody has is a robot out of range.
            to = BROADCAST if to == EVERYBODY else to - 1 if to > 0 else len(world.pos)
            lost = loop.transmit(world, i, frame, len(frame), to) < 0
            if lost and frame[0] & request.AUDIT and frame[request.AT_SUB] == request.FRAGMENT:
                rounds.withdraw(world.fleet, i)
                world.fleet.robot[i].quota = 0
        elif isinstance(action, Actuate):
            body.actuate(world, i, row(action.command), len(action.command))
        elif isinstance(action, Retry):
            at_us = max(action.at_ms * 1000 - int(world.boot_us[i]), now_us)
            if world.retry_us[i] < 0 or at_us < world.retry_us[i]:
                world.retry_us[i] = at_us
                push(world.queue, at_us, loop.RETRY, i, 0)
        elif isinstance(action, Verdict):
            loop.judged(world, i, action.auditee, int(action.refusal))
