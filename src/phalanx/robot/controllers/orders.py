"""What a gateway tells robots that visitors drive, as radio frames.

The record `order` of phalanx.wire.table, whose body is an `order_wheels`, an `order_led` or an `order_route`. A robot
obeys a frame with its id and a number above the last that it obeyed, so that a frame heard twice counts once.
"""

from __future__ import annotations

from collections.abc import Sequence

from phalanx.errors import UsageError
from phalanx.wire.record import Record, Value
from phalanx.wire.table import ORDER, ORDER_LED, ORDER_ROUTE, ORDER_WHEELS, TELL_LED, TELL_ROUTE, TELL_WHEELS, WAYPOINT

ID, NUMBER, ACTION, BODY = map(ORDER.at, ("id", "number", "action", "body"))
COUNT, POINTS = (BODY + ORDER_ROUTE.at(name) for name in ("count", "points"))
WHEELS_BYTES = ORDER_WHEELS.size
POINT_X, POINT_Y = map(WAYPOINT.at, ("x_mm", "y_mm"))
POINT_BYTES = WAYPOINT.size
WAYPOINTS_MAX = 32
THRESHOLD_MAX_MM = 1000


def wheels_order(robot: int, number: int, left_pct: int, right_pct: int) -> bytes:
    """Turn the wheels for a moment, -100..100; ends waypoint following. `number` is above the last one sent to `robot`.

    Raises: UsageError: a value is out of range. Source: docs/spec/vocabulary.md.
    """
    return _order(robot, number, TELL_WHEELS, ORDER_WHEELS, left=left_pct, right=right_pct)


def led_order(robot: int, number: int, red: int, green: int, blue: int) -> bytes:
    """Show a colour, 0..255 each; otherwise like `wheels_order`. Source: docs/spec/vocabulary.md."""
    return _order(robot, number, TELL_LED, ORDER_LED, red=red, green=green, blue=blue)


def route_order(robot: int, number: int, threshold_mm: int, points_mm: Sequence[tuple[int, int]]) -> bytes:
    """Visit at most 32 points in order, each reached within 1..1000 mm; otherwise like `wheels_order`.

    Source: docs/spec/vocabulary.md.
    """
    if len(points_mm) > WAYPOINTS_MAX or not 1 <= threshold_mm <= THRESHOLD_MAX_MM:
        raise UsageError(
            f"a route of {len(points_mm)} points within {threshold_mm} mm",
            f"at most {WAYPOINTS_MAX} points, 1 to {THRESHOLD_MAX_MM} mm",
        )
    points = b"".join(WAYPOINT.encode(x_mm=x_mm, y_mm=y_mm) for x_mm, y_mm in points_mm)
    return _order(
        robot, number, TELL_ROUTE, ORDER_ROUTE, threshold_mm=threshold_mm, count=len(points_mm), points=points
    )


def _order(robot: int, number: int, action: int, body: Record, **values: Value) -> bytes:
    if robot < 1 or number < 1:
        raise UsageError(f"order {number} for robot {robot}", "both count from 1")
    return ORDER.encode(id=robot, number=number, action=action, body=body.encode(**values))
