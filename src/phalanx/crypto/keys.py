"""Keys: derived from a secret (HKDF) or a passphrase (scrypt), and held so that printing one is harmless."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF


@dataclass(frozen=True, slots=True, repr=False, eq=False)  # not a bytes subclass: str() of one prints the bytes
class Key:
    """32 bytes of AES-256 key, and the cipher made of them once: making it costs as much as a short message."""

    raw: bytes
    cipher: AESGCM = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cipher", AESGCM(self.raw))

    def __repr__(self) -> str:
        return "<Key>"  # no fingerprint: a key derived from a short pin could be searched for


def hkdf_sha256(secret: bytes, info: bytes, length: int) -> bytes:
    """Return `length` bytes derived from `secret` for the purpose `info`, without salt. Source: RFC 5869."""
    return HKDF(algorithm=SHA256(), length=length, salt=None, info=info).derive(secret)


def scrypt(password: bytes, salt: bytes, *, log2_n: int, r: int, length: int) -> bytes:
    """Return `length` bytes derived from `password`, at a cost of 128 * r * 2^log2_n bytes of memory, passed twice.

    Source: RFC 7914, p = 1.
    """
    n = 1 << log2_n
    return hashlib.scrypt(password, salt=salt, n=n, r=r, p=1, maxmem=256 * r * n + (1 << 20), dklen=length)
