"""Rate limits: of each visitor, and joins and room code attempts of each address. Memory is bounded under any load."""

from __future__ import annotations

from collections import OrderedDict, deque

from phalanx.config.session import SessionConfig
from phalanx.pace import TokenBucket

from .errors import TooMany, TriesUsedUp

HOUR_MS = 3_600_000
ROUTES_PER_S = 2  # per visitor and robot
ROUTE_POINTS = 64
TRIES_REMEMBERED = 8  # budgets of a room code whose attempts are remembered
ROBOTS_REMEMBERED = 64  # robots per visitor with a route limit
ADDRESSES_REMEMBERED = 4096  # addresses with a join limit


class VisitorLimits:
    """Rate limits of one visitor, over all its connections."""

    __slots__ = ("_commands", "_handshakes", "_requests", "_routes")

    def __init__(self, config: SessionConfig, now_ms: int) -> None:
        now_s = now_ms / 1000
        self._commands = TokenBucket(config.commands_per_s, config.commands_per_s, now_s)
        self._requests = TokenBucket(config.requests_per_s, config.requests_per_s, now_s)
        self._handshakes = TokenBucket(config.handshakes_per_min / 60, config.handshakes_at_once, now_s)
        self._routes: OrderedDict[str, TokenBucket] = OrderedDict()

    def command(self, now_ms: int) -> None:
        """Count a command. Raises: TooMany."""
        if not self._commands.take(now_ms / 1000):
            raise TooMany("commands of this visitor")

    def request(self, now_ms: int) -> None:
        """Count a request. Raises: TooMany."""
        if not self._requests.take(now_ms / 1000):
            raise TooMany("requests of this visitor")

    def handshake(self, now_ms: int) -> None:
        """Count a handshake for new keys or a resumption, which each cost a write to disk. Raises: TooMany."""
        if not self._handshakes.take(now_ms / 1000):
            raise TooMany("handshakes of this visitor")

    def route(self, robot: str, points: int, now_ms: int) -> None:
        """Count a route. Raises: TooMany: too many for this robot, or too many points."""
        if points > ROUTE_POINTS:
            raise TooMany(f"a route of {points} points, limit {ROUTE_POINTS}")
        if robot not in self._routes:
            # Forgetting a robot resets its limit; the limit of commands still holds.
            if len(self._routes) >= ROBOTS_REMEMBERED:
                self._routes.popitem(last=False)
            self._routes[robot] = TokenBucket(ROUTES_PER_S, ROUTES_PER_S, now_ms / 1000)
        if not self._routes[robot].take(now_ms / 1000):
            raise TooMany("routes of this visitor for this robot")


class LimitsByVisitor:
    """Rate limits of all visitors; kept when a visitor leaves, or each new connection would allow a fresh burst."""

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._of: OrderedDict[int, VisitorLimits] = OrderedDict()

    def of(self, visitor: int, now_ms: int) -> VisitorLimits:
        """Return the rate limits of a visitor."""
        if visitor not in self._of:
            self.give(visitor, VisitorLimits(self._config, now_ms))
        self._of.move_to_end(visitor)
        return self._of[visitor]

    def give(self, visitor: int, caps: VisitorLimits) -> None:
        """Set the rate limits of a visitor that replaces another one."""
        self._of[visitor] = caps
        if len(self._of) > self._config.visitors_max:
            self._of.popitem(last=False)


class Joins:
    """Rate limit of joins without a ticket, per address. Of more addresses than fit, the oldest is reset."""

    def __init__(self, config: SessionConfig) -> None:
        self._per_hour = config.joins_per_address
        self._of: OrderedDict[str, TokenBucket] = OrderedDict()

    def count(self, address: str, now_ms: int) -> None:
        """Count a join. Raises: TooMany."""
        if address not in self._of:
            if len(self._of) >= ADDRESSES_REMEMBERED:
                self._of.popitem(last=False)
            self._of[address] = TokenBucket(self._per_hour / 3600, self._per_hour, now_ms / 1000)
        self._of.move_to_end(address)
        if not self._of[address].take(now_ms / 1000):
            raise TooMany("joins of this address")


class RoomCodeAttempts:
    """Attempts with room codes in the last hour. Successful ones do not count: fifty phones may share one router.

    Each code that an operator makes has a new budget, or twelve addresses could lock out all others for an hour. The
    limit of an address stays in force.
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._tries: deque[tuple[int, str]] = deque(maxlen=TRIES_REMEMBERED * config.room_tries)
        self._of_code = 0  # number of the newest attempts that count for the current code

    def begin(self) -> None:
        """Begin the budget of a code that an operator has just made."""
        self._of_code = 0

    def count(self, address: str, now_ms: int) -> None:
        """Count an attempt. Raises: TriesUsedUp."""
        while self._tries and now_ms - self._tries[0][0] >= HOUR_MS:
            self._tries.popleft()
        self._of_code = min(self._of_code, len(self._tries))
        if self._of_code >= self._config.room_tries:
            raise TriesUsedUp("too many attempts at room codes, from all addresses together")
        if sum(each == address for _, each in self._tries) >= self._config.room_tries_per_address:
            raise TriesUsedUp("too many attempts at room codes from this address")
        self._tries.append((now_ms, address))
        self._of_code += 1

    def forgive(self, address: str) -> None:
        """Remove the last attempt of an address: it was successful."""
        for at in range(len(self._tries) - 1, -1, -1):
            if self._tries[at][1] == address:
                self._of_code -= len(self._tries) - at <= self._of_code
                del self._tries[at]
                return
