"""Array types of kernels: element type and number of axes, for mypy and for the kernel compiler.

`F64x2` is an array of float64 with two axes. Arrays of records name their dtype: `Annotated[Any, Records(ROBOT)]` has
one axis, `Records(TOKEN, 3)` has three, and `Records(ROBOT, 0)` is a single record.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Records:
    """Annotation for an array of records with `axes` axes; with 0 axes, for a single record."""

    dtype: np.dtype[Any]
    axes: int = 1


U8x1: TypeAlias = Annotated[NDArray[np.uint8], 1]
U8x2: TypeAlias = Annotated[NDArray[np.uint8], 2]
U8x3: TypeAlias = Annotated[NDArray[np.uint8], 3]
U16x1: TypeAlias = Annotated[NDArray[np.uint16], 1]
U16x2: TypeAlias = Annotated[NDArray[np.uint16], 2]
I32x1: TypeAlias = Annotated[NDArray[np.int32], 1]
I64x1: TypeAlias = Annotated[NDArray[np.int64], 1]
I64x2: TypeAlias = Annotated[NDArray[np.int64], 2]
I64x3: TypeAlias = Annotated[NDArray[np.int64], 3]
U64x1: TypeAlias = Annotated[NDArray[np.uint64], 1]
U64x2: TypeAlias = Annotated[NDArray[np.uint64], 2]
F32x1: TypeAlias = Annotated[NDArray[np.float32], 1]
F64x1: TypeAlias = Annotated[NDArray[np.float64], 1]
F64x2: TypeAlias = Annotated[NDArray[np.float64], 2]
Params: TypeAlias = F64x1  # a controller's parameters, as kernels read them
BOOLx1: TypeAlias = Annotated[NDArray[np.bool_], 1]


def layout(*declared: str) -> np.dtype[Any]:
    """Return the record dtype with fields declared as "NAME TYPE", or "NAME NAME … TYPE" for several of one type.

    Types are numpy's ("i8", "u1", "8u1" for eight bytes); fields are aligned as a C compiler aligns them.
    """
    fields = [(name, kind) for *names, kind in map(str.split, declared) for name in names]
    return np.dtype(fields, align=True)
