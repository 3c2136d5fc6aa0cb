"""Parameters of the guard: the limits of speed and place that robots keep, whatever their planner advises."""

from __future__ import annotations

from dataclasses import dataclass, field

from phalanx.errors import UsageError

from .flock import FARTHEST_M, Box, Disc
from .parameter import check_key, check_limits, check_within, description, within

Point = tuple[float, float]
Polygon = tuple[Point, ...]
MOST_CORNERS = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardConfig:
    """Parameters of the guard: its envelope, and its assumptions about radio and timing.

    Raises: UsageError: a value is out of range, or two contradict each other. Source: docs/guides/guard.md.
    """

    speed_mps: float = within(2.0, 0.01, 50.0, "largest speed of any robot; robots rely on it when they predict others")
    accel_mps2: float = within(2.0, 0.01, 5.0, "largest acceleration of a command; brakes are as strong")
    turn_radps: float = within(0.0, 0.0, 50.0, "largest turn rate of the velocity; 0: limited by accel_mps2 only")
    apart_m: float = within(1.5, 0.0, 1e3, "smallest distance between centres of robots")
    clear_m: float = within(0.75, 0.0, 1e3, "smallest distance from a robot's centre to a fence or an obstacle")
    fences: tuple[Polygon, ...] = field(
        default=(), metadata=description("polygons, corners in metres; robots start in one and never cross a side")
    )
    keep_out: tuple[Polygon, ...] = field(
        default=(), metadata=description("polygons, corners in metres; robots start outside and never cross a side")
    )
    advice_ms: int = within(1000, 20, 60_000, "age after which advice is ignored and the robot brakes")
    radio_ms: int = within(250, 0, 10_000, "largest age of a broadcast when it is received")
    promise_ms: int = within(5000, 100, 60_000, "how long a broadcast binds the velocity of its sender")
    forget_ms: int = within(
        9000,
        100,
        3_600_000,
        "silence after which a neighbour is forgotten; robots also listen for this time before they first move",
    )
    adviser_key: str = field(
        default="",
        metadata=description(
            "public Ed25519 key of the only adviser, 64 hexadecimal digits; empty: any planner's advice is accepted"
        ),
    )
    mission: int = within(1, 1, 2**32 - 1, "number of the mission key; advice for other missions is ignored")
    n_max: int = within(24, 1, 1024, "neighbours that a robot stores")
    state_every: int = within(6, 1, 1000, "control steps per state broadcast")
    period_ms: int = within(250, 20, 10_000, "control period, as in BtiConfig")
    delta_ms: int = within(100, 1, 1000, "largest delay of a reading and of a command, as in BtiConfig")
    discs: tuple[Disc, ...] = ()  # obstacles
    boxes: tuple[Box, ...] = ()

    def __post_init__(self) -> None:
        check_limits(self)
        check_key("adviser_key", self.adviser_key)
        slower = self.speed_mps - 2.0 * self.accel_mps2 * self.delta_ms / 1000
        if slower <= 0.0:
            raise UsageError(
                f"accel_mps2 is {self.accel_mps2:g}: a command that is {self.delta_ms} ms late could exceed "
                f"speed_mps, {self.speed_mps:g} m/s",
                "use an accel_mps2 below speed_mps / (2 delta_ms)",
            )
        for name, polygons in (("fences", self.fences), ("keep_out", self.keep_out)):
            for polygon in polygons:
                if not 3 <= len(polygon) <= MOST_CORNERS:
                    raise UsageError(f"{name} has a polygon of {len(polygon)} corners", f"3 to {MOST_CORNERS}")
                for corner in polygon:
                    for value in corner:
                        check_within(f"a corner of {name}", value, -FARTHEST_M, FARTHEST_M)

    def check_start(self, point: Point) -> None:
        """Check a start point. Raises: UsageError: outside the fences, in a keep-out area, or too near to an edge."""
        x, y = point
        if self.fences and not any(_inside(point, polygon) for polygon in self.fences):
            raise UsageError(f"a robot starts at ({x:g}, {y:g}), outside its fences", "start inside one of the fences")
        solid = [*self.keep_out, *(_corners(box) for box in self.boxes)]
        if any(_inside(point, polygon) for polygon in solid):
            raise UsageError(f"a robot starts at ({x:g}, {y:g}), in a keep-out area", "start outside of it")
        near = min((_distance(point, polygon) for polygon in (*self.fences, *solid)), default=FARTHEST_M)
        for disc in self.discs:
            near = min(near, ((x - disc.x_m) ** 2 + (y - disc.y_m) ** 2) ** 0.5 - disc.radius_m)
        if near < self.clear_m:
            raise UsageError(
                f"a robot starts at ({x:g}, {y:g}), {near:.2g} m from an edge",
                f"start at least clear_m away: {self.clear_m:g}",
            )

    def walls(self) -> list[tuple[float, float, float, float]]:
        """Return all sides that robots must not cross: x and y of both ends, metres."""
        polygons = [*self.fences, *self.keep_out, *(_corners(box) for box in self.boxes)]
        return [(*a, *b) for polygon in polygons for a, b in _sides(polygon)]


def _corners(box: Box) -> Polygon:
    left, bottom, right, top = box.left_m, box.bottom_m, box.right_m, box.top_m
    return ((left, bottom), (right, bottom), (right, top), (left, top))


def _sides(polygon: Polygon) -> list[tuple[Point, Point]]:
    return list(zip(polygon, (*polygon[1:], polygon[0]), strict=True))


def _inside(point: Point, polygon: Polygon) -> bool:
    """Return whether the point is inside: a ray from it to the right crosses an odd number of sides."""
    x, y = point
    odd = False
    for (ax, ay), (bx, by) in _sides(polygon):
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


def _distance(point: Point, polygon: Polygon) -> float:
    nearest = FARTHEST_M
    for (ax, ay), (bx, by) in _sides(polygon):
        dx, dy = bx - ax, by - ay
        long = dx * dx + dy * dy
        share = ((point[0] - ax) * dx + (point[1] - ay) * dy) / long if long > 0 else 0.0
        share = min(1.0, max(0.0, share))
        x, y = ax + share * dx - point[0], ay + share * dy - point[1]
        nearest = min(nearest, (x * x + y * y) ** 0.5)
    return nearest
