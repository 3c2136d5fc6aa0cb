"""Angles without a libm: sine and cosine of small angles by polynomials, which every machine replays alike."""

from __future__ import annotations

import math

from phalanx.kernel import kernel

TWO_PI = 2.0 * math.pi
SMALL_RAD = 0.6  # up to here the polynomials are right to 1e-12


def wrap_rad(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return angle_rad - TWO_PI * math.floor((angle_rad + math.pi) / TWO_PI)


@kernel
def sin_cos_small(angle_rad: float) -> tuple[float, float]:
    """(sine, cosine) of an angle of at most SMALL_RAD."""
    assert abs(angle_rad) <= SMALL_RAD, "only corrections of a heading are turned by this"
    q = angle_rad * angle_rad
    sine = angle_rad * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))))
    cosine = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132)))))
    return sine, cosine


@kernel
def turn_about(x_m: float, y_m: float, centre_x_m: float, centre_y_m: float, angle_rad: float) -> tuple[float, float]:
    """The point turned about a centre, counter-clockwise; the angle at most SMALL_RAD."""
    sine, cosine = sin_cos_small(angle_rad)
    dx, dy = x_m - centre_x_m, y_m - centre_y_m
    return centre_x_m + (cosine * dx - sine * dy), centre_y_m + (sine * dx + cosine * dy)
