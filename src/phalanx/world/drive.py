"""How two driven wheels move a robot: one law for the demo's robots, protected or not, and for those on missions.

What walls do, and where a robot then is, is each world's own affair: their units and frames differ.
"""

from __future__ import annotations

from phalanx.kernel import kernel

# The demo's robots.
BODY_M = 0.04  # radius: how near to the wall the middle can come
AXLE_M = 0.075
TOP_SPEED_MPS = 0.3  # of a wheel at 100 %


def turned(left: float, right: float, axle: float, dt_s: float) -> tuple[float, float]:
    """(way ahead of the middle, radians from the left wheel's side to the right's) of a robot in `dt_s`.

    The wheels' speeds, numbers or arrays, and `axle`, from wheel to wheel, are of one unit of length.
    Source: geometry of a differential drive.
    """
    return (left + right) / 2 * dt_s, (left - right) / axle * dt_s


turned_kernel = kernel(turned)
