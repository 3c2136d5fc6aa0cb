"""Run robots in Python (attacks, researchers' controllers) inside the compiled loop.

They get the loop's events, and the loop carries out their actions. One robot can be traced: each of its events is
printed, with the actions that it returned. A traced robot runs the steps of the compiled handlers from Python, so a
traced run has the same digest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Final, Protocol

from phalanx.bti import request, seeking
from phalanx.robot import actions
from phalanx.robot.actions import EVERYBODY, Action, Actuate, RetryAt, RoundAt, Transmit
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.robot.planner import Planner, advice_of, forward_state
from phalanx.robot.robot import Robot
from phalanx.wire import driven, guarded, protocols, table
from phalanx.wire.fields import get_u16, row

from . import body, loop
from .events import CONTROL, MESSAGE, push
from .world import CLOCK, TRACED, World

# The method of `Robot` for each kind of event.
METHODS = {
    CONTROL: "on_reading",
    MESSAGE: "on_packet",
    loop.ROUND: "on_round",
    loop.RETRY: "on_retry",
    loop.SENT: "on_sent",
    loop.WAKE: "on_wake",
}


class Looks(Protocol):
    """Sensors that see more than the robot's own motion: a protocol's stage, or a lidar and bumpers."""

    def look(self, rob_id: int, t_s: float, place_m: tuple[float, float], *, lies: bool) -> bytes:
        """Return the bytes behind the motion in the reading of a robot at this place."""
        ...


NO_PLANNERS: Mapping[int, Planner] = {}
# Names in a trace.
SUBS = {
    request.HELLO: "HELLO",
    seeking.SEEK: "SEEK",
    seeking.HERE: "HERE",
    request.FRAGMENT: "fragment",
    request.TOKEN: "token",
}
NAMES = {
    value: name.removeprefix("KIND_").lower().replace("_", " ")
    for module in (driven, guarded, protocols, table)
    for name, value in vars(module).items()
    if name.startswith("KIND_")
}
# Fields of an event, read as one tuple: that takes 1 us, and one field of a numpy record takes 5.
_EVENT: Final = itemgetter(*map(list(CLOCK.names or ()).index, ("robot", "kind", "now_us", "body", "arg")))


class Trace:
    """Print what robot `rob_id` does, a line for each event and each action, through `echo`."""

    def __init__(self, rob_id: int, echo: Callable[[str], None]) -> None:
        self.rob_id, self._echo = rob_id, echo

    def event(self, now_us: int, name: str, payload: bytes | str, asked: Iterable[Action]) -> None:
        """Print an event at `now_us` of the simulation, with its packet, its reading or a word, and its actions."""
        shown = payload if isinstance(payload, str) else described(payload)
        self._echo(f"{now_us / 1e6:11.6f} s  robot {self.rob_id}  {name:10}  {shown}".rstrip())
        for action in asked:
            self._echo(f"{'':13}    -> {_of_action(action)}")


def _of_action(action: Action) -> str:
    if isinstance(action, Transmit):
        to = "everybody" if action.to == EVERYBODY else f"robot {action.to}"
        return f"transmit    {described(action.packet)}, to {to}"
    if isinstance(action, Actuate):
        return f"actuate     {described(action.command)}"
    if isinstance(action, RetryAt):
        return f"retry at    {action.at_ms} ms of its clock"
    if isinstance(action, RoundAt):
        return f"round at    {action.at_ms} ms of its clock" + (", silent until then" if action.listened else "")
    why = f"refused, {action.refusal.name.lower().replace('_', ' ')}" if action.refusal else "a token is due"
    return f"verdict     on robot {action.auditee}: {why}"


def described(raw: bytes) -> str:
    """Return a packet, a reading or a command in words, with its length."""
    if request.is_audit(row(raw), len(raw)):
        src, dst, sub = get_u16(row(raw), request.AT_SRC), get_u16(row(raw), request.AT_DST), raw[request.AT_SUB]
        text = f"{SUBS.get(sub, f'audit packet {sub}')} of robot {src}" + (f" for robot {dst}" if dst else "")
        if sub == request.FRAGMENT and len(raw) > request.AT_COUNT:
            text += f", {raw[request.AT_INDEX] + 1} of {raw[request.AT_COUNT]}"
    else:
        text = NAMES.get(raw[0], f"kind {raw[0]}") if raw else "nothing"
    return f"{text} ({len(raw)} bytes)"


def handle(
    world: World,
    robots: Mapping[int, Robot],
    planners: Mapping[int, Planner] = NO_PLANNERS,
    stage: Looks | None = None,
    trace: Trace | None = None,
) -> None:
    """Hand the event at which the loop stopped to its robot, found by index in `robots`, and carry out its actions.

    `planners` advise some robots, by index; `stage` adds bytes to their readings; `trace` prints one of them.
    """
    i, kind, now_us, body_kind, arg = _EVENT(world.clock.item())
    robot = robots[i]
    now_ms = (now_us + int(world.boot_us[i])) // 1000
    if i in planners:
        _plan(world, robot, planners[i], kind, now_ms)
    seen = _look(world, robot, stage, now_us, now_ms) if stage and kind == CONTROL else b""
    asked = _actions(world, robot, kind, now_ms, seen, arg)
    robot.checked(METHODS[kind], asked)
    if robot.is_own:
        _check_commands(body_kind, robot, asked)
    if trace and trace.rob_id == robot.id:
        trace.event(now_us, METHODS[kind], _payload(world, kind, seen, arg), asked)
    perform(world, i, now_ms, asked)
    if kind == loop.WAKE and isinstance(robot, Liar):
        wake(world, robot, now_us)


def _payload(world: World, kind: int, seen: bytes, arg: int) -> bytes | str:
    if kind in (CONTROL, MESSAGE):
        raw = world.reading if kind == CONTROL else world.packet
        return raw[: world.packet_len[0]].tobytes() + seen
    if kind == loop.SENT:
        return "it arrived" if arg else "it did not arrive"
    return "after it has listened" if kind == loop.ROUND and arg else ""


def _look(world: World, robot: Robot, stage: Looks, now_us: int, now_ms: int) -> bytes:
    x_m, y_m = world.pos[robot.i].tolist()
    lies = isinstance(robot, Liar) and robot.lies(now_ms)
    return stage.look(robot.id, now_us / 1e6, (x_m, y_m), lies=lies)


def _plan(world: World, robot: Robot, planner: Planner, kind: int, now_ms: int) -> None:
    if kind == MESSAGE:
        forward_state(planner, now_ms, world.packet[: world.packet_len[0]].tobytes())
    elif kind == CONTROL:
        advice = advice_of(planner, now_ms, world.reading[: world.packet_len[0]].tobytes())
        if advice:
            robot.on_advice(advice)


def _check_commands(body_kind: int, robot: Robot, asked: list[Action]) -> None:
    # The body would ignore it, and the audits, which only compare it with the controller's, would pass it.
    known = body.COMMANDS[body_kind]
    for action in asked:
        if isinstance(action, Actuate) and (len(action.command), action.command[0]) != (known.size, known.tag):
            raise OwnMistake(
                f"robot {robot.id}: no command of its body's: "
                f"{len(action.command)} bytes, the first {action.command[0]}",
                f"{known.size} bytes, the first {known.tag}: phalanx docs guides/own-controller has the layout",
                robot.controller,
            )


def _actions(world: World, robot: Robot, kind: int, now_ms: int, seen: bytes, arg: int) -> list[Action]:
    if kind == CONTROL:
        return robot.on_reading(now_ms, world.reading[: world.packet_len[0]].tobytes() + seen)
    if kind == MESSAGE:
        return robot.on_packet(now_ms, world.packet[: world.packet_len[0]].tobytes())
    if kind == loop.WAKE:
        return robot.on_wake(now_ms) if isinstance(robot, Liar) and robot.lies(now_ms) else []
    # Other robots in Python keep a fragment for which their radio has no room.
    robot.busy = bool(world.runs[robot.i] == TRACED and world.air.nic[robot.i].long_used)
    if kind == loop.ROUND:
        return robot.on_round(now_ms, listened=bool(arg))
    if kind == loop.RETRY:
        return robot.on_retry(now_ms)
    assert kind == loop.SENT
    return robot.on_sent(now_ms, arrived=bool(arg))


def wake(world: World, liar: Liar, now_us: int) -> None:
    """Schedule the next time that a compromised robot acts out of turn, if it does."""
    if not liar.period_ms:
        return
    start_us = liar.plan.start_ms * 1000 - int(world.boot_us[liar.i])
    push(world.queue, max(now_us + liar.period_ms * 1000, start_us), loop.WAKE, liar.i, 0)


def perform(world: World, i: int, now_ms: int, asked: list[Action]) -> None:
    """Carry out actions of robot i."""
    for action in asked:
        actions.encode(world.work, action)
        loop.carry_out(world, i, now_ms)
