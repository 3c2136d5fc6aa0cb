"""Sine, cosine and arctangent by polynomials instead of libm, so that all machines compute the same bits in a replay.

The coefficients are those of FreeBSD's msun (k_sin.c, k_cos.c, s_atan.c); results are within 2e-15 of the true values
for angles up to a thousand turns.
"""

from __future__ import annotations

import math

from phalanx.kernel import kernel

PI = math.pi
TWO_PI = 2.0 * math.pi
HALF_PI = 0.5 * math.pi
# Half pi in two parts: the first has its low bits zero, so that small multiples of it are exact.
_HALF_PI_HIGH = 1.57079632673412561417e00
_HALF_PI_LOW = 6.07710050650619224932e-11
_ATAN_HALF = 4.63647609000806093515e-01
_ATAN_ONE = 7.85398163397448278999e-01


@kernel
def _nearest(x: float) -> int:
    return int(x + 0.5) if x >= 0.0 else -int(0.5 - x)


@kernel
def sin_cos(angle_rad: float) -> tuple[float, float]:
    """Return (sine, cosine) of an angle within a thousand turns."""
    quarter = _nearest(angle_rad * (1.0 / HALF_PI))
    x = (angle_rad - quarter * _HALF_PI_HIGH) - quarter * _HALF_PI_LOW
    q = x * x
    s = 1.58969099521155010221e-10
    s = -2.50507602534068634195e-08 + q * s
    s = 2.75573137070700676789e-06 + q * s
    s = -1.98412698298579493134e-04 + q * s
    s = 8.33333333332248946124e-03 + q * s
    s = -1.66666666666666324348e-01 + q * s
    sine = x + x * q * s
    c = -1.13596475577881948265e-11
    c = 2.08757232129817482790e-09 + q * c
    c = -2.75573143513906633035e-07 + q * c
    c = 2.48015872894767294178e-05 + q * c
    c = -1.38888888888741095749e-03 + q * c
    c = 4.16666666666666019037e-02 + q * c
    cosine = 1.0 - 0.5 * q + q * q * c
    turn = quarter % 4
    if turn == 0:
        return sine, cosine
    if turn == 1:
        return cosine, -sine
    if turn == 2:
        return -sine, -cosine
    return -cosine, sine


@kernel
def _arctangent(x: float) -> float:
    """Return the arctangent of x in [0, 1]."""
    if x < 0.4375:
        base, y = 0.0, x
    elif x < 0.6875:
        base, y = _ATAN_HALF, (2.0 * x - 1.0) / (2.0 + x)
    else:
        base, y = _ATAN_ONE, (x - 1.0) / (x + 1.0)
    q = y * y
    p = 1.62858201153657823623e-02
    p = -3.65315727442169155270e-02 + q * p
    p = 4.97687799461593236017e-02 + q * p
    p = -5.83357013379057348645e-02 + q * p
    p = 6.66107313738753120669e-02 + q * p
    p = -7.69187620504482999495e-02 + q * p
    p = 9.09088713343650656196e-02 + q * p
    p = -1.11111104054623557880e-01 + q * p
    p = 1.42857142725034663711e-01 + q * p
    p = -1.99999999998764832476e-01 + q * p
    p = 3.33333333333329318027e-01 + q * p
    return base + (y - y * q * p)


@kernel
def atan2(y: float, x: float) -> float:
    """Return the angle of the vector (x, y) in [-pi, pi]; 0 for the zero vector."""
    across, along = abs(y), abs(x)
    if across == 0.0 and along == 0.0:
        return 0.0
    angle = _arctangent(across / along) if across <= along else HALF_PI - _arctangent(along / across)
    if x < 0.0:
        angle = PI - angle
    return -angle if y < 0.0 else angle


@kernel
def wrap(angle_rad: float) -> float:
    """Return the angle wrapped to [-pi, pi]; it must be within a thousand turns."""
    return angle_rad - TWO_PI * _nearest(angle_rad * (1.0 / TWO_PI))


def wrap_rad(angle_rad: float) -> float:
    """Return the angle wrapped to [-pi, pi), of any size."""
    return angle_rad - TWO_PI * math.floor((angle_rad + math.pi) / TWO_PI)


wrap_rad_kernel = kernel(wrap_rad)
