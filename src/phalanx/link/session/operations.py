"""What an operator does with visitors: remove, approve, change codes and roles, give and take robots.

Each change is written before its events are carried out.
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
    """The operator's hands on a server; the caller has checked that it is one."""

    def __init__(self, server: SessionServer) -> None:
        self._server = server

    def remove(self, visitor: int, now: Now) -> list[ServerEvent]:
        """End a visitor's session for good: its secrets and its ticket die, the code and the epoch change.

        Newcomers wait for approval from now on, as the same person may scan the new code. Raises: UsageError.
        """
        known = self._known(visitor)
        rows = self._server.door.revoke_ticket(known.ticket) if known.ticket != NO_ID else {}
        self._server.visitors.remove({visitor}, rows, approval=True)
        self._server.door.new_code(now.ms)
        return self._out({visitor}, EndReason.REMOVED, now)

    def everybody_out(self, now: Now) -> list[ServerEvent]:
        """Remove all visitors but operators, whom no code admits, and change the code. Tickets stay valid."""
        gone = {each.id for each in self._server.visitors if each.role is not Role.OPERATE}
        self._server.visitors.remove(gone, approval=True)
        self._server.door.new_code(now.ms)
        return self._out(gone, EndReason.NEW_CODE, now)

    def new_code(self, now: Now) -> None:
        """Change the open code and the room code; those before are refused at once. Nobody who is here must leave."""
        self._server.door.new_code(now.ms)

    def open_door(self) -> None:
        """Admit newcomers without approval again; who waits still does."""
        self._server.visitors.set_approval(approval=False)

    def close_door(self) -> None:
        """Let newcomers wait for approval."""
        self._server.visitors.set_approval(approval=True)

    def approve(self, visitor: int, now: Now) -> list[ServerEvent]:
        """Admit a visitor that waits. Raises: UsageError."""
        known = self._server.visitors.change(replace(self._known(visitor), waiting=False))
        self._server.assignment.arrive(known, now.ms)
        return [*self._server.tell(visitor, *self._server.updates.epochs()), *self._server.standings(now)]

    def set_role(self, visitor: int, role: Role, now: Now) -> list[ServerEvent]:
        """Let a visitor only watch, or drive again; its view stays. Raises: UsageError: not by making an operator."""
        if role is Role.OPERATE:
            raise UsageError("nobody is made an operator", "make an operator's ticket")
        known = self._server.visitors.change(replace(self._known(visitor), role=role))
        if role is Role.WATCH:
            self._server.assignment.leave(visitor, now.ms)
        self._server.assignment.arrive(known, now.ms)
        return self._server.standings(now)

    def give(self, robot: str, visitor: int, now: Now) -> list[ServerEvent]:
        """Assign a robot to a visitor. Raises: UsageError; NotAllowed: no such robot, or none that it may drive."""
        self._server.assignment.give(robot, self._known(visitor), now.ms)
        return self._server.standings(now)

    def take(self, robot: str, now: Now) -> list[ServerEvent]:
        """Free a robot. Raises: NotAllowed: no such robot."""
        self._server.assignment.take(robot, now.ms)
        return self._server.standings(now)

    def swap(self, first: str, second: str, now: Now) -> list[ServerEvent]:
        """Exchange the drivers of two robots. Raises: NotAllowed: no such robot, or none that a driver may have."""
        assignment = self._server.assignment
        for robot, other in ((first, second), (second, first)):
            driver = self._server.visitors.find(assignment.driver_of(robot, now.ms) or 0)
            if driver:
                assignment.suits(driver, other)
        assignment.swap(first, second)
        return self._server.standings(now)

    def _out(self, gone: set[int], reason: EndReason, now: Now) -> list[ServerEvent]:
        """End the sessions of those who were removed, and begin an epoch whose key they do not get."""
        server, events = self._server, list[ServerEvent]()
        for visitor in sorted(gone):
            connection = server.connections.of_visitor(visitor)
            if connection:
                events += server.end(connection, reason, now)
            server.forget(visitor, now)
        epoch = server.updates.begin(now.ms)
        return [*events, *server.tell_all(epoch), *server.standings(now)]

    def _known(self, visitor: int) -> Visitor:
        known = self._server.visitors.find(visitor)
        if known is None:
            raise UsageError(f"no visitor {visitor}", "the list has their numbers")
        return known
