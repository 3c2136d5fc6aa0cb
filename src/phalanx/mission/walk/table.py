"""A walk as a table: in which phase, on which event, to which phase. docs/spec/mission.md draws its diagram from TABLE.

An event that the table does not name for a phase changes nothing: nothing wakes a robot that holds or is done.
"""

from __future__ import annotations

from enum import Enum


class Phase(Enum):
    """What a walker is about."""

    SEEKING = "seeking"  # on the way to the next node
    RETURNING = "returning"  # on the way back to the last validated node
    HELD = "held"  # stopped, for good: nothing is left to try
    DONE = "done"


class Event(Enum):
    """What happens to a walk."""

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
    """The next phase."""
    return TABLE.get((phase, event), phase)
