"""From a pin to a topic and a key (Qrkey §III-D)."""

from __future__ import annotations

import base64
from dataclasses import dataclass

from phalanx.crypto import Key, hkdf_sha256

from .pin import Pin

# A protocol version of its own, taken by the published packages from their own version's first two numbers.
TOPIC_INFO = b"secret_topic_0.12"
KEY_INFO = b"secret_key_0.12"
TOPIC_BYTES = 16
KEY_BYTES = 32


@dataclass(frozen=True, slots=True)
class Epoch:
    """A pin with what is derived from it."""

    pin: Pin
    topic: str  # 24 characters; public, for every message travels under it
    key: Key  # AES-256-GCM key


def derive_epoch(pin: Pin) -> Epoch:
    """The epoch of `pin`. Source: Qrkey §III-D; the info strings are those of the published packages."""
    secret = pin.digits.encode("ascii")
    topic = base64.urlsafe_b64encode(hkdf_sha256(secret, TOPIC_INFO, TOPIC_BYTES)).decode("ascii")
    return Epoch(pin, topic, Key(hkdf_sha256(secret, KEY_INFO, KEY_BYTES)))
