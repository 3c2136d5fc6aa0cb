"""SHA3-256: hashlib for single messages, and Keccak-f[1600] over eight messages at once for searches (FIPS 202).

A hash search computes thousands of digests of messages that differ in eight bytes. hashlib takes 0.6 us for each,
nearly all of it call overhead. Here lane i of eight messages is one row, so that the permutation works on vectors.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import U64x1, U64x2
from phalanx.kernel import kernel, written

DIGEST_BYTES = 32
RATE_BYTES = 136
SUFFIX = 0x06  # SHA-3's domain bits 01, and the first bit of the padding


def _round_constants() -> list[int]:
    """Return the 24 constants of iota, by the LFSR of FIPS 202 §3.2.5."""
    constants, register = [], 1
    for _ in range(24):
        constant = 0
        for j in range(7):
            if register & 1:
                constant |= 1 << ((1 << j) - 1)
            register = (register << 1) ^ (0x171 if register & 0x80 else 0)
        constants.append(constant)
    return constants


_IOTA = np.array(_round_constants(), dtype=np.uint64)
_64 = np.uint64(64)


@kernel
def _turn(lane: np.uint64, bits: int) -> np.uint64:
    return (lane << np.uint64(bits)) | (lane >> np.uint64(64 - bits))


def _rounds() -> list[str]:
    """Return source lines of Keccak-f[1600] over eight messages (FIPS 202 §3.2); lane x, y is number x + 5 y.

    The steps are unrolled, or gcc would not vectorise them: 210 ns a hash with the 128-bit vectors of any x86-64.
    """
    # A bounds check in the loop over j prevents vectors (460 ns a hash). After this access gcc can drop the others.
    highest = "_ = a[199]"
    lines = [f"a{k} = a[{8 * k} + j]" for k in range(25)]
    # theta
    lines += [f"c{x} = a{x} ^ a{x + 5} ^ a{x + 10} ^ a{x + 15} ^ a{x + 20}" for x in range(5)]
    lines += [f"d{x} = c{(x + 4) % 5} ^ turn(c{(x + 1) % 5}, 1)" for x in range(5)]
    # rho and pi
    lines.append("b0 = a0 ^ d0")
    x, y = 1, 0
    for t in range(24):
        lines.append(f"b{y + 5 * ((2 * x + 3 * y) % 5)} = turn(a{x + 5 * y} ^ d{x}, {(t + 1) * (t + 2) // 2 % 64})")
        x, y = y, (2 * x + 3 * y) % 5
    # chi and iota
    for k in range(25):
        row, x = k - k % 5, k % 5
        lines.append(f"a[{8 * k} + j] = b{k} ^ (~b{row + (x + 1) % 5} & b{row + (x + 2) % 5})")
    lines.append("a[j] ^= iota[step]")
    return [highest, "for step in range(24):", "    for j in range(8):", *(f"        {line}" for line in lines)]


def _permute(a: U64x1) -> None:
    """Apply Keccak-f[1600] to eight states: 25 rows of 8 lanes, (200,)."""


_permute = written(_permute, _rounds(), {"turn": _turn, "iota": _IOTA})


@kernel
def find(  # noqa: C901, PLR0912  # a kernel is one function
    template: U64x1, word: int, shift: np.uint64, patches: U64x1, targets: U64x2
) -> tuple[int, int]:
    """Return (index of the first patch whose digest is a target, row of the target), or (-1, -1).

    Args:
        targets: (t, 4), sorted by the first column.
    """
    a = np.empty(200, np.uint64)
    n, lanes, many = patches.shape[0], template.shape[0], targets.shape[0]
    for first in range(0, n, 8):
        wide = min(8, n - first)
        a[:] = np.uint64(0)
        for start in range(0, lanes, 17):
            for i in range(17):
                for j in range(8):
                    a[i * 8 + j] ^= template[start + i]
                if start + i == word:
                    for j in range(wide):
                        a[i * 8 + j] ^= patches[first + j] << shift
                elif start + i == word + 1 and shift != np.uint64(0):
                    for j in range(wide):
                        a[i * 8 + j] ^= patches[first + j] >> (_64 - shift)
            _permute(a)
        for j in range(wide):
            low, high = 0, many
            while low < high:
                middle = (low + high) // 2
                if targets[middle, 0] < a[j]:
                    low = middle + 1
                else:
                    high = middle
            while low < many and targets[low, 0] == a[j]:
                if (
                    targets[low, 1] == a[1 * 8 + j]
                    and targets[low, 2] == a[2 * 8 + j]
                    and targets[low, 3] == a[3 * 8 + j]
                ):
                    return first + j, low
                low += 1
    return -1, -1


def sha3_256(message: bytes) -> bytes:
    """Return the SHA3-256 of one message. Source: FIPS 202."""
    return hashlib.sha3_256(message).digest()


class Targets:
    """Digests to search for, sorted; `place` maps a sorted row back to its index in the list."""

    def __init__(self, digests: list[bytes]) -> None:
        rows = np.frombuffer(b"".join(digests), "<u8").astype(np.uint64).reshape(-1, 4)
        self._order = np.argsort(rows[:, 0], kind="stable")
        self.rows: NDArray[np.uint64] = np.ascontiguousarray(rows[self._order])

    def place(self, row: int) -> int:
        """Return the index in the list of a sorted row's digest."""
        return int(self._order[row])


@lru_cache(maxsize=256)  # a robot with an unchanged view repeats its searches, six times a step
def padded(message: bytes, at: int) -> NDArray[np.uint64]:
    """Return a message with suffix and padding as 64-bit words, (n,); the eight bytes from `at` on, to patch, are 0."""
    assert not any(message[at : at + 8]), "the patched bytes must be zero"
    length = len(message)
    padded = bytearray(message.ljust((length // RATE_BYTES + 1) * RATE_BYTES, b"\x00"))
    padded[length] = SUFFIX
    padded[-1] |= 0x80
    return np.frombuffer(padded, "<u8").astype(np.uint64, copy=False)


def find_patched(message: bytes, at: int, patches: NDArray[np.uint64], targets: Targets) -> tuple[int, int] | None:
    """Find the first of many messages whose digest is a target.

    Each message is `message` with one of the `patches`, (n,), little-endian, in place of the eight zeros at `at`.
    Returns: (index of the patch, index of the digest in the targets' list) of the first match, or None.
    Source: Encoded graphs §V-A (search()).
    """
    template = padded(message, at)
    found, row = find(template, at // 8, np.uint64(at % 8 * 8), patches, targets.rows)
    return None if found < 0 else (found, targets.place(row))
