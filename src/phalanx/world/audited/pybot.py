"""Run robots in Python (attacks, users' controllers) inside the compiled loop.

They receive the loop's events, and the loop carries out their actions. One robot can be traced: its events and the
resulting actions are printed. A traced robot runs the compiled handlers' steps in Python, with the same digest.
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


class ExtraSensors(Protocol):
    """Sensors beyond the robot's own motion: those of a protocol's stage, or a lidar and bumpers."""

    def look(self, rob_id: int, t_s: float, place_m: tuple[float, float], *, lies: bool) -> bytes:
        """Return the bytes that follow the motion in the reading of a robot at this position."""
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
# Fields of an event, read as one tuple: that takes 1 us, whereas one field of a numpy record takes 5.
_EVENT: Final = itemgetter(*map(list(CLOCK.names or ()).index, ("robot", "kind", "now_us", "body", "arg")))


class Trace:
    """Printer of one robot's events and actions, one line each, through `echo`."""

    def __init__(self, rob_id: int, echo: Callable[[str], None]) -> None:
        self.rob_id, self._echo = rob_id, echo

    def event(self, now_us: int, name: str, payload: bytes | str, taken: Iterable[Action]) -> None:
        """Print an event at `now_us` of simulated time, with its packet, reading or description, and its actions."""
        shown = payload if isinstance(payload, str) else described(payload)
        self._echo(f"{now_us / 1e6:11.6f} s  robot {self.rob_id}  {name:10}  {shown}".rstrip())
        for action in taken:
            self._echo(f"{'':13}    -> {_action_text(action)}")


def _action_text(action: Action) -> str:
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
    """Describe a packet, a reading or a command, with its length."""
    if request.is_audit(row(raw), len(raw)):
        src, dst, sub = get_u16(row(raw), request.AT_SRC), get_u16(row(raw), request.AT_DST), raw[request.AT_SUB]
        text = f"{SUBS.get(sub, f'audit packet {sub}')} of robot {src}" + (f" for robot {dst}" if dst else "")
        if sub == request.FRAGMENT and len(raw) > request.AT_COUNT:
            text += f", {raw[request.AT_INDEX] + 1} of {raw[request.AT_COUNT]}"
    else:
        text = NAMES.get(raw[0], f"kind {raw[0]}") if raw else "empty"
    return f"{text} ({len(raw)} bytes)"


def handle(
    world: World,
    robots: Mapping[int, Robot],
    planners: Mapping[int, Planner] = NO_PLANNERS,
    stage: ExtraSensors | None = None,
    trace: Trace | None = None,
) -> None:
    """Pass the loop's current event to its robot, found by index in `robots`, and carry out the robot's actions.

    `planners` advise robots, by index; `stage` extends readings; `trace` prints one robot's events.
    """
    i, kind, now_us, body_kind, arg = _EVENT(world.clock.item())
    robot = robots[i]
    now_ms = (now_us + int(world.boot_us[i])) // 1000
    if i in planners:
        _plan(world, robot, planners[i], kind, now_ms)
    seen = _look(world, robot, stage, now_us, now_ms) if stage and kind == CONTROL else b""
    taken = _actions(world, robot, kind, now_ms, seen, arg)
    robot.checked(METHODS[kind], taken)
    if robot.is_own:
        _check_commands(body_kind, robot, taken)
    if trace and trace.rob_id == robot.id:
        trace.event(now_us, METHODS[kind], _payload(world, kind, seen, arg), taken)
    perform(world, i, now_ms, taken)
    if kind == loop.WAKE and isinstance(robot, Liar):
        wake(world, robot, now_us)


def _payload(world: World, kind: int, seen: bytes, arg: int) -> bytes | str:
    if kind in (CONTROL, MESSAGE):
        raw = world.reading if kind == CONTROL else world.packet
        return raw[: world.packet_len[0]].tobytes() + seen
    if kind == loop.SENT:
        return "delivered" if arg else "not delivered"
    return "after listening" if kind == loop.ROUND and arg else ""


def _look(world: World, robot: Robot, stage: ExtraSensors, now_us: int, now_ms: int) -> bytes:
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


def _check_commands(body_kind: int, robot: Robot, taken: list[Action]) -> None:
    # The body would ignore it, and audits, which only compare it with the controller's output, would accept it.
    known = body.COMMANDS[body_kind]
    for action in taken:
        if isinstance(action, Actuate) and (len(action.command), action.command[0]) != (known.size, known.tag):
            raise OwnMistake(
                f"robot {robot.id}: not a command of its body: "
                f"{len(action.command)} bytes, the first {action.command[0]}",
                f"{known.size} bytes, the first {known.tag}: see phalanx docs guides/own-controller",
                robot.controller,
            )


def _actions(world: World, robot: Robot, kind: int, now_ms: int, seen: bytes, arg: int) -> list[Action]:
    if kind == CONTROL:
        return robot.on_reading(now_ms, world.reading[: world.packet_len[0]].tobytes() + seen)
    if kind == MESSAGE:
        return robot.on_packet(now_ms, world.packet[: world.packet_len[0]].tobytes())
    if kind == loop.WAKE:
        return robot.on_wake(now_ms) if isinstance(robot, Liar) and robot.lies(now_ms) else []
    # Other robots in Python retry a fragment by themselves when their radio has no room.
    robot.busy = bool(world.runs[robot.i] == TRACED and world.air.nic[robot.i].long_used)
    if kind == loop.ROUND:
        return robot.on_round(now_ms, listened=bool(arg))
    if kind == loop.RETRY:
        return robot.on_retry(now_ms)
    assert kind == loop.SENT
    return robot.on_sent(now_ms, arrived=bool(arg))


def wake(world: World, liar: Liar, now_us: int) -> None:
    """Schedule the next periodic action of a compromised robot, if it has one."""
    if not liar.period_ms:
        return
    start_us = liar.plan.start_ms * 1000 - int(world.boot_us[liar.i])
    push(world.queue, max(now_us + liar.period_ms * 1000, start_us), loop.WAKE, liar.i, 0)


def perform(world: World, i: int, now_ms: int, asked: list[Action]) -> None:
    """Carry out the given actions of robot i."""
    for action in asked:
        actions.encode(world.work, action)
        loop.carry_out(world, i, now_ms)
