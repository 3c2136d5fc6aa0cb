"""What became of a robot whose mission was attacked, and of a mission that was guessed; and its damage as a number."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.robot.attacks.harm import Harm

# An attack that can shift a robot by less has shifted it by no more than its search reaches.
FALSE_FIX_M = 0.3
FALSE_FIX_RAD = math.radians(6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Walked:
    """What became of the robot, by the world's truth."""

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
class Guessed:
    """What came of trying to read a captured mission: a part of it really run, the rest from its rate."""

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
