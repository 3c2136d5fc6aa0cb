"""What a step of a walk comes to: the instruction in force, and what was validated or why not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from phalanx.mission.observable import Action

from .fix import Fix
from .opening import Opened
from .table import Event


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
    """What a robot shall do."""

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
    """What a step came to."""

    order: Order
    decoded: Opened | None = None  # the node that was validated in this step, or None; then `reason` says why not
    reason: Reason | None = None  # also beside a node that was decoded, if no way is left from there
    fix: Fix | None = None  # the corrected pose, or None; also from landmarks decoded earlier and seen again
    trials: int = 0  # hashes or KDFs that the search took: small is a sound odometry, the budget is a broken one
    event: Event | None = None
