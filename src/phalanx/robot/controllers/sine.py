"""Reproducible sine and cosine: libm's last bits differ between machines, and audits of honest robots would fail."""

from __future__ import annotations

from phalanx.kernel import kernel

HALF_PI = 1.5707963267948966
RAD_PER_DEG = 0.017453292519943295


@kernel
def sine(angle_rad: float) -> float:
    """Return the sine of an angle within +-pi/2, to 1e-15; other angles give wrong results."""
    z, rest = angle_rad * angle_rad, 1.0
    for n in range(20, 0, -2):  # the Taylor series, from its last term
        rest = 1.0 - z / (n * (n + 1)) * rest
    return angle_rad * rest


@kernel
def sine_cosine(angle_deg: float) -> tuple[float, float]:
    """Return sine and cosine of an angle within +-10^6 degrees, to 1e-14; quarter turns are subtracted exactly."""
    quarters = int(angle_deg / 90.0 + (0.5 if angle_deg >= 0.0 else -0.5))
    angle_rad = (angle_deg - 90.0 * quarters) * RAD_PER_DEG
    half = sine(angle_rad * 0.5)
    sin, cos = sine(angle_rad), 1.0 - 2.0 * half * half
    quarter = quarters & 3
    if quarter == 0:
        return sin, cos
    if quarter == 1:
        return cos, -sin
    if quarter == 2:
        return -sin, -cos
    return -cos, sin
