"""Measures of an attack's damage: to a swarm, compared with a run without attackers; to a mission; to its secrecy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # keeps the list of attacks fast to import
    from .liar import Liar

Run = Any  # a phalanx.world.scenarios.run.Run, which this package must not import


@dataclass(frozen=True, slots=True)
class Harm:
    """Measure of damage."""

    words: str  # description, for display
    unit: str
    # Computes the damage: from a liar, its run and the same run without it; in other scenes, from the outcome.
    of: Callable[..., float]


def _correct(attacked: Run) -> list[int]:
    return [i for i in range(len(attacked.positions_m)) if i + 1 not in attacked.compromised]


def _astray(_liar: Liar, attacked: Run, honest: Run) -> float:
    # Correct robots only: the position of a compromised robot is no damage to others.
    correct = _correct(attacked)
    apart_m = ((attacked.positions_m - honest.positions_m) ** 2).sum(axis=1) ** 0.5
    return float(apart_m[correct].mean()) if correct else 0.0


def _starved(_liar: Liar, attacked: Run, _honest: Run) -> float:
    return float(attacked.in_safe_mode[_correct(attacked)].sum())


def _airtime(liar: Liar, attacked: Run, honest: Run) -> float:
    # A robot in Safe Mode is silent: compare with an honest robot's airtime up to that moment only.
    needed_s = float(honest.airtime_s[liar.i]) * liar.alive_s / attacked.now_s
    return 100 * (float(attacked.airtime_s[liar.i]) - needed_s) / liar.lied_s if liar.lied_s else 0.0


ASTRAY = Harm("mean distance of correct robots from their positions without the attack", "m", _astray)
STARVED = Harm("correct robots in Safe Mode", "robots", _starved)
AIRTIME = Harm("airtime beyond an honest robot's, as a share of the time it lies until Safe Mode", "%", _airtime)

# --- of missions ---

# A smaller error of a fix is not counted as false.
FALSE_FIX_M = 0.3
FALSE_FIX_RAD = math.radians(6)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrandOutcome:
    """Outcome of an attack on one robot's mission, compared with the ground truth."""

    refused: str = ""  # reason why it did not start, or ""
    done: bool = False  # it took its mission for completed
    held: bool = False  # it has stopped permanently, or never started
    decoded: tuple[int, ...] = ()  # nodes that it took for reached, in order
    false_nodes: int = 0  # nodes that it took for reached while more than a metre from its estimated position
    actions: tuple[str, ...] = ()
    wrong_actions: tuple[str, ...] = ()  # actions that were not ordered, or not at that place
    false_fixes: int = 0  # fixes that left an error of 0.3 m or 6 degrees
    worst_fix_m: float = 0.0  # largest error after a false fix; 0 without one
    not_validated: tuple[str, ...] = ()  # reasons that it reported, in order
    from_last_m: float | None = None  # final distance from its last validated node; None if that has no place
    pose_error_m: float = 0.0  # final distance between its true and its estimated position
    t_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GuessOutcome:
    """Result of an attack on a captured mission: partly run, the rest extrapolated from its rate."""

    nodes: int
    read: int  # nodes that were read
    tries: int  # actually made
    seconds: float
    tries_per_s: float  # measured; 0 if no tries were needed
    candidates: float  # to try in the worst case, as far as known
    whole_s: float  # time for all candidates at that rate


WRONG = Harm("actions that were not ordered, or not at that place", "actions", lambda walked: len(walked.wrong_actions))
FALSE = Harm(
    "nodes taken for reached by a robot more than a metre from its estimated position",
    "nodes",
    lambda walked: walked.false_nodes,
)
FIX = Harm("largest position error after a false fix", "m", lambda walked: walked.worst_fix_m)
READ = Harm("nodes read in the tries made", "nodes", lambda guessed: guessed.read)
