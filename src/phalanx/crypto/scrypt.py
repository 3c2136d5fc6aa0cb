"""scrypt (RFC 7914): a hash that costs memory and time, for whoever guesses and for whoever knows."""

from __future__ import annotations

import hashlib


def scrypt(password: bytes, salt: bytes, *, log2_n: int, r: int, length: int) -> bytes:
    """`length` bytes derived from `password`, at a cost of 128 * r * 2^log2_n bytes of memory, passed twice.

    Source: RFC 7914, p = 1.
    """
    n = 1 << log2_n
    return hashlib.scrypt(password, salt=salt, n=n, r=r, p=1, maxmem=256 * r * n + (1 << 20), dklen=length)
