"""Errors of missions: reasons to reject a mission from outside, and errors with their place in an author's file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from phalanx.errors import PeerError, UsageError


class MalformedMission(PeerError):
    """The bytes are not a mission file, start key, payload or claim."""


class Unsigned(PeerError):
    """The mission has no signature, or that of an untrusted key."""


class Altered(PeerError):
    """A decoded record does not fit its mission file: it was changed or moved."""


class NotForUs(PeerError):
    """The mission is restricted to other robots."""


class OutsideWindow(PeerError):
    """The present time is outside the mission's period of validity."""


class AlreadyStarted(PeerError):
    """This robot has started the mission before, and it is not repeatable."""


class Misplaced(UsageError):
    """An error in a mission, with its place in the document.

    Attributes:
        place: path from the top of the document: a string is a key, a number is an index of an item or key, from 0.
    """

    def __init__(self, error: UsageError, *place: str | int) -> None:
        super().__init__(str(error), error.hint)
        self.place: tuple[str | int, ...] = (*place, *(error.place if isinstance(error, Misplaced) else ()))


@contextlib.contextmanager
def under(*place: str | int) -> Iterator[None]:
    """Context that prefixes the place of each UsageError raised in it with `place`."""
    try:
        yield
    except UsageError as error:
        raise Misplaced(error, *place) from error
