"""The robots of a swarm as visitors see them: addresses, names, colours, routes, trails."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from phalanx.errors import Unknown

from .swarm import Led, Point, Robot

HISTORY = 1000
HISTORY_STEP_MM = 20.0
DEFAULT_THRESHOLD_MM = 60.0
# Short names that sound different when called out across a room.
NAMES = (
    "Ada Bo Cleo Dot Eli Fay Gus Hal Ivy Jo Kit Lou Mia Ned Oz Pip Quin Rae Sol Tess Uma Vic Wren Xan Yara Zed "
    "Ash Bea Cy Dee Emi Fox Gia Hugo Ines Juno Kai Lara Max Nova Opal Pax Remy Sky Tao Una Vera Wes Yui Zoe"
).split()
COLOURS = (
    Led(230, 57, 70),
    Led(244, 140, 6),
    Led(250, 210, 60),
    Led(82, 183, 136),
    Led(42, 157, 217),
    Led(94, 96, 206),
    Led(200, 90, 200),
    Led(120, 190, 210),
)


@dataclass(slots=True)
class Member:
    """One robot of a swarm: all its properties except position and battery."""

    address: str
    name: str
    led: Led
    route: tuple[Point, ...] = ()
    threshold_mm: float = DEFAULT_THRESHOLD_MM
    history: deque[Point] = field(default_factory=lambda: deque(maxlen=HISTORY))

    def snapshot(self, at: Point, direction_deg: int, battery_v: float, heard_at_s: float) -> Robot:
        """Return the robot with its current position, direction and battery voltage."""
        rest = self.led, self.route, self.threshold_mm, heard_at_s, self.history
        return Robot(self.address, self.name, at, direction_deg % 360, battery_v, *rest)

    def append_position(self, x_mm: float, y_mm: float, step_mm: float) -> None:
        """Append a point to the trail if it is at least a step away from the last one."""
        last = self.history[-1] if self.history else None
        if last is None or (x_mm - last.x_mm) ** 2 + (y_mm - last.y_mm) ** 2 >= step_mm**2:
            self.history.append(Point(round(x_mm, 1), round(y_mm, 1)))


def member(nth: int) -> Member:
    """Return a new member; its address and name are unique for each number from 0."""
    again = f" {nth // len(NAMES) + 1}" if nth >= len(NAMES) else ""
    return Member(f"DECAFBAD{nth + 1:08X}", NAMES[nth % len(NAMES)] + again, COLOURS[nth % len(COLOURS)])


class Roster:
    """Table of a swarm's members, looked up by address."""

    def __init__(self, members: Iterable[Member]) -> None:
        self._members = list(members)
        self._number_rows()

    def set_led(self, address: str, led: Led) -> None:
        """Set the colour of the LED."""
        self._members[self._find(address)].led = led

    def clear_history(self, address: str) -> None:
        """Clear the trail of a robot."""
        self._members[self._find(address)].history.clear()

    def _find(self, address: str) -> int:
        row = self._rows.get(address)
        if row is None:
            raise Unknown(f"no robot {address[:64]!r}")
        return row

    def _number_rows(self) -> None:
        self._rows = {each.address: i for i, each in enumerate(self._members)}
