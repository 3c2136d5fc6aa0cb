"""PRESENT-80 and LightMAC written for reading, from the papers. Big-endian, as both print their numbers."""

from __future__ import annotations

from functools import cache

SBOX = [0xC, 5, 6, 0xB, 9, 0, 0xA, 0xD, 3, 0xE, 0xF, 8, 4, 7, 1, 2]


def moved(bit: int) -> int:
    """Where the permutation takes a bit: 16 times its number, modulo 63; the last stays."""
    return 63 if bit == 63 else bit * 16 % 63


# What the nibble n with value v becomes in one round, S-box and permutation in one step.
ROUND = [[sum((SBOX[v] >> b & 1) << moved(4 * n + b) for b in range(4)) for v in range(16)] for n in range(16)]


@cache
def round_keys(key: bytes) -> list[int]:
    register, keys = int.from_bytes(key, "big"), []
    for i in range(1, 33):
        keys.append(register >> 16)
        register = (register << 61 | register >> 19) & (1 << 80) - 1
        register = SBOX[register >> 76] << 76 | register & (1 << 76) - 1
        register ^= i << 15
    return keys


def present80(key: bytes, plain: bytes) -> bytes:
    """Bogdanov et al., CHES 2007, figure 1 and section 3."""
    *keys, last = round_keys(key)
    state = int.from_bytes(plain, "big")
    for round_key in keys:
        state ^= round_key
        state = sum(ROUND[n][state >> 4 * n & 15] for n in range(16))
    return (state ^ last).to_bytes(8, "big")


def lightmac(key: bytes, message: bytes) -> bytes:
    """Luykx et al., FSE 2016, with an 8-bit counter: whole blocks of 7 bytes under K1, what is left under K2."""
    k1, k2 = key[:10], key[10:]
    total = 0
    counter = 1
    while len(message) >= 7:
        total ^= int.from_bytes(present80(k1, bytes([counter]) + message[:7]), "big")
        message = message[7:]
        counter += 1
    total ^= int.from_bytes((message + b"\x80").ljust(8, b"\0"), "big")
    return present80(k2, total.to_bytes(8, "big"))
