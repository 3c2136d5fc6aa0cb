"""Sine and cosine of our own: libm's differ between machines in the last bit, which would convict honest robots."""

from __future__ import annotations

from typing import Any

from numba import extending
from numba import types as numba_types

from phalanx.kernel import kernel

# Untyped, both.
extend: Any = extending
types: Any = numba_types
HALF_PI = 1.5707963267948966
RAD_PER_DEG = 0.017453292519943295


def over(value: float, divisor: int) -> float:
    """The quotient, to the last bit, of a value that is 0 or 1e-290 to 1e290 and a constant below 2^20.

    Source: Brisebarre, Muller, "Correctly rounded multiplication by arbitrary precision constants" (2008).
    """
    return value / divisor


@extend.intrinsic  # type: ignore[untyped-decorator]
def _fused(_: Any, one: Any, other: Any, added: Any) -> Any:  # noqa: ARG001
    """The sum of a product, `one * other + added`, rounded once."""

    def generate(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        return builder.fma(*given)

    return types.float64(types.float64, types.float64, types.float64), generate


# A processor multiplies ten times as fast as it divides: by the inverse, in two parts. The sum that is rounded is so
# near to the quotient, and that so far from where rounding turns (1 / (2 divisor) of a last bit), that it is rounded
# alike. Without types, as numba compares them.
def _by_inverse(value, divisor):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    inverse = 1.0 / divisor
    rest = _fused(-inverse, float(divisor), 1.0) / divisor
    return _fused(value, inverse, value * rest)


extend.overload(over)(lambda value, divisor: _by_inverse)  # noqa: ARG005


@kernel
def sine(angle_rad: float) -> float:
    """The sine of an angle within +-pi/2, to 1e-15; beyond, wrong."""
    z, rest = angle_rad * angle_rad, 1.0
    for n in range(20, 0, -2):  # the series, from its end
        rest = 1.0 - over(z, n * (n + 1)) * rest
    return angle_rad * rest


@kernel
def sine_cosine(angle_deg: float) -> tuple[float, float]:
    """Sine and cosine of any angle within +-10^6 degrees, to 1e-14.

    Degrees, because whole turns can be taken off them exactly.
    """
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
