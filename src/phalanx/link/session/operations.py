"""Operators' actions on visitors: remove, approve, change codes and roles, assign robots and take them away.

Each change is stored before its events are returned.
"""

from __future__ import annotations

from dataclasses import replace

from phalanx.errors import UsageError

from .errors import EndReason
from .events import Now, ServerEvent
from .messages import Role
from .secret import NO_ID
from .server import SessionServer
from .visitors import Visitor


class Operations:
    """Operators' actions on a server; the caller has checked that an operator asks for them."""

    def __init__(self, server: SessionServer) -> None:
        self._server = server

    def remove(self, visitor: int, now: Now) -> list[ServerEvent]:
        """Remove a visitor: revoke its secrets and ticket, end its session, and change the code and the epoch.

        From now on newcomers wait for approval, because the same person may scan the new code. Raises: UsageError.
        """
        known = self._known(visitor)
        rows = self._server.door.revoke_ticket(known.ticket) if known.ticket != NO_ID else {}
        self._server.visitors.remove({visitor}, rows, approval=True)
        self._server.door.new_code(now.ms)
        return self._out({visitor}, EndReason.REMOVED, now)

    def everybody_out(self, now: Now) -> list[ServerEvent]:
        """Remove all visitors except operators, and change the code. Tickets stay valid."""
        gone = {each.id for each in self._server.visitors if each.role is not Role.OPERATE}
        self._server.visitors.remove(gone, approval=True)
        self._server.door.new_code(now.ms)
        return self._out(gone, EndReason.NEW_CODE, now)

    def new_code(self, now: Now) -> None:
        """Replace the open code and the room code; the old ones are refused at once. Visitors stay connected."""
        self._server.door.new_code(now.ms)

    def open_door(self) -> None:
        """Admit newcomers without approval again; visitors that wait already still need it."""
        self._server.visitors.set_approval(approval=False)

    def close_door(self) -> None:
        """Make newcomers wait for approval."""
        self._server.visitors.set_approval(approval=True)

    def approve(self, visitor: int, now: Now) -> list[ServerEvent]:
        """Admit a visitor that waits for approval. Raises: UsageError: no such visitor."""
        known = self._server.visitors.change(replace(self._known(visitor), waiting=False))
        self._server.assignment.arrive(known, now.ms)
        return [*self._server.send_to_visitor(visitor, *self._server.updates.epochs()), *self._server.standings(now)]

    def set_role(self, visitor: int, role: Role, now: Now) -> list[ServerEvent]:
        """Set a visitor's role to WATCH or DRIVE. Raises: UsageError: no such visitor, or the role is OPERATE."""
        if role is Role.OPERATE:
            raise UsageError("a visitor cannot become an operator", "make an operator's ticket")
        known = self._server.visitors.change(replace(self._known(visitor), role=role))
        if role is Role.WATCH:
            self._server.assignment.leave(visitor, now.ms)
        self._server.assignment.arrive(known, now.ms)
        return self._server.standings(now)

    def give(self, robot: str, visitor: int, now: Now) -> list[ServerEvent]:
        """Assign a robot to a visitor. Raises: UsageError: no visitor; NotAllowed: `Assignment.check_may_drive`."""
        self._server.assignment.give(robot, self._known(visitor), now.ms)
        return self._server.standings(now)

    def take(self, robot: str, now: Now) -> list[ServerEvent]:
        """Free a robot. Raises: NotAllowed: no such robot."""
        self._server.assignment.take(robot, now.ms)
        return self._server.standings(now)

    def swap(self, first: str, second: str, now: Now) -> list[ServerEvent]:
        """Exchange the drivers of two robots. Raises: NotAllowed: no such robot, or a driver may not drive it."""
        assignment = self._server.assignment
        for robot, other in ((first, second), (second, first)):
            driver = self._server.visitors.find(assignment.driver_of(robot, now.ms) or 0)
            if driver:
                assignment.check_may_drive(driver, other)
        assignment.swap(first, second)
        return self._server.standings(now)

    def _out(self, gone: set[int], reason: EndReason, now: Now) -> list[ServerEvent]:
        """End the sessions of removed visitors, and begin an epoch whose key they do not get."""
        server, events = self._server, list[ServerEvent]()
        for visitor in sorted(gone):
            connection = server.connections.of_visitor(visitor)
            if connection:
                events += server.end(connection, reason, now)
            server.forget(visitor, now)
        epoch = server.updates.begin(now.ms)
        return [*events, *server.send_to_all_visitors(epoch), *server.standings(now)]

    def _known(self, visitor: int) -> Visitor:
        known = self._server.visitors.find(visitor)
        if known is None:
            raise UsageError(f"no visitor {visitor}", "see the list of visitors for their numbers")
        return known
