"""Tells that robots' code is being compiled, which the first time takes minutes in which nothing else can be seen."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event

_EVENT: Any = event  # untyped
# A kernel alone takes less than a second: nobody has to hear of that.
PATIENCE_S, EVERY_S = 1.0, 15.0


class _Watch(_EVENT.Listener):  # type: ignore[misc]
    def __init__(self, talk: Callable[[str], None]) -> None:
        self._talk = talk
        self._depth = 0  # kernels compile those that they call
        self._since_s = self._spent_s = 0.0
        self._due_s = PATIENCE_S

    def on_start(self, _event: Any) -> None:
        now_s = time.monotonic()
        if self._depth == 0:
            self._since_s = now_s
        self._depth += 1
        for_s = self._spent_s + now_s - self._since_s
        if for_s >= self._due_s:
            self._talk(f"compiling what robots run; it takes minutes, and only the first time: {for_s:.0f} s")
            self._due_s = for_s + EVERY_S

    def on_end(self, _event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._spent_s += time.monotonic() - self._since_s


@contextlib.contextmanager
def telling_of_compiling(talk: Callable[[str], None]) -> Iterator[None]:
    """While the body runs, `talk` hears in a line now and then of kernels that this process compiles.

    Nothing is said of kernels that are found on disk, however slow the machine is.
    """
    watch = _Watch(talk)
    _EVENT.register("numba:compile", watch)
    try:
        yield
    finally:
        _EVENT.unregister("numba:compile", watch)
