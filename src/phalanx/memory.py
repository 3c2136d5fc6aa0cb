"""Bytes of a row in one instruction, for kernels; uncompiled, the same in plain Python.

Rows are (n,) uint8, in C order. Compiled, each access is checked against the row's length.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from .kernel import intrinsic

assert sys.byteorder == "little", "numbers lie in memory as they do on the wire"
WORD_BITS = 64


def _loads(bits: int) -> Callable[[Any, int], int]:
    width = bits // 8

    @intrinsic(f"load_{bits}")
    def load(row: Any, at: int) -> int:
        return int.from_bytes(row[at : at + width].tobytes(), "little", signed=bits == WORD_BITS)

    return load


def _stores(bits: int) -> Callable[[Any, int, int], None]:
    width = bits // 8

    @intrinsic(f"store_{bits}")
    def store(row: Any, at: int, value: int) -> None:
        cut = int(value) & ((1 << bits) - 1)
        row[at : at + width] = np.frombuffer(cut.to_bytes(width, "little"), np.uint8)

    return store


# The unsigned number that lies at `at`; of the longest, 2^63 and more are negative.
load_16, load_32, load_64 = _loads(16), _loads(32), _loads(64)
# The lowest so many bits of `value` lie at `at`.
store_16, store_32, store_64 = _stores(16), _stores(32), _stores(64)


@intrinsic("move")
def move(to: Any, to_at: int, source: Any, source_at: int, length: int) -> None:
    """Copy `length` bytes, 0 or more; the rows may be the same, and the places overlap."""
    to[to_at : to_at + length] = source[source_at : source_at + length].copy()


@intrinsic("equal")
def equal(one: Any, one_at: int, other: Any, other_at: int, length: int) -> bool:
    """Return whether `length` bytes, 0 or more, agree."""
    return bool((one[one_at : one_at + length] == other[other_at : other_at + length]).all())


@intrinsic("prefetch")
def prefetch(rows: Any, i: int, begin: int, length: int) -> None:
    """Ask the processor's caches for `length` bytes of rows[i], from byte `begin` on. Nothing is read or changed."""
