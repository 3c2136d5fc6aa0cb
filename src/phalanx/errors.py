"""Exceptions, by who has to act.

`PeerError`: bytes from a peer are invalid. Expected under attack: the receiver counts it by `reason`, goes on,
    and does not reply.
`UsageError`: the caller passed something invalid; shown to the user as one line, with a hint how to fix it.
`Unavailable`: a resource outside the process (a broker, a port) failed; trying again may help.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import ClassVar

ALIKE = 0.6  # similarity from which a name counts as a misspelling of another
RENAMED = {"bound": "hardened", "frames": "packets", "frame_max_bytes": "packet_max_bytes"}  # former names


class PhalanxError(Exception):
    """Base class of all exceptions that Phalanx defines."""


class _ErrorWithHint(PhalanxError):
    """An error shown to the user: what is wrong and where, lower case, no full stop; and a hint, or ""."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(_ErrorWithHint):
    """An error that the caller can fix: a bad value, a missing file.

    Class attributes:
        exit_code: exit code of the command line.
    """

    exit_code: ClassVar[int] = 2


class Unavailable(_ErrorWithHint):
    """A resource outside the process failed: an unreachable broker, a port in use, a swarm that does not answer."""


class KernelDefect(_ErrorWithHint):
    """A kernel would have indexed outside an array or divided by zero: a bug in Phalanx, at the given file and line."""


class OwnDefect(KernelDefect):
    """A kernel of a user's file indexed outside an array, divided by zero, or returned an invalid value."""


class OwnFileError(UsageError):
    """A user's file is invalid, at the given file and line."""

    exit_code = 1


class OutsideSubset(OwnFileError):
    """A user's file uses Python that the kernel compiler does not support."""


class PeerError(PhalanxError):
    """Bytes from a peer are invalid.

    Class attributes:
        reason: key under which receivers count the error; by default the class name in snake case.
    """

    reason: ClassVar[str] = "peer_error"

    def __init_subclass__(cls) -> None:
        if "reason" not in vars(cls):
            cls.reason = re.sub("(?<=.)(?=[A-Z])", "_", cls.__name__).lower()


class Defective(PeerError):
    """A bug in Phalanx prevented reading a peer's bytes; it is logged, and the message is rejected."""

    reason = "defect"


class TooLarge(PeerError):
    """The message is longer than this receiver accepts."""


class MalformedJwe(PeerError):
    """The message is not a compact JWE in the one form that the link accepts."""


class NotAuthentic(PeerError):
    """The tag or signature does not verify: another key was used, or the bytes were altered."""


class MalformedEnvelope(PeerError):
    """The message is authentic, but not a timestamp with a payload (or not a pin message where one is expected)."""


class Stale(PeerError):
    """The timestamp differs from the receiver's clock by more than the tolerance.

    `skew_s` is the timestamp minus the receiver's clock, in seconds. The message was authentic, so a client may use it
    to correct its own clock.
    """

    def __init__(self, skew_s: float, tolerance_s: float) -> None:
        super().__init__(f"timestamp is {skew_s:+.1f} s from our clock, limit {tolerance_s:g} s")
        self.skew_s = skew_s


class Replayed(PeerError):
    """A message with this IV was received before in this epoch."""


class CacheFull(PeerError):
    """The replay cache is full, and no entry is old enough to drop."""


class Overrun(PeerError):
    """Messages arrived faster than they were read; this one was dropped unread."""


class WrongTopic(PeerError):
    """The receiver does not read this topic, or its epoch is over."""


class BadPayload(PeerError):
    """The payload inside the envelope is not valid for the handler."""


class Late(PeerError):
    """A joystick command waited longer in the queue than joystick commands are valid."""


class Held(PeerError):
    """The command moves a robot while the operator's stop of all robots is in force."""


class Unknown(PeerError):
    """The command, request or robot does not exist."""


class HandlerFailed(PeerError):
    """A handler raised an exception on a peer's message: a bug in Phalanx; it is logged, the peer gets no reply."""


class OpenError(PeerError):
    """A sealed message was rejected, for any reason.

    One type for all causes, so that a caller treats them alike. `cause` is the specific error; `reason` is the same.
    """

    def __init__(self, cause: PeerError) -> None:
        super().__init__(str(cause))
        self.cause = cause
        self.reason = cause.reason  # type: ignore[misc]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "did you mean X? " for a hint, or "" if no known name is similar."""
    if RENAMED.get(name) in (known := tuple(known)):
        return f"did you mean {RENAMED[name]}? "
    import difflib  # noqa: PLC0415  # slow to import, and needed for errors only

    lower = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), lower, 1, ALIKE)
    return f"did you mean {lower[near[0]]}? " if near else ""
