"""SHA3-256: hashlib for single messages; for a search, Keccak-f[1600] over eight messages side by side (FIPS 202).

A hash search asks for thousands of digests of messages that differ in one place. hashlib takes 0.6 us for each, nearly
all of it the call; here lane i of eight messages lies in one row, so that each step of the permutation is on vectors.
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
SUFFIX = 0x06  # SHA-3's two bits, and the first of the padding


def _round_constants() -> list[int]:
    """The 24 constants of iota, by the LFSR of FIPS 202 §3.2.5."""
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
    """All rounds of Keccak-f[1600] over eight messages, written out (FIPS 202 §3.2); lane x, y is number x + 5 y.

    Written out, for only then gcc uses vectors: 210 ns a hash with two lanes in a vector, which every x86-64 has.
    """
    # A check within the loop over j keeps gcc from vectors (460 ns a hash): after this one it finds all others to hold.
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
    """Keccak-f[1600] on 25 rows of 8 lanes, (200,)."""


_permute = written(_permute, _rounds(), {"turn": _turn, "iota": _IOTA})


@kernel
def find(  # noqa: C901, PLR0912  # a kernel is one function
    template: U64x1, word: int, shift: np.uint64, patches: U64x1, targets: U64x2
) -> tuple[int, int]:
    """(index of the first patch whose digest is a target, the target), or (-1, -1). targets: (t, 4), sorted."""
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
    """SHA3-256 of one message. Source: FIPS 202."""
    return hashlib.sha3_256(message).digest()


class Targets:
    """Digests to look for, as the search wants them; which one it was is told by its first place in the list."""

    def __init__(self, digests: list[bytes]) -> None:
        rows = np.frombuffer(b"".join(digests), "<u8").astype(np.uint64).reshape(-1, 4)
        self._order = np.argsort(rows[:, 0], kind="stable")
        self.rows: NDArray[np.uint64] = np.ascontiguousarray(rows[self._order])

    def place(self, row: int) -> int:
        """Return the position in the list of a sorted row's digest."""
        return int(self._order[row])


@lru_cache(maxsize=256)  # a robot that sees the same asks for the same, six times a step
def padded(message: bytes, at: int) -> NDArray[np.uint64]:
    """A message with its suffix and padding, in words, (n,); eight of its bytes, zeros, are to be patched."""
    assert not any(message[at : at + 8]), "the patch is put over zeros"
    length = len(message)
    padded = bytearray(message.ljust((length // RATE_BYTES + 1) * RATE_BYTES, b"\x00"))
    padded[length] = SUFFIX
    padded[-1] |= 0x80
    return np.frombuffer(padded, "<u8").astype(np.uint64, copy=False)


def find_patched(message: bytes, at: int, patches: NDArray[np.uint64], targets: Targets) -> tuple[int, int] | None:
    """Which of many messages has a digest that is wanted; they differ in eight bytes, zeros in `message`, from `at` on.

    These are each of the patches, (n,), little-endian, in this order.
    Returns: (index of the patch, place of the digest in the targets' list), of the first that matches, or None.
    Source: Encoded graphs §V-A (search()).
    """
    template = padded(message, at)
    found, row = find(template, at // 8, np.uint64(at % 8 * 8), patches, targets.rows)
    return None if found < 0 else (found, targets.place(row))
