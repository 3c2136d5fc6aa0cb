"""HKDF-SHA256 (RFC 5869)."""

from __future__ import annotations

from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF


def hkdf_sha256(secret: bytes, info: bytes, length: int) -> bytes:
    """`length` bytes derived from `secret` for the purpose `info`, without salt. Source: RFC 5869."""
    return HKDF(algorithm=SHA256(), length=length, salt=None, info=info).derive(secret)
