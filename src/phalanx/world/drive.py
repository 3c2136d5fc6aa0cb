"""Kinematics of a differential drive, for the demo's robots, protected or not, and for robots on missions.

Collisions with walls and frames of coordinates are left to each simulator, because their units and frames differ.
"""

from __future__ import annotations

from phalanx.kernel import kernel

# The demo's robots.
BODY_M = 0.04  # radius: least distance of the centre from a wall
AXLE_M = 0.075
TOP_SPEED_MPS = 0.3  # of a wheel at 100 %


def turned(left: float, right: float, axle: float, dt_s: float) -> tuple[float, float]:
    """Return the distance driven by the centre and the turn to the right, in radians, during `dt_s`.

    The wheels' speeds (numbers or arrays) and `axle`, the distance between the wheels, use the same unit of length.
    Source: geometry of a differential drive.
    """
    return (left + right) / 2 * dt_s, (left - right) / axle * dt_s


turned_kernel = kernel(turned)
