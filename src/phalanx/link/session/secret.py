"""Secrets of invitations, room codes and resumption, and the psk, id, MAC key and topics derived from them.

Only this file has the labels of derivations, and only this file compares MACs.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from enum import IntEnum

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PublicKey

from phalanx.crypto import hkdf_sha256
from phalanx.crypto.jwe import encode_base64url
from phalanx.errors import NotAuthentic
from phalanx.wire import sessions

from .noise import KEY_BYTES, Cipher

PROTOCOL = b"phalanx/1 "
ID_BYTES = 8
MAC1_BYTES = 16
TOPIC_BYTES = 16  # 22 characters
INVITATION_BYTES, RESUME_BYTES = 16, 32
NO_ID = bytes(ID_BYTES)


class Kind(IntEnum):
    """Kind of a handshake's secret; the name in lower case is the HKDF info of its psk."""

    OPEN = 1
    TICKET = 2
    ROOM = 3
    RESUME = 4


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Secret:
    """A secret and its kind. The repr does not show it."""

    kind: Kind
    raw: bytes

    def __repr__(self) -> str:
        return "<Secret>"

    @property
    def psk(self) -> bytes:
        """Return the pre-shared key of its handshakes."""
        return derive(self.raw, self.kind.name.lower().encode(), KEY_BYTES)

    @property
    def id(self) -> bytes:
        """Return the id in the first message; zeros for a room code, which could be brute-forced offline from an id."""
        return NO_ID if self.kind is Kind.ROOM else derive(self.raw, b"id", ID_BYTES)

    def mac1(self, hello: bytes) -> bytes:
        """Return the MAC of a first message on a broker, where room codes are not used."""
        return hmac.digest(derive(self.raw, b"mac1", KEY_BYTES), hello, "sha256")[:MAC1_BYTES]

    def check_mac1(self, hello: bytes, mac1: bytes) -> None:
        """Raise NotAuthentic unless `mac1` is the MAC of the message."""
        if not hmac.compare_digest(self.mac1(hello), mac1):
            raise NotAuthentic("mac1 does not verify")

    def accept_topic(self, hello: bytes) -> str:
        """Return the topic of the answer to a first message on a broker."""
        return topic_name(derive(self.raw + hello, b"accept", TOPIC_BYTES))


def derive(secret: bytes, purpose: bytes, length: int) -> bytes:
    """Derive bytes for a purpose: HKDF-SHA256 without salt, info `phalanx/1 <purpose>`."""
    return hkdf_sha256(secret, PROTOCOL + purpose, length)


def prologue(kind: Kind, secret_id: bytes, root: str, broker: str) -> bytes:
    """Return the Noise prologue of a handshake."""
    return sessions.PROLOGUE.encode(
        version=bytes([sessions.VERSION]),
        kind=bytes([kind]),
        id=secret_id,
        root=root.encode(),
        broker=broker.encode(),
    )


def hello_topic(static: X25519PublicKey) -> str:
    """Return the topic on a broker for first messages to a swarm."""
    return topic_name(derive(static.public_bytes_raw(), b"hello", TOPIC_BYTES))


def record_topic(cipher: Cipher) -> str:
    """Return the topic on a broker for the records of one direction and generation."""
    return topic_name(cipher.derive(PROTOCOL + b"topic", TOPIC_BYTES))


def topic_name(raw: bytes) -> str:
    """Return 16 bytes as the 22 characters of a topic below the root."""
    return encode_base64url(raw).decode()
