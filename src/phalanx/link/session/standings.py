"""The standings (current rights) last sent to visitors, so that only changes are sent."""

from __future__ import annotations

from .assignment import Assignment
from .messages import Standing
from .visitors import Visitor


class Standings:
    """The last standing sent to each connected visitor."""

    def __init__(self, assignment: Assignment) -> None:
        self._assignment = assignment
        self._sent: dict[int, tuple[object, ...]] = {}

    def changed(self, visitor: Visitor, now_ms: int) -> Standing | None:
        """Return the standing to send to a visitor now; None if it has not changed."""
        robot, place = self._assignment.robot_of(visitor.id) or "", self._assignment.place_of(visitor.id)
        standing = Standing(visitor.role, visitor.waiting, place, self._assignment.left_ms(visitor.id, now_ms), robot)
        # A change of the time left alone is not sent.
        key = standing.role, standing.waiting, standing.place, standing.left_ms > 0, standing.robot
        if self._sent.get(visitor.id) == key:
            return None
        self._sent[visitor.id] = key
        return standing

    def forget(self, visitor: int) -> None:
        """Send a visitor its standing again when it reconnects."""
        self._sent.pop(visitor, None)
