"""The parameters of a mission, as kernels are given them."""

from __future__ import annotations

from typing import TypeAlias

from phalanx.arrays import F64x1

Params: TypeAlias = F64x1
