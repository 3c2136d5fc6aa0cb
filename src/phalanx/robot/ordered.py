"""Robots that obey signed orders over a radio: the methods that simulated and real swarms of them share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

from phalanx.errors import UsageError

from .controllers import orders
from .roster import Member, Roster
from .station import COLOUR, MOTION, Station
from .swarm import Led, Point


class Ordered(Roster):
    """A swarm's members, who obey one station; the robot of a row is the one of that id in `ids`."""

    def __init__(self, members: Iterable[Member], ids: Sequence[int], station: Station) -> None:
        super().__init__(members)
        self._ids, self._station = ids, station

    @property
    def longest_route(self) -> int:
        """Most points of a route."""
        return orders.WAYPOINTS_MAX

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels for 300 ms; ends waypoint following."""
        i = self._find(address)
        self._members[i].route = ()
        left, right = max(-100, min(100, left_pct)), max(-100, min(100, right_pct))
        self._tell(i, MOTION, partial(self._station.gateway.wheels, left_pct=left, right_pct=right))

    def hold(self) -> None:
        """All that do not lie stand still until `release`: the operator says so to all, before all else, and again."""
        self._station.held = True
        for each in self._members:
            each.route = ()

    def release(self) -> None:
        """They may be driven again."""
        self._station.release()

    def set_led(self, address: str, led: Led) -> None:
        """Show a colour."""
        self._show(self._find(address), led)

    def _show(self, i: int, led: Led) -> None:
        self._tell(i, COLOUR, partial(self._station.gateway.led, red=led.red, green=led.green, blue=led.blue))

    def _follow(self, i: int, route: Sequence[Point], threshold_mm: float, here: Point) -> None:
        """Robot i, which is `here`, is to visit these points. Raises: UsageError: more than `longest_route`."""
        if len(route) > self.longest_route:
            raise UsageError(f"a route of {len(route)} points", f"at most {self.longest_route}")
        points = [(round(point.x_mm), round(point.y_mm)) for point in route]
        near = round(min(max(threshold_mm, 1), orders.THRESHOLD_MAX_MM))
        self._tell(i, MOTION, partial(self._station.gateway.route, threshold_mm=near, points_mm=points))
        self._members[i].route = (here, *route) if route else ()
        self._members[i].threshold_mm = threshold_mm

    def _tell(self, i: int, kind: int, make: partial[bytes]) -> None:
        self._station.tell(self._ids[i], kind, make)
