"""Invitations: what a QR code's fragment holds, and room codes, which people type.

No error repeats what was given: it may be a mistyped secret.
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

WORD = "j="  # what a fragment of ours begins with
FRAGMENT_LONGEST = 1024  # characters
ROOM_DIGITS = 8
MQTT_VERSIONS = (4, 5)
_BROKER = re.compile(r"wss?://([0-9a-z._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?(/[^?#\s]*)?", re.IGNORECASE | re.ASCII)
_SPACES = re.compile(r"[\s-]+")
_DIGITS = re.compile(rf"[0-9]{{{ROOM_DIGITS}}}", re.ASCII)


class BadInvitation(UsageError):
    """Not what a swarm's QR code or screen shows."""

    def __init__(self, what: str) -> None:
        super().__init__(f"not an invitation: {what}", "copy the whole link, in quotes, from under the QR code")


@dataclass(frozen=True, slots=True)
class Invitation:
    """All that a visitor needs to join. Raises: BadInvitation."""

    static: bytes  # the swarm's X25519 public key
    secret: Secret  # open, ticket, room or resume
    broker: str = ""  # ws or wss URL; empty: direct
    root: str = ""  # first part of every topic; empty: direct
    mqtt: int = field(default=0)  # protocol version, 5 or 4 (3.1.1); 0: direct

    def __post_init__(self) -> None:
        if not self.broker:
            if self.root or self.mqtt:
                raise BadInvitation("a root or MQTT version without a broker")
            return
        if self.secret.kind is Kind.ROOM:
            raise BadInvitation("a room code with a broker")
        if not _BROKER.fullmatch(self.broker):
            raise BadInvitation("the broker is not a ws:// or wss:// URL")
        if self.mqtt not in MQTT_VERSIONS:
            raise BadInvitation("MQTT version is 4 or 5")
        try:
            LinkConfig(root=self.root)
        except UsageError:
            raise BadInvitation("the root is not a topic") from None

    def fragment(self) -> str:
        """Return the fragment, without `#`. Raises: UsageError: room codes and resume secrets stand in no URL."""
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
    """Return whether a URL's fragment says that it is an invitation to a session."""
    return text.strip().rpartition("#")[2].startswith(WORD)


def parse_invitation(text: str) -> Invitation:
    """Return the invitation in a URL, or in its fragment. Raises: BadInvitation."""
    word = text.strip().rpartition("#")[2]
    if not word.startswith(WORD) or len(word) > FRAGMENT_LONGEST or not word.isascii():
        raise BadInvitation("no such fragment in it")
    try:
        values = INVITATION.decode(decode_base64url(word.removeprefix(WORD).encode()))
        root, broker = values["root"].decode("ascii"), values["broker"].decode("ascii")
    except (PeerError, UnicodeDecodeError):
        raise BadInvitation("cut off, or of another version") from None
    if values["kind"] not in (Kind.OPEN, Kind.TICKET):
        raise BadInvitation("of another kind")
    return Invitation(values["static"], Secret(Kind(values["kind"]), values["secret"]), broker, root, values["mqtt"])


def new_room_code(random_bytes: Callable[[int], bytes]) -> str:
    """Return eight digits, each equally likely."""
    chosen = ""
    while len(chosen) < ROOM_DIGITS:
        # 250 is the last multiple of 10 in a byte; keeping 250..255 would favour the digits 0 to 5.
        chosen += "".join(str(byte % 10) for byte in random_bytes(ROOM_DIGITS) if byte < 250)
    return chosen[:ROOM_DIGITS]


def shown_room_code(digits: str) -> str:
    """Return a room code as people read it: two groups."""
    half = ROOM_DIGITS // 2
    return f"{digits[:half]} {digits[half:]}"


def parse_room_code(text: str) -> Secret:
    """Return the secret of a room code that somebody typed. Raises: BadInvitation."""
    digits = _SPACES.sub("", text)
    if not _DIGITS.fullmatch(digits):
        raise BadInvitation(f"a room code has {ROOM_DIGITS} digits")
    return Secret(Kind.ROOM, digits.encode())
