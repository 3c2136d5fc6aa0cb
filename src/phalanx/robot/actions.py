"""Actions: what a robot's event handlers ask of its surroundings, in one buffer.

A handler (`handlers.py`) clears the buffer and appends its actions, in the order in which they are to be carried out.
The simulator's loop reads them in compiled code; Python decodes them into the dataclasses below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from phalanx.bti.refusal import Refusal
from phalanx.bti.work import Work
from phalanx.kernel import kernel
from phalanx.wire.fields import Row, copy, row

TRANSMIT, ACTUATE, RETRY_AT, ROUND_AT, VERDICT = 1, 2, 3, 4, 5
EVERYBODY: Final = -1
# Fields of `work.used`.
COUNT, BYTES = 0, 1


@dataclass(frozen=True, slots=True)
class Transmit:
    """Send a packet that the a-node passed, to one robot's id or EVERYBODY."""

    packet: bytes
    to: int


@dataclass(frozen=True, slots=True)
class Actuate:
    """Give the actuators a command that the a-node passed."""

    command: bytes


@dataclass(frozen=True, slots=True)
class RetryAt:
    """Call `on_retry` at this moment of the robot's clock."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class RoundAt:
    """Call `on_round` at this moment of the robot's clock; `listened`: it has been silent before this round."""

    at_ms: int
    listened: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """Note that an audit by this robot has ended; `refusal` is NONE if a token was issued."""

    auditee: int
    refusal: Refusal


Action = Transmit | Actuate | RetryAt | RoundAt | Verdict


@kernel
def clear(w: Work) -> None:
    """Empty the buffer."""
    w.used[COUNT] = 0
    w.used[BYTES] = 0


@kernel
def _append(w: Work, kind: int, number: int) -> int:
    """Append an action of which `number` is the first field; return its index."""
    at = int(w.used[COUNT])
    w.used[COUNT] = at + 1
    w.actions[at].kind = kind
    w.actions[at].number = number
    return at


@kernel
def transmit(w: Work, packet: Row, begin: int, length: int, to: int) -> None:
    """Append a packet, `packet[begin : begin + length]`, to a robot's id or EVERYBODY."""
    _carry(w, _append(w, TRANSMIT, to), packet, begin, length)


@kernel
def actuate(w: Work, command: Row, begin: int, length: int) -> None:
    """Append a command to the actuators, `command[begin : begin + length]`."""
    _carry(w, _append(w, ACTUATE, 0), command, begin, length)


@kernel
def _carry(w: Work, at: int, source: Row, begin: int, length: int) -> None:
    used = w.used[BYTES]
    copy(w.sent, used, source, begin, length)
    w.actions[at].begin = used
    w.actions[at].length = length
    w.used[BYTES] = used + length


@kernel
def retry_at(w: Work, at_ms: int) -> None:
    """Append a moment for `on_retry`."""
    _append(w, RETRY_AT, at_ms)


@kernel
def round_at(w: Work, at_ms: int, listened: int) -> None:
    """Append a moment for `on_round`."""
    w.actions[_append(w, ROUND_AT, at_ms)].more = listened


@kernel
def verdict(w: Work, auditee: int, refusal: int) -> None:
    """Append the end of an audit."""
    w.actions[_append(w, VERDICT, auditee)].more = refusal


@kernel
def is_earlier(at: int, pending: int) -> bool:
    """Return whether a retry at `at` needs a timer of its own beside the pending one, -1 for none.

    The later one is not withdrawn: it comes all the same.
    """
    return pending < 0 or at < pending


def decode(w: Work) -> list[Action]:
    """Return the actions in the buffer."""
    count = int(w.used[COUNT])
    return [_decoded(w, *each) for each in w.actions[:count].tolist()] if count else []


def _decoded(w: Work, kind: int, number: int, more: int, begin: int, length: int) -> Action:
    if kind == TRANSMIT:
        return Transmit(w.sent[begin : begin + length].tobytes(), number)
    if kind == ACTUATE:
        return Actuate(w.sent[begin : begin + length].tobytes())
    if kind == RETRY_AT:
        return RetryAt(number)
    return RoundAt(number, bool(more)) if kind == ROUND_AT else Verdict(number, Refusal(more))


def encode(w: Work, action: Action) -> None:
    """Make an action the only one in the buffer."""
    clear(w)
    if isinstance(action, Transmit):
        transmit(w, row(action.packet), 0, len(action.packet), action.to)
    elif isinstance(action, Actuate):
        actuate(w, row(action.command), 0, len(action.command))
    elif isinstance(action, RetryAt):
        retry_at(w, action.at_ms)
    elif isinstance(action, RoundAt):
        round_at(w, action.at_ms, int(action.listened))
    else:
        verdict(w, action.auditee, int(action.refusal))
