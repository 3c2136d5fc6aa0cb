"""A key that can be passed to print, a log or a traceback without harm."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, repr=False, eq=False)  # not a bytes subclass: str() of one prints the bytes
class Key:
    """32 bytes of AES-256 key."""

    raw: bytes

    def __repr__(self) -> str:
        return "<Key>"  # no fingerprint: a key derived from a short pin could be searched for
