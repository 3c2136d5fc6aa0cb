"""SHA3-256 of many short messages at once: Keccak-f[1600] over eight of them side by side (FIPS 202).

A hash search asks for thousands of digests of messages that differ in one place. hashlib takes 0.6 us for each, nearly
all of it the call; here lane i of eight messages lies in one row, so that every step of the permutation is one vector
instruction. hashlib stays the oracle: tests compare the two, and `sha3_256` is what single messages use.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel

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
_64, _LAST = np.uint64(64), np.uint64(1 << 63)


@kernel
def _turn(lane: np.uint64, bits: int) -> np.uint64:
    return (lane << np.uint64(bits)) | (lane >> np.uint64(64 - bits))


@kernel
def _permute(a: NDArray[np.uint64]) -> None:  # noqa: PLR0915
    """Keccak-f[1600] on 25 rows of 8 lanes, (200,).

    Written out, for then the compiler keeps a round of eight messages in vector registers: 60 ns a hash, with loops
    over x and y 700 ns. theta is c and d, rho and pi are b, chi and iota the last 25 lines (FIPS 202 §3.2).
    """
    for step in range(24):
        for j in range(8):
            a00, a01, a02, a03, a04 = a[j], a[1 * 8 + j], a[2 * 8 + j], a[3 * 8 + j], a[4 * 8 + j]
            a05, a06, a07, a08, a09 = a[5 * 8 + j], a[6 * 8 + j], a[7 * 8 + j], a[8 * 8 + j], a[9 * 8 + j]
            a10, a11, a12, a13, a14 = a[10 * 8 + j], a[11 * 8 + j], a[12 * 8 + j], a[13 * 8 + j], a[14 * 8 + j]
            a15, a16, a17, a18, a19 = a[15 * 8 + j], a[16 * 8 + j], a[17 * 8 + j], a[18 * 8 + j], a[19 * 8 + j]
            a20, a21, a22, a23, a24 = a[20 * 8 + j], a[21 * 8 + j], a[22 * 8 + j], a[23 * 8 + j], a[24 * 8 + j]
            c0 = a00 ^ a05 ^ a10 ^ a15 ^ a20
            c1 = a01 ^ a06 ^ a11 ^ a16 ^ a21
            c2 = a02 ^ a07 ^ a12 ^ a17 ^ a22
            c3 = a03 ^ a08 ^ a13 ^ a18 ^ a23
            c4 = a04 ^ a09 ^ a14 ^ a19 ^ a24
            d0 = c4 ^ _turn(c1, 1)
            d1 = c0 ^ _turn(c2, 1)
            d2 = c1 ^ _turn(c3, 1)
            d3 = c2 ^ _turn(c4, 1)
            d4 = c3 ^ _turn(c0, 1)
            b00 = a00 ^ d0
            b01 = _turn(a06 ^ d1, 44)
            b02 = _turn(a12 ^ d2, 43)
            b03 = _turn(a18 ^ d3, 21)
            b04 = _turn(a24 ^ d4, 14)
            b05 = _turn(a03 ^ d3, 28)
            b06 = _turn(a09 ^ d4, 20)
            b07 = _turn(a10 ^ d0, 3)
            b08 = _turn(a16 ^ d1, 45)
            b09 = _turn(a22 ^ d2, 61)
            b10 = _turn(a01 ^ d1, 1)
            b11 = _turn(a07 ^ d2, 6)
            b12 = _turn(a13 ^ d3, 25)
            b13 = _turn(a19 ^ d4, 8)
            b14 = _turn(a20 ^ d0, 18)
            b15 = _turn(a04 ^ d4, 27)
            b16 = _turn(a05 ^ d0, 36)
            b17 = _turn(a11 ^ d1, 10)
            b18 = _turn(a17 ^ d2, 15)
            b19 = _turn(a23 ^ d3, 56)
            b20 = _turn(a02 ^ d2, 62)
            b21 = _turn(a08 ^ d3, 55)
            b22 = _turn(a14 ^ d4, 39)
            b23 = _turn(a15 ^ d0, 41)
            b24 = _turn(a21 ^ d1, 2)
            a[j] = b00 ^ (~b01 & b02) ^ _IOTA[step]
            a[1 * 8 + j] = b01 ^ (~b02 & b03)
            a[2 * 8 + j] = b02 ^ (~b03 & b04)
            a[3 * 8 + j] = b03 ^ (~b04 & b00)
            a[4 * 8 + j] = b04 ^ (~b00 & b01)
            a[5 * 8 + j] = b05 ^ (~b06 & b07)
            a[6 * 8 + j] = b06 ^ (~b07 & b08)
            a[7 * 8 + j] = b07 ^ (~b08 & b09)
            a[8 * 8 + j] = b08 ^ (~b09 & b05)
            a[9 * 8 + j] = b09 ^ (~b05 & b06)
            a[10 * 8 + j] = b10 ^ (~b11 & b12)
            a[11 * 8 + j] = b11 ^ (~b12 & b13)
            a[12 * 8 + j] = b12 ^ (~b13 & b14)
            a[13 * 8 + j] = b13 ^ (~b14 & b10)
            a[14 * 8 + j] = b14 ^ (~b10 & b11)
            a[15 * 8 + j] = b15 ^ (~b16 & b17)
            a[16 * 8 + j] = b16 ^ (~b17 & b18)
            a[17 * 8 + j] = b17 ^ (~b18 & b19)
            a[18 * 8 + j] = b18 ^ (~b19 & b15)
            a[19 * 8 + j] = b19 ^ (~b15 & b16)
            a[20 * 8 + j] = b20 ^ (~b21 & b22)
            a[21 * 8 + j] = b21 ^ (~b22 & b23)
            a[22 * 8 + j] = b22 ^ (~b23 & b24)
            a[23 * 8 + j] = b23 ^ (~b24 & b20)
            a[24 * 8 + j] = b24 ^ (~b20 & b21)


@kernel
def _hash_many(messages: NDArray[np.uint64], blocks: int, digests: NDArray[np.uint64]) -> None:
    """Digests (n, 4) of messages (n, lanes) that have their suffix; the last bit of the padding is put here."""
    a = np.empty(200, np.uint64)
    n, lanes = messages.shape
    for first in range(0, n, 8):
        a[:] = np.uint64(0)
        wide = min(8, n - first)
        for block in range(blocks):
            for i in range(block * 17, min(block * 17 + 17, lanes)):
                for j in range(wide):
                    a[(i - block * 17) * 8 + j] ^= messages[first + j, i]
            if block == blocks - 1:
                for j in range(8):
                    a[16 * 8 + j] ^= _LAST
            _permute(a)
        for j in range(wide):
            for i in range(4):
                digests[first + j, i] = a[i * 8 + j]


@kernel
def _find(  # noqa: C901, PLR0912  # a kernel is one function
    template: NDArray[np.uint64],
    word: int,
    shift: np.uint64,
    patches: NDArray[np.uint64],
    targets: NDArray[np.uint64],
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
    """SHA3-256 of one message.

    Source: FIPS 202.
    """
    return hashlib.sha3_256(message).digest()


def sha3_256_many(messages: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Digests of messages of one length.

    Args:
        messages: (n, L).
    Returns: (n, 32).
    Source: FIPS 202.
    """
    n, length = messages.shape
    lanes = np.zeros((n, (length // 8 + 1) * 8), np.uint8)
    lanes[:, :length] = messages
    lanes[:, length] = SUFFIX
    digests = np.empty((n, 4), np.uint64)
    _hash_many(lanes.view("<u8").astype(np.uint64, copy=False), length // RATE_BYTES + 1, digests)
    return digests.astype("<u8", copy=False).view(np.uint8)


class Targets:
    """Digests to look for, in the order that the search wants; which one it was is told by its first place in the list.

    Args:
        digests: 32 bytes each.
    """

    def __init__(self, digests: list[bytes]) -> None:
        rows = np.frombuffer(b"".join(digests), "<u8").astype(np.uint64).reshape(-1, 4)
        self._order = np.argsort(rows[:, 0], kind="stable")
        self.rows: NDArray[np.uint64] = np.ascontiguousarray(rows[self._order])

    def place(self, row: int) -> int:
        """Where in the list the digest of a sorted row stood."""
        return int(self._order[row])


def find_patched(message: bytes, at: int, patches: NDArray[np.uint64], targets: Targets) -> tuple[int, int] | None:
    """Which of many messages has a digest that is wanted; they differ in eight bytes.

    Args:
        message: with zeros where the patch goes.
        at: where it goes, bytes from the start; little-endian.
        patches: (n,), tried in this order.
        targets: digests.
    Returns: (index of the patch, place of the digest in the targets' list), of the first that matches, or None.
    Source: Encoded graphs §V-A (search()).
    """
    assert not any(message[at : at + 8]), "the patch is put over zeros"
    length = len(message)
    padded = bytearray(message.ljust((length // RATE_BYTES + 1) * RATE_BYTES, b"\x00"))
    padded[length] = SUFFIX
    padded[-1] |= 0x80
    template = np.frombuffer(padded, "<u8").astype(np.uint64, copy=False)
    found, row = _find(template, at // 8, np.uint64(at % 8 * 8), patches, targets.rows)
    return None if found < 0 else (found, targets.place(row))
