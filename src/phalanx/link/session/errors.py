"""Errors of sessions, beside those of `phalanx.errors`. The receiver counts each by its reason, and goes on."""

from __future__ import annotations

from enum import IntEnum

from phalanx.errors import PeerError


class Reason(IntEnum):
    """Reason sent to a visitor when a command or request is refused."""

    LATE = 1
    NOT_ALLOWED = 2
    BUSY = 3
    TOO_MANY = 4
    BAD = 5
    UNKNOWN = 6
    HELD = 7
    FAILED = 8


class EndReason(IntEnum):
    """Reason sent to a visitor when a session ends."""

    REMOVED = 1
    REPLACED = 2
    NEW_CODE = 3
    OLD_KEYS = 4
    CLOSING = 5
    FULL = 6
    NOT_ADMITTED = 7


class SessionError(PeerError):
    """Base of the errors of a peer's message in a session."""


class UnknownSecret(SessionError):
    """No invitation, room code or resume secret with this id is valid: expired, used up, removed, or unknown."""


class TriesUsedUp(SessionError):
    """Too many attempts with room codes in the last hour, from this address or in total."""


class TooMany(SessionError):
    """A limit on the messages or the number of visitors was exceeded."""


class Unexpected(SessionError):
    """A message that is not allowed in the current state of the session."""


class UnknownEpoch(SessionError):
    """An update under a key that this client does not have."""


class NotAllowed(SessionError):
    """The visitor's role, ticket or assignment does not allow it."""


class Busy(SessionError):
    """Another visitor drives this robot."""
