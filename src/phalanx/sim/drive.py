"""How two driven wheels move a robot: one law for the demo's robots, protected or not, and for those on missions.

What walls do, and where a robot then is, is each world's own affair: their units and frames differ.
"""

from __future__ import annotations

from typing import Any

from phalanx.kernel import kernel


def turned(left: Any, right: Any, axle: Any, dt_s: Any) -> Any:
    """(way ahead, turn) of a robot whose wheels turn for a moment.

    Args:
        left: speed of the left wheel, any unit of length a second; a number or an array.
        right: of the right one.
        axle: from wheel to wheel, the same unit.
        dt_s: how long.
    Returns: the way of the middle, and radians from the left wheel's side to the right's.
    Source: geometry of a differential drive.
    """
    return (left + right) / 2 * dt_s, (left - right) / axle * dt_s


turned_kernel = kernel(turned)
