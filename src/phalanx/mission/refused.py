"""Errors of missions: why one from outside is refused, and which part of an author's file is wrong."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from phalanx.errors import PeerError, UsageError


class MalformedMission(PeerError):
    """Not the bytes of a mission file, a start key or a payload."""


class Unsigned(PeerError):
    """Nobody signed this mission, or somebody who is not trusted."""


class Altered(PeerError):
    """A decoded record does not fit its file: it was changed or moved."""


class NotForUs(PeerError):
    """The mission names other robots."""


class OutsideWindow(PeerError):
    """The mission begins later, or is over."""


class AlreadyStarted(PeerError):
    """This robot has started this mission before, and it may be started once."""


class Misplaced(UsageError):
    """An error inside one part of a mission, with its place.

    Attributes:
        place: the way to that part from the top: a text is a key, a number counts items or keys from 0.
    """

    def __init__(self, told: UsageError, *place: str | int) -> None:
        super().__init__(str(told), told.hint)
        self.place: tuple[str | int, ...] = (*place, *(told.place if isinstance(told, Misplaced) else ()))


@contextlib.contextmanager
def under(*place: str | int) -> Iterator[None]:
    """Prefix errors raised in this context with their place."""
    try:
        yield
    except UsageError as error:
        raise Misplaced(error, *place) from error
