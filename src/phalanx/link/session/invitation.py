"""Invitations in the fragment of a QR code's URL, and room codes, which people type.

No error message contains the input: it may be a mistyped secret.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from phalanx.config import LinkConfig
from phalanx.crypto.jwe import decode_base64url, encode_base64url
from phalanx.errors import PeerError, UsageError
from phalanx.wire.sessions import INVITATION

from .secret import Kind, Secret

WORD = "j="  # prefix of the fragment
FRAGMENT_LONGEST = 1024  # characters
ROOM_DIGITS = 8
MQTT_VERSIONS = (4, 5)
_BROKER = re.compile(r"wss?://([0-9a-z._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?(/[^?#\s]*)?", re.IGNORECASE | re.ASCII)
_SPACES = re.compile(r"[\s-]+")
_DIGITS = re.compile(rf"[0-9]{{{ROOM_DIGITS}}}", re.ASCII)


class BadInvitation(UsageError):
    """Not a valid invitation link or room code."""

    def __init__(self, what: str) -> None:
        super().__init__(f"not an invitation: {what}", "copy the whole link, in quotes, from under the QR code")


@dataclass(frozen=True, slots=True)
class Invitation:
    """Data that a visitor needs to join. Raises: BadInvitation."""

    static: bytes  # the swarm's X25519 public key
    secret: Secret  # open, ticket, room or resume
    broker: str = ""  # ws or wss URL; empty: no broker
    root: str = ""  # first part of every topic; empty: no broker
    mqtt: int = field(default=0)  # protocol version, 5 or 4 (3.1.1); 0: no broker

    def __post_init__(self) -> None:
        if not self.broker:
            if self.root or self.mqtt:
                raise BadInvitation("it names a topic root or an MQTT version, but no broker")
            return
        if self.secret.kind is Kind.ROOM:
            raise BadInvitation("a room code with a broker")
        if not _BROKER.fullmatch(self.broker):
            raise BadInvitation("the broker is not a ws:// or wss:// URL")
        if self.mqtt not in MQTT_VERSIONS:
            raise BadInvitation("the MQTT version is not 4 or 5")
        try:
            LinkConfig(root=self.root)
        except UsageError:
            raise BadInvitation("the root is not a valid topic") from None

    def fragment(self) -> str:
        """Return the URL fragment, without `#`. Raises: UsageError: a room code or resume secret, which has no URL."""
        if self.secret.kind not in (Kind.OPEN, Kind.TICKET):
            raise UsageError("only open codes and tickets have a URL")
        return (
            WORD
            + encode_base64url(
                INVITATION.encode(
                    kind=self.secret.kind,
                    static=self.static,
                    secret=self.secret.raw,
                    mqtt=self.mqtt,
                    root=self.root.encode(),
                    broker=self.broker.encode(),
                )
            ).decode()
        )


def is_session_url(text: str) -> bool:
    """Return whether a URL's fragment has the prefix of an invitation to a session."""
    return text.strip().rpartition("#")[2].startswith(WORD)


def parse_invitation(text: str) -> Invitation:
    """Parse the invitation in a URL, or in its fragment. Raises: BadInvitation."""
    word = text.strip().rpartition("#")[2]
    if not word.startswith(WORD) or len(word) > FRAGMENT_LONGEST or not word.isascii():
        raise BadInvitation("the link has no valid fragment")
    try:
        values = INVITATION.decode(decode_base64url(word.removeprefix(WORD).encode()))
        root, broker = values["root"].decode("ascii"), values["broker"].decode("ascii")
    except (PeerError, UnicodeDecodeError):
        raise BadInvitation("the link is cut off, or of another version") from None
    if values["kind"] not in (Kind.OPEN, Kind.TICKET):
        raise BadInvitation("the link is of another kind")
    return Invitation(values["static"], Secret(Kind(values["kind"]), values["secret"]), broker, root, values["mqtt"])


def new_room_code(random_bytes: Callable[[int], bytes]) -> str:
    """Generate a room code: eight uniform digits."""
    chosen = ""
    while len(chosen) < ROOM_DIGITS:
        # 250 is the last multiple of 10 in a byte; keeping 250..255 would favour the digits 0 to 5.
        chosen += "".join(str(byte % 10) for byte in random_bytes(ROOM_DIGITS) if byte < 250)
    return chosen[:ROOM_DIGITS]


def shown_room_code(digits: str) -> str:
    """Format a room code for people: two groups of digits."""
    half = ROOM_DIGITS // 2
    return f"{digits[:half]} {digits[half:]}"


def parse_room_code(text: str) -> Secret:
    """Parse a typed room code. Raises: BadInvitation."""
    digits = _SPACES.sub("", text)
    if not _DIGITS.fullmatch(digits):
        raise BadInvitation(f"a room code has {ROOM_DIGITS} digits")
    return Secret(Kind.ROOM, digits.encode())
