"""A key that can be passed to print, a log or a traceback without harm."""

from __future__ import annotations

from dataclasses import dataclass, field

from cryptography.hazmat.primitives.ciphers.aead import AESGCM


@dataclass(frozen=True, slots=True, repr=False, eq=False)  # not a bytes subclass: str() of one prints the bytes
class Key:
    """32 bytes of AES-256 key, and the cipher made of them once: making it costs as much as a short message."""

    raw: bytes
    cipher: AESGCM = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cipher", AESGCM(self.raw))

    def __repr__(self) -> str:
        return "<Key>"  # no fingerprint: a key derived from a short pin could be searched for
