"""Whose fault an error is, which decides what the caller does next.

`PeerError`: bytes from outside are wrong. Expected under attack: counted by `reason`, survived, never answered.
`UsageError`: we were called wrongly; one clear line to a person, who can mend it.
`Unavailable`: the world said no (a broker, a port); one clear line, and trying again may help.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import ClassVar

ALIKE = 0.6  # so alike, a name is what was meant
RENAMED = {"bound": "hardened", "frames": "packets", "frame_max_bytes": "packet_max_bytes"}  # names of earlier releases


class PhalanxError(Exception):
    """Anything that Phalanx raises on purpose."""


class _Told(PhalanxError):
    """For a person to read: what is wrong and where, lower case, no full stop; and what to do about it, or ""."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(_Told):
    """The caller can mend this: a bad value, a missing file, a port in use.

    Class attributes:
        exit_code: of the command line.
    """

    exit_code: ClassVar[int] = 2


class Unavailable(_Told):
    """The world said no: a broker that cannot be reached, a port in use, a swarm that does not answer."""


class KernelDefect(_Told):
    """A compiled function would have left an array or divided by zero: a defect of ours; file and line say where."""


class OwnDefect(KernelDefect):
    """A function of a user's file would have left an array or divided by zero, or returned what it must not."""


class OwnFileError(UsageError):
    """A user's file does what it must not; file and line say where."""

    exit_code = 1


class OutsideSubset(OwnFileError):
    """A user's file uses what cannot be compiled."""


class PeerError(PhalanxError):
    """Bytes from a peer are wrong.

    Class attributes:
        reason: under which it is counted: the class's name in small letters, if the class sets no other.
    """

    reason: ClassVar[str] = "peer_error"

    def __init_subclass__(cls) -> None:
        if "reason" not in vars(cls):
            cls.reason = re.sub("(?<=.)(?=[A-Z])", "_", cls.__name__).lower()


class Defective(PeerError):
    """A defect of ours kept us from reading a peer's bytes; it is logged, and the message is rejected."""

    reason = "defect"


class TooLarge(PeerError):
    """More bytes than this receiver reads."""


class MalformedJwe(PeerError):
    """Not the one compact JWE form that the link speaks."""


class NotAuthentic(PeerError):
    """The tag does not verify: another key, or altered on the way."""


class MalformedEnvelope(PeerError):
    """Authentic, but not a timestamp with a payload (or not a pin message, where one was due)."""


class Stale(PeerError):
    """The timestamp is further from now than the tolerance. `skew_s` is it minus our clock, seconds: the message was
    authentic, so a client may take this for the error of its own clock.
    """

    def __init__(self, skew_s: float, tolerance_s: float) -> None:
        super().__init__(f"timestamp is {skew_s:+.1f} s from our clock, limit {tolerance_s:g} s")
        self.skew_s = skew_s


class Replayed(PeerError):
    """This epoch has seen this IV before."""


class CacheFull(PeerError):
    """The replay cache cannot remember one more message, and must not forget one."""


class Overrun(PeerError):
    """Arrived faster than they were read; dropped unread."""


class WrongTopic(PeerError):
    """Not a topic that this receiver reads, or not one of a live epoch."""


class BadPayload(PeerError):
    """The words inside the envelope make no sense to the handler."""


class Late(PeerError):
    """A joystick's command that lay here unread for longer than a joystick's word is good for."""


class Held(PeerError):
    """The operator has stopped all robots: nobody moves one now."""


class Unknown(PeerError):
    """No such command, request or robot."""


class HandlerFailed(PeerError):
    """A handler broke on what a peer said. The peer hears nothing; the fault is ours, and logged as such."""


class OpenError(PeerError):
    """A sealed message was refused. One type, whatever went wrong: `cause` is the specific error, whose reason this
    has.
    """

    def __init__(self, cause: PeerError) -> None:
        super().__init__(str(cause))
        self.cause = cause
        self.reason = cause.reason  # type: ignore[misc]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `did you mean X? ` for a hint, or nothing if no known name is like it."""
    if RENAMED.get(name) in (known := tuple(known)):
        return f"did you mean {RENAMED[name]}? "
    import difflib  # noqa: PLC0415  # only who errs waits for it

    lower = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), lower, 1, ALIKE)
    return f"did you mean {lower[near[0]]}? " if near else ""
