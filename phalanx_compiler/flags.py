"""Flags of the C compiler by which kernels give the same bytes on every machine."""

from __future__ import annotations

# -frounding-math: gcc 12 makes -0.0 of `0.0 - (double)0`, as if no zero had a sign.
FLAGS = (
    *("-std=c99", "-O3", "-ffp-contract=off", "-frounding-math", "-fwrapv", "-fno-strict-aliasing"),
    *("-fvisibility=hidden", "-g0"),
)
