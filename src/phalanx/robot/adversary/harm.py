"""Measure an attack's damage: to a swarm, beside the same run without a liar; to a mission; to its secrecy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the list of attacks does not wait for it
    from .liar import Liar

Run = Any  # a phalanx.world.scenarios.run.Run, which stands above this package


@dataclass(frozen=True, slots=True)
class Harm:
    """One way to measure damage."""

    words: str  # what is measured, for people
    unit: str
    # Returns the damage, from a liar, its run and the same run without it, or from another scene's result.
    of: Callable[..., float]


def _correct(attacked: Run) -> list[int]:
    return [i for i in range(len(attacked.positions_m)) if i + 1 not in attacked.compromised]


def _astray(_liar: Liar, attacked: Run, honest: Run) -> float:
    # Others only: where a liar has taken itself is no harm to anybody.
    correct = _correct(attacked)
    apart_m = ((attacked.positions_m - honest.positions_m) ** 2).sum(axis=1) ** 0.5
    return float(apart_m[correct].mean()) if correct else 0.0


def _starved(_liar: Liar, attacked: Run, _honest: Run) -> float:
    return float(attacked.in_safe_mode[_correct(attacked)].sum())


def _airtime(liar: Liar, attacked: Run, honest: Run) -> float:
    # A liar in Safe Mode is silent: neither the time after it counts, nor what an honest robot would have said then.
    needed_s = float(honest.airtime_s[liar.i]) * liar.alive_s / attacked.now_s
    return 100 * (float(attacked.airtime_s[liar.i]) - needed_s) / liar.lied_s if liar.lied_s else 0.0


ASTRAY = Harm("how far correct robots are on the mean from where they would be", "m", _astray)
STARVED = Harm("correct robots in Safe Mode", "robots", _starved)
AIRTIME = Harm(
    "share of the time it lies, until Safe Mode, that it is on the air beyond an honest robot's", "%", _airtime
)

# --- of missions ---

# An attack that can shift a robot by less has shifted it by no more than its search reaches.
FALSE_FIX_M = 0.3
FALSE_FIX_RAD = math.radians(6)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrandOutcome:
    """Outcome of the robot, by ground truth."""

    refused: str = ""  # the reason for which it did not start, or ""
    done: bool = False  # it believes its mission completed
    held: bool = False  # it has stopped for good, or never started
    decoded: tuple[int, ...] = ()  # nodes that it took for reached, in this order
    false_nodes: int = 0  # those of them that it took for reached more than a metre from where it believed to be
    actions: tuple[str, ...] = ()
    wrong_actions: tuple[str, ...] = ()  # those that nobody ordered, or not there
    false_fixes: int = 0  # fixes that left it 0.3 m or 6 degrees off
    worst_fix_m: float = 0.0  # so far off did the worst of them leave it; 0 without one
    not_validated: tuple[str, ...] = ()  # reasons that it gave, in this order
    from_last_m: float | None = None  # at the end, from the place of its last validated node; None if that is no place
    pose_error_m: float = 0.0  # at the end, between where it is and where it believes to be
    t_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GuessOutcome:
    """Result of an attack on a captured mission: partly run, the rest extrapolated from its rate."""

    nodes: int
    read: int  # nodes that were read
    tries: int  # really made
    seconds: float
    tries_per_s: float  # measured; 0 where nothing had to be tried
    candidates: float  # to be tried in the worst case, as far as is known now
    whole_s: float  # what all of them take at that rate


WRONG = Harm("things done that nobody ordered, or not there", "actions", lambda walked: len(walked.wrong_actions))
FALSE = Harm(
    "nodes taken for reached by a robot more than a metre from where it believed to be",
    "nodes",
    lambda walked: walked.false_nodes,
)
FIX = Harm("how far off the worst false fix left the robot", "m", lambda walked: walked.worst_fix_m)
READ = Harm("nodes read in the tries that were made", "nodes", lambda guessed: guessed.read)
