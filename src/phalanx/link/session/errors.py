"""What a session refuses beside what `phalanx.errors` has: each is counted by its reason, and survived."""

from __future__ import annotations

from enum import IntEnum

from phalanx.errors import PeerError


class Reason(IntEnum):
    """Why a command or request was refused, as the visitor is told."""

    LATE = 1
    NOT_ALLOWED = 2
    BUSY = 3
    TOO_MANY = 4
    BAD = 5
    UNKNOWN = 6
    HELD = 7
    FAILED = 8


class EndReason(IntEnum):
    """Why a session is over, as the visitor is told."""

    REMOVED = 1
    REPLACED = 2
    NEW_CODE = 3
    OLD_KEYS = 4
    CLOSING = 5
    FULL = 6
    NOT_ADMITTED = 7


class SessionError(PeerError):
    """A message that does not fit the session."""


class UnknownSecret(SessionError):
    """No invitation, room code or resume secret of this id is valid: expired, used up, removed, or never made."""


class TriesUsedUp(SessionError):
    """Too many tries of room codes in the last hour, from this address or in all."""


class TooMany(SessionError):
    """More than this visitor, or all, may send or be."""


class Unexpected(SessionError):
    """A message that its sender may not send now."""


class UnknownEpoch(SessionError):
    """An update under a key that this client does not have."""


class NotAllowed(SessionError):
    """The visitor's role, ticket or assignment does not allow it."""


class Busy(SessionError):
    """Another visitor drives this robot."""
