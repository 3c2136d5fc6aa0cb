"""A complaint about a part of a mission, and where in its file that part stands."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from phalanx.errors import UsageError


class Misplaced(UsageError):
    """What was told, of a part.

    Attributes:
        place: the way to that part from the top: a text is a key, a number counts items or keys from 0.
    """

    def __init__(self, told: UsageError, *place: str | int) -> None:
        super().__init__(str(told), told.hint)
        self.place: tuple[str | int, ...] = (*place, *(told.place if isinstance(told, Misplaced) else ()))


@contextlib.contextmanager
def under(*place: str | int) -> Iterator[None]:
    """What is complained of in this context stands there."""
    try:
        yield
    except UsageError as error:
        raise Misplaced(error, *place) from error
