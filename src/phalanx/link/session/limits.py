"""Limits: rates of one visitor, joins and tries of one address. Their memory is bounded, whatever comes."""

from __future__ import annotations

from collections import OrderedDict, deque

from phalanx.config.session import SessionConfig
from phalanx.pace import Pace

from .errors import TooMany, TriesUsedUp

HOUR_MS = 3_600_000
ROUTES_PER_S = 2  # of a visitor, for each robot
ROUTE_POINTS = 64
TRIES_REMEMBERED = 8  # times as many as all have for one room code
ROBOTS_REMEMBERED = 64  # of a visitor's routes
ADDRESSES_REMEMBERED = 4096  # whose joins are counted


class Caps:
    """The rates of one visitor, whatever its connections."""

    __slots__ = ("_commands", "_handshakes", "_requests", "_routes")

    def __init__(self, config: SessionConfig, now_ms: int) -> None:
        now_s = now_ms / 1000
        self._commands = Pace(config.commands_per_s, config.commands_per_s, now_s)
        self._requests = Pace(config.requests_per_s, config.requests_per_s, now_s)
        self._handshakes = Pace(config.handshakes_per_min / 60, config.handshakes_at_once, now_s)
        self._routes: OrderedDict[str, Pace] = OrderedDict()

    def command(self, now_ms: int) -> None:
        """Count a command. Raises: TooMany."""
        if not self._commands.take(now_ms / 1000):
            raise TooMany("commands of this visitor")

    def request(self, now_ms: int) -> None:
        """Count a request. Raises: TooMany."""
        if not self._requests.take(now_ms / 1000):
            raise TooMany("requests of this visitor")

    def handshake(self, now_ms: int) -> None:
        """Count new keys or a resumption, of which each is written to disk. Raises: TooMany."""
        if not self._handshakes.take(now_ms / 1000):
            raise TooMany("handshakes of this visitor")

    def route(self, robot: str, points: int, now_ms: int) -> None:
        """Count a route. Raises: TooMany: too many for this robot, or too many points."""
        if points > ROUTE_POINTS:
            raise TooMany(f"a route of {points} points, limit {ROUTE_POINTS}")
        if robot not in self._routes:
            # A forgotten robot's pace is full again: the cap on commands bounds what that is worth.
            if len(self._routes) >= ROBOTS_REMEMBERED:
                self._routes.popitem(last=False)
            self._routes[robot] = Pace(ROUTES_PER_S, ROUTES_PER_S, now_ms / 1000)
        if not self._routes[robot].take(now_ms / 1000):
            raise TooMany("routes of this visitor for this robot")


class AllCaps:
    """The caps of each visitor: they stay when it leaves, or each connection would bring a fresh burst."""

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._of: OrderedDict[int, Caps] = OrderedDict()

    def of(self, visitor: int, now_ms: int) -> Caps:
        """Return a visitor's caps."""
        if visitor not in self._of:
            self.give(visitor, Caps(self._config, now_ms))
        self._of.move_to_end(visitor)
        return self._of[visitor]

    def give(self, visitor: int, caps: Caps) -> None:
        """Let a visitor have these caps, as it takes another's place."""
        self._of[visitor] = caps
        if len(self._of) > self._config.visitors_max:
            self._of.popitem(last=False)


class Joins:
    """Joins without a ticket, of each address. An address that was forgotten may begin anew."""

    def __init__(self, config: SessionConfig) -> None:
        self._per_hour = config.joins_per_address
        self._of: OrderedDict[str, Pace] = OrderedDict()

    def count(self, address: str, now_ms: int) -> None:
        """Count a join. Raises: TooMany."""
        if address not in self._of:
            if len(self._of) >= ADDRESSES_REMEMBERED:
                self._of.popitem(last=False)
            self._of[address] = Pace(self._per_hour / 3600, self._per_hour, now_ms / 1000)
        self._of.move_to_end(address)
        if not self._of[address].take(now_ms / 1000):
            raise TooMany("joins of this address")


class RoomTries:
    """Tries of room codes in the last hour. Those that admitted somebody do not count: fifty phones have one router.

    The code that an operator makes has a budget of its own, or twelve addresses could keep all others out for an hour.
    An address that has used up its own waits nevertheless.
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._tries: deque[tuple[int, str]] = deque(maxlen=TRIES_REMEMBERED * config.room_tries)
        self._of_code = 0  # the newest so many are of the code that is shown

    def begin(self) -> None:
        """Begin the budget of a code that an operator has made."""
        self._of_code = 0

    def count(self, address: str, now_ms: int) -> None:
        """Count a try. Raises: TriesUsedUp."""
        while self._tries and now_ms - self._tries[0][0] >= HOUR_MS:
            self._tries.popleft()
        self._of_code = min(self._of_code, len(self._tries))
        if self._of_code >= self._config.room_tries:
            raise TriesUsedUp("room codes, from all addresses")
        if sum(each == address for _, each in self._tries) >= self._config.room_tries_per_address:
            raise TriesUsedUp("room codes, from this address")
        self._tries.append((now_ms, address))
        self._of_code += 1

    def forgive(self, address: str) -> None:
        """Forget the last try of an address: it admitted somebody."""
        for at in range(len(self._tries) - 1, -1, -1):
            if self._tries[at][1] == address:
                self._of_code -= len(self._tries) - at <= self._of_code
                del self._tries[at]
                return
