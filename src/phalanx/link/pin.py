"""The pin, the only secret in a QR code of mode qrkey, and the topic and key derived from it (Qrkey §III-D)."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from dataclasses import dataclass

from phalanx.crypto import Key, hkdf_sha256
from phalanx.errors import UsageError

# Version of the key derivation. The published packages use the first two numbers of their own version.
TOPIC_INFO = b"secret_topic_0.12"
KEY_INFO = b"secret_key_0.12"
TOPIC_BYTES = 16
KEY_BYTES = 32
_DIGITS = re.compile(r"[0-9]{4,64}", re.ASCII)


class BadPin(UsageError):
    """Not 4 to 64 decimal digits. The message never contains the input: it may be a mistyped secret."""

    def __init__(self) -> None:
        super().__init__("the pin is not 4 to 64 digits", "copy it from the operator's page, leading zeros included")


@dataclass(frozen=True, slots=True, repr=False)
class Pin:
    """Pin as a string of decimal digits, because leading zeros count. Raises: BadPin."""

    digits: str

    def __post_init__(self) -> None:
        if not isinstance(self.digits, str) or not _DIGITS.fullmatch(self.digits):
            raise BadPin

    def __repr__(self) -> str:
        return "<Pin>"


def new_pin(digits: int, random_bytes: Callable[[int], bytes]) -> Pin:
    """Generate a pin of uniform digits; `random_bytes` returns n bytes from a cryptographic source."""
    chosen = ""
    while len(chosen) < digits:
        # 250 is the last multiple of 10 in a byte; keeping 250..255 would favour the digits 0 to 5.
        chosen += "".join(str(byte % 10) for byte in random_bytes(digits) if byte < 250)
    return Pin(chosen[:digits])


@dataclass(frozen=True, slots=True)
class Epoch:
    """A pin, and the topic and key derived from it."""

    pin: Pin
    topic: str  # 24 characters; public: part of the topic of every message
    key: Key  # AES-256-GCM key


def derive_epoch(pin: Pin) -> Epoch:
    """Derive topic and key from `pin`. Source: Qrkey §III-D; the info strings are those of the published packages."""
    secret = pin.digits.encode("ascii")
    topic = base64.urlsafe_b64encode(hkdf_sha256(secret, TOPIC_INFO, TOPIC_BYTES)).decode("ascii")
    return Epoch(pin, topic, Key(hkdf_sha256(secret, KEY_INFO, KEY_BYTES)))
