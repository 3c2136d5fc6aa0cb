"""Trace one robot: print each of its events, and the actions that it asked for.

A traced robot runs the steps of the compiled handlers from Python, so a traced run has the digests of any other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from phalanx.bti import request
from phalanx.robot.actions import EVERYBODY, Action, Actuate, RetryAt, RoundAt, Transmit
from phalanx.wire import driven, guarded, protocols, table
from phalanx.wire.fields import get_u16, row

SUBS = {request.HELLO: "HELLO", request.SEEK: "SEEK", request.FRAGMENT: "fragment", request.TOKEN: "token"}
NAMES = {
    value: name.removeprefix("KIND_").lower().replace("_", " ")
    for module in (driven, guarded, protocols, table)
    for name, value in vars(module).items()
    if name.startswith("KIND_")
}


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
    """Return what a packet, a reading or a command is, and how long."""
    if request.is_audit(row(raw), len(raw)):
        src, dst, sub = get_u16(row(raw), request.AT_SRC), get_u16(row(raw), request.AT_DST), raw[request.AT_SUB]
        text = f"{SUBS.get(sub, f'audit packet {sub}')} of robot {src}" + (f" for robot {dst}" if dst else "")
        if sub == request.FRAGMENT and len(raw) > request.AT_COUNT:
            text += f", {raw[request.AT_INDEX] + 1} of {raw[request.AT_COUNT]}"
    else:
        text = NAMES.get(raw[0], f"kind {raw[0]}") if raw else "nothing"
    return f"{text} ({len(raw)} bytes)"
