"""State of a robot on a mission: phase, data that auditors need for a replay, private keyring; and outcomes of steps.

TABLE has all transitions between phases; docs/spec/mission.md draws its diagram from it. Other events do not change the
phase, so a robot never leaves HELD or DONE.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType

from phalanx.mission.file.records import Header
from phalanx.mission.file.sealed import onward
from phalanx.mission.observable import Action

from .fix import Fix
from .gate import Gate
from .opening import Known, Opened


class Phase(Enum):
    """Phase of a mission in progress."""

    SEEKING = "seeking"  # on the way to the next node
    RETURNING = "returning"  # on the way back to the last validated node
    HELD = "held"  # stopped, for good: nothing is left to try
    DONE = "done"


class Event(Enum):
    """Event that may change the phase."""

    DECODED = "decoded"  # a node was validated
    COMPLETED = "completed"  # a final node, or the last one, was validated
    TIMED_OUT = "timed out"  # no node was validated in time
    BLOCKED = "blocked"  # the robot reports that its way is blocked
    PASSED = "passed"  # the target, a node decoded before, was reached on the way to another
    BACK = "back"  # the robot is back at the last validated node
    NO_WAY = "no way"  # no route is left


TABLE: dict[tuple[Phase, Event], Phase] = {
    (Phase.SEEKING, Event.DECODED): Phase.SEEKING,
    (Phase.SEEKING, Event.PASSED): Phase.SEEKING,
    (Phase.SEEKING, Event.COMPLETED): Phase.DONE,
    (Phase.SEEKING, Event.TIMED_OUT): Phase.RETURNING,
    (Phase.SEEKING, Event.BLOCKED): Phase.RETURNING,
    (Phase.SEEKING, Event.NO_WAY): Phase.HELD,
    (Phase.RETURNING, Event.DECODED): Phase.SEEKING,
    (Phase.RETURNING, Event.COMPLETED): Phase.DONE,
    (Phase.RETURNING, Event.BACK): Phase.SEEKING,
    # The robot does not find the way back either: it is lost.
    (Phase.RETURNING, Event.TIMED_OUT): Phase.HELD,
}


def step(phase: Phase, event: Event) -> Phase:
    """Return the phase after an event."""
    return TABLE.get((phase, event), phase)


@dataclass(frozen=True, slots=True, repr=False)
class Keyring:
    """Secrets of opened nodes, and failed tries: only the robot's own search needs them.

    With a gate and a floor plan anyone could decode the node behind it by brute force. So keyrings are in no
    checkpoint, and auditors do not get them.
    """

    # By (node opened, node behind the gate), decrypted; shares of a gate if several predecessors must be decoded
    gates: Mapping[tuple[int, int], Gate] = field(default_factory=dict)
    # Proofs of visits for other robots, by node
    proofs: Mapping[int, bytes] = field(default_factory=dict)
    tried: frozenset[bytes] = frozenset()  # digests of (gate, observation) that failed since a new node was opened

    def add(self, opened: Opened, gate: bytes | None, header: Header) -> Keyring:
        """Return the keyring with a node's proof, and with its gates decrypted if the node's own gate is given."""
        gates = {
            (opened.node, way.target): replace(
                way.gate, share=onward(gate, way.gate.share, header, opened.node, way.target)
            )
            for way in opened.ways
            if way.gate is not None and gate is not None
        }
        return replace(
            self,
            gates=MappingProxyType({**self.gates, **gates}),
            proofs=MappingProxyType({**self.proofs, opened.node: opened.proof}),
        )

    def remember(self, failed: set[bytes], limit: int) -> Keyring:
        """Return the keyring with more failed tries; if they exceed `limit`, older ones are dropped."""
        if not failed:
            return self
        tried = self.tried | failed
        return replace(self, tried=tried if len(tried) <= limit else frozenset(failed))

    def __repr__(self) -> str:
        return "<Keyring>"


@dataclass(frozen=True, slots=True)
class State:
    """Complete state of a mission in progress; `State()` is the initial state."""

    phase: Phase = Phase.SEEKING
    at: int | None = None  # the last validated node
    target: int | None = None  # the node to validate next
    t_s: float = -math.inf  # time of the last step
    since_s: float | None = None  # time since when no node was validated
    fixed_at_m: float = 0.0  # distance travelled at the last fix
    left_at_m: float = 0.0  # distance travelled when `at` was validated
    # Sum of the corrections of the position by known landmarks since then
    corrected_m: tuple[float, float] = (0.0, 0.0)
    opened: Mapping[int, Known] = field(default_factory=dict)
    lengths_m: Mapping[tuple[int, int], float] = field(default_factory=dict)
    blocked: frozenset[tuple[int, int]] = frozenset()  # ways that timed out or were blocked
    round: int = 0  # times that blocked ways were tried again since a new node was decoded
    others: frozenset[int] = frozenset()  # nodes that other robots proved to have decoded
    heard: tuple[bytes, ...] = ()
    keys: Keyring = field(default_factory=Keyring)  # the robot's secrets; not in any encoding of the state


class Reason(Enum):
    """Reason why no node was validated."""

    NOTHING_SENSED = "nothing sensed"
    NO_MATCH = "no match"
    BUDGET = "budget exhausted"  # the search continues in the next steps
    CONTRADICTED = "contradicted"  # by other landmarks of the same scan
    DRIFT = "more than it can have drifted"
    AMBIGUOUS = "ambiguous"  # another landmark that looks the same may have been seen
    UNCONFIRMED = "unconfirmed"  # an unsurveyed object may have matched by chance, and too few other landmarks agree
    ALTERED = "altered"  # the record of the matching node was changed
    CLOCK = "clock ran backwards"
    TIMED_OUT = "timed out"
    NO_WAY = "no way left"
    STOPPED = "held or done"


class Kind(Enum):
    """Kind of an instruction."""

    GO = "go"  # drive in the direction, from the node's place, until the next node is decoded
    DO = "do"  # perform an action until the next node is decoded
    BACK = "back"  # return to the last validated node
    WAIT = "wait"  # wait for a message, a time or another observable
    HOLD = "hold"  # stop
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Order:
    """The current instruction to the robot. Only decoded nodes have known directions and places."""

    kind: Kind
    target: int | None = None  # the next node, encoded still or decoded before
    place_m: tuple[float, float] | None = None  # place of the last validated node, where the direction begins
    direction_rad: float | None = None  # map frame
    toward_m: tuple[float, float] | None = None  # place of the target, if it was decoded before
    do: Action | None = None
    aside: int = 0  # 1 or -1: drive along the direction, offset to its left or right, since it was blocked before


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a step."""

    order: Order
    decoded: Opened | None = None  # the node validated in this step; if None, `reason` is set
    reason: Reason | None = None  # why no node was validated; also set if no way leads on from the decoded node
    fix: Fix | None = None  # the corrected pose, or None; also from known landmarks seen again
    trials: int = 0  # hashes or KDFs of the search; few with accurate odometry, the whole budget with a wrong pose
    event: Event | None = None
