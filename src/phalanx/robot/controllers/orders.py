"""What a gateway tells robots that visitors drive, as radio frames.

The record `order` (phalanx.wire.table), whose body is, little-endian:

| action | body |
|---|---|
| 1 wheels | left i8, right i8: percent |
| 2 LED | red, green, blue u8 |
| 3 route | threshold u16 (mm), n u8, n times x u16, y u16 (mm); n = 0 stops |

A robot obeys a frame with its id and a number above the last that it obeyed, so that a frame heard twice counts once.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from phalanx.errors import UsageError
from phalanx.wire.table import ORDER

WHEELS, LED, ROUTE = 1, 2, 3
ID, NUMBER, ACTION, BODY = map(ORDER.offset, ("id", "number", "action", "body"))
POINTS = BODY + 3
POINT_BYTES = 4
WAYPOINTS_MAX = 32
THRESHOLD_MAX_MM = 1000


def wheels_order(robot: int, number: int, left_pct: int, right_pct: int) -> bytes:
    """Turn the wheels for a moment; ends waypoint following.

    Args:
        robot: 1..65535.
        number: 1..2^32 - 1, above the last one sent to this robot.
        left_pct: -100..100.
        right_pct: the same.
    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md.
    """
    return _order(robot, number, WHEELS, "bb", left_pct, right_pct)


def led_order(robot: int, number: int, red: int, green: int, blue: int) -> bytes:
    """Show a colour, 0..255 each; otherwise like `wheels_order`. Source: docs/spec/vocabulary.md."""
    return _order(robot, number, LED, "3B", red, green, blue)


def route_order(robot: int, number: int, threshold_mm: int, points_mm: Sequence[tuple[int, int]]) -> bytes:
    """Visit at most 32 points in order, each reached within 1..1000 mm; otherwise like `wheels_order`.

    Source: docs/spec/vocabulary.md.
    """
    if len(points_mm) > WAYPOINTS_MAX or not 1 <= threshold_mm <= THRESHOLD_MAX_MM:
        raise UsageError(
            f"a route of {len(points_mm)} points within {threshold_mm} mm",
            f"at most {WAYPOINTS_MAX} points, 1 to {THRESHOLD_MAX_MM} mm",
        )
    flat = [length for point in points_mm for length in point]
    return _order(robot, number, ROUTE, f"HB{len(flat)}H", threshold_mm, len(points_mm), *flat)


def _order(robot: int, number: int, action: int, form: str, *values: int) -> bytes:
    if robot < 1 or number < 1:
        raise UsageError(f"order {number} for robot {robot}", "both count from 1")
    try:
        body = struct.pack(f"<{form}", *values)
    except struct.error as error:
        raise UsageError(f"order {number} for robot {robot}: {error}") from error
    return ORDER.encode(id=robot, number=number, action=action, body=body)
