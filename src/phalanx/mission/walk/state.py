"""The state of a walk: its phase, what auditors must know to replay it, the robot's own keyring; outcomes of steps.

TABLE has all transitions between phases; docs/spec/mission.md draws its diagram from it. An event that it does not name
for a phase changes nothing: nothing wakes a robot that holds or is done.
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
    """Phases of a walk."""

    SEEKING = "seeking"  # on the way to the next node
    RETURNING = "returning"  # on the way back to the last validated node
    HELD = "held"  # stopped, for good: nothing is left to try
    DONE = "done"


class Event(Enum):
    """Events of a walk."""

    DECODED = "decoded"  # a node was validated
    COMPLETED = "completed"  # it was a final one, or the last one
    TIMED_OUT = "timed out"  # nothing was validated in time
    BLOCKED = "blocked"  # the robot says that the way is
    PASSED = "passed"  # a node decoded before is reached again: only a place on the way to another
    BACK = "back"  # the last validated node is reached again
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
    # Once is a detour, twice is lost: the way back is not found either.
    (Phase.RETURNING, Event.TIMED_OUT): Phase.HELD,
}


def step(phase: Phase, event: Event) -> Phase:
    """Return the next phase."""
    return TABLE.get((phase, event), phase)


@dataclass(frozen=True, slots=True, repr=False)
class Keyring:
    """Secrets of opened nodes, and what was tried in vain: only the robot's own search needs them.

    A gate opens the way to the node behind it for whoever has a floor plan and patience. So keyrings are in no
    checkpoint, and no auditor asks for them.
    """

    # By (node opened, node behind the gate), ready for use; shares where several predecessors must agree
    gates: Mapping[tuple[int, int], Gate] = field(default_factory=dict)
    # That a node was visited, to show to another robot; by node
    proofs: Mapping[int, bytes] = field(default_factory=dict)
    tried: frozenset[bytes] = frozenset()  # digests of (gate, observation) that failed since the last node was opened

    def add(self, opened: Opened, gate: bytes | None, header: Header) -> Keyring:
        """The keyring with what a node released; without the node's own gate, the gates behind it stay closed."""
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
        """The keyring that knows of tries which failed; of more than `limit` the older ones are forgotten."""
        if not failed:
            return self
        tried = self.tried | failed
        return replace(self, tried=tried if len(tried) <= limit else frozenset(failed))

    def __repr__(self) -> str:
        return "<Keyring>"


@dataclass(frozen=True, slots=True)
class State:
    """All that a walk remembers. `State()` is its beginning."""

    phase: Phase = Phase.SEEKING
    at: int | None = None  # the last validated node
    target: int | None = None  # the one to be validated next
    t_s: float = -math.inf  # of the last step
    since_s: float | None = None  # nothing was validated
    fixed_at_m: float = 0.0  # way travelled at the last fix
    left_at_m: float = 0.0  # way travelled when `at` was validated
    # By how much landmarks seen again have moved the estimate since then, in all
    pulled_m: tuple[float, float] = (0.0, 0.0)
    opened: Mapping[int, Known] = field(default_factory=dict)
    lengths_m: Mapping[tuple[int, int], float] = field(default_factory=dict)
    blocked: frozenset[tuple[int, int]] = frozenset()  # ways that timed out or were blocked
    round: int = 0  # how often those were taken up again since a new node was decoded
    others: frozenset[int] = frozenset()  # nodes that other robots proved to have decoded
    heard: tuple[bytes, ...] = ()
    keys: Keyring = field(default_factory=Keyring)  # the robot's secrets; not in any encoding of the state


class Reason(Enum):
    """Why nothing was validated."""

    NOTHING_SENSED = "nothing sensed"
    NO_MATCH = "no match"
    BUDGET = "budget exhausted"  # the rest is tried in the next steps
    CONTRADICTED = "contradicted"  # by other landmarks of the same scan
    DRIFT = "more than it can have drifted"
    AMBIGUOUS = "ambiguous"  # something else that looks the same may be meant
    UNCONFIRMED = "unconfirmed"  # it may be something that nobody surveyed, and too little beside it agrees
    ALTERED = "altered"  # it matched a record that belongs to another
    CLOCK = "clock ran backwards"
    TIMED_OUT = "timed out"
    NO_WAY = "no way left"
    STOPPED = "held or done"


class Kind(Enum):
    """Kind of an instruction."""

    GO = "go"  # from the node's place in the direction, until the next node decodes
    DO = "do"  # an action, until the next node decodes
    BACK = "back"  # to the last validated node
    WAIT = "wait"  # for something to experience: a message, a time
    HOLD = "hold"  # stop
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Order:
    """The instruction in force. Directions and places are known only of nodes that were decoded."""

    kind: Kind
    target: int | None = None  # the node to be decoded next; still dark, or seen before
    place_m: tuple[float, float] | None = None  # of the last validated node: where the direction begins
    direction_rad: float | None = None  # map frame
    toward_m: tuple[float, float] | None = None  # where the target is, if it was decoded before
    do: Action | None = None
    aside: int = 0  # 1 or -1: along the direction, but to its left or right, where it was blocked before


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a step."""

    order: Order
    decoded: Opened | None = None  # the node that was validated in this step, or None; then `reason` says why not
    reason: Reason | None = None  # also beside a node that was decoded, if no way is left from there
    fix: Fix | None = None  # the corrected pose, or None; also from landmarks decoded earlier and seen again
    trials: int = 0  # hashes or KDFs that the search took: small is a sound odometry, the budget is a broken one
    event: Event | None = None
