"""Actions: requests of a robot's event handlers to their caller, in one buffer.

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
    """Send a packet that the a-node admitted, to one robot's id or to EVERYBODY."""

    packet: bytes
    to: int


@dataclass(frozen=True, slots=True)
class Actuate:
    """Pass a command that the a-node admitted to the actuators."""

    command: bytes


@dataclass(frozen=True, slots=True)
class RetryAt:
    """Call `on_retry` at this time of the robot's clock. The robot has one such timer: the earliest time counts."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class RoundAt:
    """Call `on_round` at this time of the robot's clock; `listened`: the robot has listened before this round."""

    at_ms: int
    listened: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """Record that an audit by this robot has ended; `refusal` is NONE if it issued a token."""

    auditee: int
    refusal: Refusal


Action = Transmit | Actuate | RetryAt | RoundAt | Verdict


@kernel
def clear(w: Work) -> None:
    """Empty the buffer."""
    w.used[COUNT] = 0
    w.used[BYTES] = 0


@kernel
def append(w: Work, kind: int, number: int, more: int) -> int:
    """Append an action of two numbers (RETRY_AT, ROUND_AT or VERDICT); return its index."""
    at = int(w.used[COUNT])
    w.used[COUNT] = at + 1
    w.actions[at].kind = kind
    w.actions[at].number = number
    w.actions[at].more = more
    return at


@kernel
def carry(w: Work, kind: int, to: int, source: Row, begin: int, length: int) -> None:
    """Append a TRANSMIT to an id or EVERYBODY, or an ACTUATE, with the bytes `source[begin : begin + length]`."""
    at, used = append(w, kind, to, 0), w.used[BYTES]
    copy(w.sent, used, source, begin, length)
    w.actions[at].begin = used
    w.actions[at].length = length
    w.used[BYTES] = used + length


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
    """Replace the contents of the buffer by one action."""
    clear(w)
    if isinstance(action, Transmit):
        carry(w, TRANSMIT, action.to, row(action.packet), 0, len(action.packet))
    elif isinstance(action, Actuate):
        carry(w, ACTUATE, 0, row(action.command), 0, len(action.command))
    elif isinstance(action, RetryAt):
        append(w, RETRY_AT, action.at_ms, 0)
    elif isinstance(action, RoundAt):
        append(w, ROUND_AT, action.at_ms, int(action.listened))
    else:
        append(w, VERDICT, action.auditee, int(action.refusal))
