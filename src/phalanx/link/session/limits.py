"""Limits: rates of one visitor, tries of room codes. Their memory is bounded, whatever comes."""

from __future__ import annotations

from collections import OrderedDict, deque

from phalanx.config.session import SessionConfig

from .errors import TooMany, TriesUsedUp

HOUR_MS = 3_600_000
ROUTES_PER_S = 2  # of a visitor, for each robot
ROUTE_POINTS = 64
ROBOTS_REMEMBERED = 64  # of a visitor's routes


class Bucket:
    """Tokens that come back at a rate, up to a burst of one second's."""

    __slots__ = ("_per_s", "_then_ms", "_tokens")

    def __init__(self, per_s: int, now_ms: int) -> None:
        self._per_s, self._tokens, self._then_ms = per_s, float(per_s), now_ms

    def take(self, now_ms: int) -> bool:
        """Take a token; return whether there was one."""
        passed = max(0, now_ms - self._then_ms)
        self._tokens = min(float(self._per_s), self._tokens + passed * self._per_s / 1000)
        self._then_ms = max(self._then_ms, now_ms)
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True


class Caps:
    """What one visitor may send."""

    __slots__ = ("_commands", "_requests", "_routes")

    def __init__(self, config: SessionConfig, now_ms: int) -> None:
        self._commands = Bucket(config.commands_per_s, now_ms)
        self._requests = Bucket(config.requests_per_s, now_ms)
        self._routes: OrderedDict[str, Bucket] = OrderedDict()

    def command(self, now_ms: int) -> None:
        """Count a command. Raises: TooMany."""
        if not self._commands.take(now_ms):
            raise TooMany("commands of this visitor")

    def request(self, now_ms: int) -> None:
        """Count a request. Raises: TooMany."""
        if not self._requests.take(now_ms):
            raise TooMany("requests of this visitor")

    def route(self, robot: str, points: int, now_ms: int) -> None:
        """Count a route. Raises: TooMany: too many for this robot, or too many points."""
        if points > ROUTE_POINTS:
            raise TooMany(f"a route of {points} points, limit {ROUTE_POINTS}")
        if robot not in self._routes:
            # A forgotten robot's bucket is full again: the cap on commands bounds what that is worth.
            if len(self._routes) >= ROBOTS_REMEMBERED:
                self._routes.popitem(last=False)
            self._routes[robot] = Bucket(ROUTES_PER_S, now_ms)
        if not self._routes[robot].take(now_ms):
            raise TooMany("routes of this visitor for this robot")


class RoomTries:
    """Tries of room codes in the last hour. Those that admitted somebody do not count: fifty phones have one router."""

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self._tries: deque[tuple[int, str]] = deque()

    def count(self, address: str, now_ms: int) -> None:
        """Count a try. Raises: TriesUsedUp."""
        while self._tries and now_ms - self._tries[0][0] >= HOUR_MS:
            self._tries.popleft()
        if len(self._tries) >= self._config.room_tries:
            raise TriesUsedUp("room codes, from all addresses")
        if sum(each == address for _, each in self._tries) >= self._config.room_tries_per_address:
            raise TriesUsedUp("room codes, from this address")
        self._tries.append((now_ms, address))

    def forgive(self, address: str) -> None:
        """Forget the last try of an address: it admitted somebody."""
        for at in range(len(self._tries) - 1, -1, -1):
            if self._tries[at][1] == address:
                del self._tries[at]
                return
