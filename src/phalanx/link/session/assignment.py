"""Assignment of robots to visitors: by leases, in turns of one robot each, or by tickets. One driver per robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from phalanx.config.session import SessionConfig

from .errors import Busy, NotAllowed
from .messages import Role
from .visitors import Visitor


@dataclass(slots=True)
class _Hold:
    visitor: int
    until_ms: int | None  # end of a lease; None: assigned until it is taken away
    since_ms: int


class Assignment:
    """Robots, their drivers and, in mode `one-each`, the queue of visitors.

    In modes `free` and `tickets` a command takes a lease of the robot, and each further command renews it; a visitor
    has one lease at a time. In mode `one-each` visitors get robots in the order in which they join. A robot that an
    operator assigns stays assigned until it is taken away.
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._robots: dict[str, _Hold | None] = {}  # in the order of their addresses
        self._of: dict[int, list[str]] = {}  # robots by visitor: an index, as each command looks them up
        self._queue: list[int] = []

    def set_robots(self, robots: Iterable[str], now_ms: int) -> None:
        """Set the robots that exist now; drivers of removed robots go to the head of the queue."""
        there = set(robots)
        lost = [hold.visitor for robot, hold in self._robots.items() if hold and robot not in there]
        for robot in self._robots.keys() - there:
            self._put(robot, None)
        self._robots = {robot: self._robots.get(robot) for robot in sorted(there)}
        if self._config.assign == "one-each":
            self._queue[:0] = [each for each in lost if self.robot_of(each) is None and each not in self._queue]
        self._serve(now_ms)

    def arrive(self, visitor: Visitor, now_ms: int) -> None:
        """Queue a visitor for a robot, in mode `one-each`."""
        wants = self._config.assign == "one-each" and visitor.role is Role.DRIVE and not visitor.waiting
        if wants and visitor.id not in self._queue and self.robot_of(visitor.id) is None:
            self._queue.append(visitor.id)
            self._serve(now_ms)

    def leave(self, visitor: int, now_ms: int) -> None:
        """Free the robots of a visitor that left, was removed, or lost the right to drive."""
        self._queue = [each for each in self._queue if each != visitor]
        for robot in list(self._of.get(visitor, ())):
            self._put(robot, None)
        self._serve(now_ms)

    def tick(self, now_ms: int) -> None:
        """End leases that were not renewed, and expired turns while others are in the queue."""
        for robot, hold in self._robots.items():
            if hold and hold.until_ms is not None and now_ms >= hold.until_ms:
                self._put(robot, None)
        over = [
            (hold.since_ms, robot)
            for robot, hold in self._robots.items()
            if hold and self._config.assign == "one-each" and now_ms - hold.since_ms >= self._config.turn_ms
        ]
        for _, robot in sorted(over)[: len(self._queue)]:  # longest turn first; as many as are in the queue
            hold = self._robots[robot]
            if hold:
                self._put(robot, None)
                self._queue.append(hold.visitor)
        self._serve(now_ms)

    def claim(self, visitor: Visitor, robot: str, now_ms: int, *, is_stop: bool = False) -> None:
        """Take or renew the lease for a command that was carried out. A stop neither takes nor renews a lease.

        Raises: NotAllowed: role, ticket or assignment do not allow it; Busy: another visitor drives the robot.
        """
        hold = self.check(visitor, robot, now_ms)
        operates = visitor.role is Role.OPERATE
        if is_stop or (hold and hold.visitor == visitor.id and hold.until_ms is None):
            return
        if operates and hold and hold.until_ms is None:
            return  # an operator's command leaves the assignment as it is
        for other in list(self._of.get(visitor.id, ())):
            its = self._robots[other]
            if other != robot and its and its.until_ms is not None and not operates:
                self._put(other, None)
        since_ms = hold.since_ms if hold and hold.visitor == visitor.id else now_ms
        self._put(robot, _Hold(visitor.id, now_ms + self._config.lease_ms, since_ms))

    def give(self, robot: str, visitor: Visitor, now_ms: int) -> None:
        """Assign a robot to a visitor until it is taken away. Raises: NotAllowed: as `check_may_drive`."""
        self.check_may_drive(visitor, robot)
        self.leave(visitor.id, now_ms)
        hold = self._robots[robot]
        self._put(robot, _Hold(visitor.id, None, now_ms))
        if hold and self._config.assign == "one-each" and hold.visitor != visitor.id:
            self._queue.insert(0, hold.visitor)
        self._serve(now_ms)

    def take(self, robot: str, now_ms: int) -> None:
        """Free a robot; in mode `one-each` queue its driver at the end. Raises: NotAllowed: no such robot."""
        self._known(robot)
        hold = self._robots[robot]
        self._put(robot, None)
        if hold and self._config.assign == "one-each":
            self._queue.append(hold.visitor)
        self._serve(now_ms)

    def swap(self, first: str, second: str) -> None:
        """Exchange the drivers of two robots. Raises: NotAllowed: no such robot."""
        self._known(first)
        self._known(second)
        hold = self._robots[first]
        self._put(first, self._robots[second])
        self._put(second, hold)

    def driver_of(self, robot: str, now_ms: int) -> int | None:
        """Return the id of the visitor that drives a robot now; None: nobody."""
        hold = self._robots.get(robot)
        return hold.visitor if hold and (hold.until_ms is None or now_ms < hold.until_ms) else None

    def drivers(self, now_ms: int) -> dict[str, int]:
        """Return the driver's id for each robot that has one now."""
        return {
            robot: hold.visitor
            for robot, hold in self._robots.items()
            if hold and (hold.until_ms is None or now_ms < hold.until_ms)
        }

    def robot_of(self, visitor: int) -> str | None:
        """Return the first robot that a visitor drives or is assigned to."""
        return min(self._of.get(visitor, ()), default=None)

    def place_of(self, visitor: int) -> int:
        """Return a visitor's position in the queue, from 1; 0: not in the queue."""
        return self._queue.index(visitor) + 1 if visitor in self._queue else 0

    def left_ms(self, visitor: int, now_ms: int) -> int:
        """Return the time left of a visitor's turn while others are in the queue; 0: no limit."""
        robot = self.robot_of(visitor)
        hold = self._robots[robot] if robot else None
        if hold is None or self._config.assign != "one-each" or not self._queue:
            return 0
        return max(1, hold.since_ms + self._config.turn_ms - now_ms)

    def check_may_drive(self, visitor: Visitor, robot: str) -> None:
        """Raise NotAllowed if the robot does not exist, or the visitor's role or ticket excludes it."""
        if visitor.role < Role.DRIVE or visitor.waiting:
            raise NotAllowed("this visitor may only watch")
        self._known(robot)
        if visitor.robots and robot not in visitor.robots:
            raise NotAllowed("the ticket does not name this robot")

    def check(self, visitor: Visitor, robot: str, now_ms: int) -> _Hold | None:
        """Return the current hold on the robot, if this visitor may command it. Raises: NotAllowed; Busy."""
        self.check_may_drive(visitor, robot)
        if self._config.assign == "tickets" and not visitor.robots and visitor.role is not Role.OPERATE:
            raise NotAllowed("only tickets that name robots allow driving")
        hold = self._robots[robot]
        if hold and hold.until_ms is not None and now_ms >= hold.until_ms:
            hold = None
        if visitor.role is Role.OPERATE or (hold and hold.visitor == visitor.id):
            return hold
        if self._config.assign == "one-each":
            raise NotAllowed("the robot is not assigned to this visitor")
        if hold:
            raise Busy("another visitor drives this robot")
        return None

    def _put(self, robot: str, hold: _Hold | None) -> None:
        """Set or clear the hold on a robot, and update the index by visitor."""
        before, self._robots[robot] = self._robots[robot], hold
        if (before and before.visitor) == (hold and hold.visitor):
            return
        if before:
            self._of[before.visitor].remove(robot)
            if not self._of[before.visitor]:
                del self._of[before.visitor]
        if hold:
            self._of.setdefault(hold.visitor, []).append(robot)

    def _known(self, robot: str) -> None:
        if robot not in self._robots:
            raise NotAllowed("no such robot")

    def _serve(self, now_ms: int) -> None:
        """Assign free robots to visitors in the queue."""
        if self._config.assign != "one-each":
            return
        for robot, hold in self._robots.items():
            if hold is None and self._queue:
                self._put(robot, _Hold(self._queue.pop(0), None, now_ms))
