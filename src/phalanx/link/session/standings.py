"""Remember what visitors know of what they may do, so that each is sent changes only."""

from __future__ import annotations

from .assignment import Assignment
from .messages import Standing
from .visitors import Visitor


class Standings:
    """The last standing of each visitor that is connected."""

    def __init__(self, assignment: Assignment) -> None:
        self._assignment = assignment
        self._told: dict[int, tuple[object, ...]] = {}

    def changed(self, visitor: Visitor, now_ms: int) -> Standing | None:
        """Return what a visitor is to be told now; None: nothing."""
        robot, place = self._assignment.robot_of(visitor.id) or "", self._assignment.place_of(visitor.id)
        standing = Standing(visitor.role, visitor.waiting, place, self._assignment.left_ms(visitor.id, now_ms), robot)
        # Whether a turn is limited, not how much of it is left.
        key = standing.role, standing.waiting, standing.place, standing.left_ms > 0, standing.robot
        if self._told.get(visitor.id) == key:
            return None
        self._told[visitor.id] = key
        return standing

    def forget(self, visitor: int) -> None:
        """Tell a visitor all when it is back."""
        self._told.pop(visitor, None)
