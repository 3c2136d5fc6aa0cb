"""Cryptographic primitives: JWE, key derivation, SHA3-256."""

from .jwe import IV_BYTES, open_jwe, seal_jwe
from .keys import Key, hkdf_sha256

__all__ = ["IV_BYTES", "Key", "hkdf_sha256", "open_jwe", "seal_jwe"]
