"""Who drives which robot: leases, one robot each with turns, or as tickets say. One driver at a time, always."""

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
    until_ms: int | None  # of a lease; None: assigned until it is taken
    since_ms: int


class Assignment:
    """Robots, their drivers and, with one robot each, the queue.

    In mode `free` and `tickets` a command makes a lease, which each command renews; a visitor has one at a time. In
    mode `one-each` visitors get robots as they come. What an operator gives lasts until it is taken.
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._robots: dict[str, _Hold | None] = {}  # in the order of their addresses
        self._of: dict[int, list[str]] = {}  # robots of each visitor that has one: commands come in thousands
        self._queue: list[int] = []

    def set_robots(self, robots: Iterable[str], now_ms: int) -> None:
        """Take note of the robots that there are; who drove one that is gone queues first."""
        there = set(robots)
        lost = [hold.visitor for robot, hold in self._robots.items() if hold and robot not in there]
        for robot in self._robots.keys() - there:
            self._put(robot, None)
        self._robots = {robot: self._robots.get(robot) for robot in sorted(there)}
        if self._config.assign == "one-each":
            self._queue[:0] = [each for each in lost if self.robot_of(each) is None and each not in self._queue]
        self._serve(now_ms)

    def arrive(self, visitor: Visitor, now_ms: int) -> None:
        """Queue a visitor for a robot, with one robot each."""
        wants = self._config.assign == "one-each" and visitor.role is Role.DRIVE and not visitor.waiting
        if wants and visitor.id not in self._queue and self.robot_of(visitor.id) is None:
            self._queue.append(visitor.id)
            self._serve(now_ms)

    def leave(self, visitor: int, now_ms: int) -> None:
        """Free what a visitor has: it left, was removed, or may not drive any more."""
        self._queue = [each for each in self._queue if each != visitor]
        for robot in list(self._of.get(visitor, ())):
            self._put(robot, None)
        self._serve(now_ms)

    def tick(self, now_ms: int) -> None:
        """End leases that were not renewed, and turns while others queue."""
        for robot, hold in self._robots.items():
            if hold and hold.until_ms is not None and now_ms >= hold.until_ms:
                self._put(robot, None)
        over = [
            (hold.since_ms, robot)
            for robot, hold in self._robots.items()
            if hold and self._config.assign == "one-each" and now_ms - hold.since_ms >= self._config.turn_ms
        ]
        for _, robot in sorted(over)[: len(self._queue)]:  # longest first; nobody gives way to nobody
            hold = self._robots[robot]
            if hold:
                self._put(robot, None)
                self._queue.append(hold.visitor)
        self._serve(now_ms)

    def claim(self, visitor: Visitor, robot: str, now_ms: int, *, is_stop: bool = False) -> None:
        """Take or renew the lease of a command that was carried out, or raise. A stop takes none, and renews none.

        Raises: NotAllowed: its role, ticket or assignment; Busy: another visitor drives it.
        """
        hold = self.check(visitor, robot, now_ms)
        operates = visitor.role is Role.OPERATE
        if is_stop or (hold and hold.visitor == visitor.id and hold.until_ms is None):
            return
        if operates and hold and hold.until_ms is None:
            return  # an operator helps; the robot stays assigned
        for other in list(self._of.get(visitor.id, ())):
            its = self._robots[other]
            if other != robot and its and its.until_ms is not None and not operates:
                self._put(other, None)
        since_ms = hold.since_ms if hold and hold.visitor == visitor.id else now_ms
        self._put(robot, _Hold(visitor.id, now_ms + self._config.lease_ms, since_ms))

    def give(self, robot: str, visitor: Visitor, now_ms: int) -> None:
        """Assign a robot to a visitor, until it is taken. Raises: NotAllowed: as `suits`."""
        self.suits(visitor, robot)
        self.leave(visitor.id, now_ms)
        hold = self._robots[robot]
        self._put(robot, _Hold(visitor.id, None, now_ms))
        if hold and self._config.assign == "one-each" and hold.visitor != visitor.id:
            self._queue.insert(0, hold.visitor)
        self._serve(now_ms)

    def take(self, robot: str, now_ms: int) -> None:
        """Free a robot; its driver queues last, with one robot each. Raises: NotAllowed: no such robot."""
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
        """Return who drives a robot now."""
        hold = self._robots.get(robot)
        return hold.visitor if hold and (hold.until_ms is None or now_ms < hold.until_ms) else None

    def drivers(self, now_ms: int) -> dict[str, int]:
        """Return who drives each robot that somebody drives now."""
        return {
            robot: hold.visitor
            for robot, hold in self._robots.items()
            if hold and (hold.until_ms is None or now_ms < hold.until_ms)
        }

    def robot_of(self, visitor: int) -> str | None:
        """Return the first robot that a visitor drives or is assigned to."""
        return min(self._of.get(visitor, ()), default=None)

    def place_of(self, visitor: int) -> int:
        """Return a visitor's place in the queue, from 1; 0: it is not in it."""
        return self._queue.index(visitor) + 1 if visitor in self._queue else 0

    def left_ms(self, visitor: int, now_ms: int) -> int:
        """Return what is left of a visitor's turn while others queue; 0: no limit."""
        robot = self.robot_of(visitor)
        hold = self._robots[robot] if robot else None
        if hold is None or self._config.assign != "one-each" or not self._queue:
            return 0
        return max(1, hold.since_ms + self._config.turn_ms - now_ms)

    def suits(self, visitor: Visitor, robot: str) -> None:
        """Raise NotAllowed: no such robot, or one that this visitor may never drive: its role, or its ticket."""
        if visitor.role < Role.DRIVE or visitor.waiting:
            raise NotAllowed("this visitor may only watch")
        self._known(robot)
        if visitor.robots and robot not in visitor.robots:
            raise NotAllowed("a robot that the ticket does not name")

    def check(self, visitor: Visitor, robot: str, now_ms: int) -> _Hold | None:
        """Return who has the robot, if this visitor may command it. Raises: NotAllowed; Busy."""
        self.suits(visitor, robot)
        if self._config.assign == "tickets" and not visitor.robots and visitor.role is not Role.OPERATE:
            raise NotAllowed("a ticket names the robots of each visitor")
        hold = self._robots[robot]
        if hold and hold.until_ms is not None and now_ms >= hold.until_ms:
            hold = None
        if visitor.role is Role.OPERATE or (hold and hold.visitor == visitor.id):
            return hold
        if self._config.assign == "one-each":
            raise NotAllowed("a robot of another visitor")
        if hold:
            raise Busy("another visitor drives this robot")
        return None

    def _put(self, robot: str, hold: _Hold | None) -> None:
        """Let somebody have a robot, or nobody."""
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
        """Give free robots to those who queue."""
        if self._config.assign != "one-each":
            return
        for robot, hold in self._robots.items():
            if hold is None and self._queue:
                self._put(robot, _Hold(self._queue.pop(0), None, now_ms))
