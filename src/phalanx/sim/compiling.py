"""Tells how far the compilation of robots' code is: the first time it takes minutes, and nothing else can be seen."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

try:
    from numba.core import event
    from numba.core.dispatcher import Dispatcher
except ImportError:  # a numba that is another inside: nobody hears of its compiling
    event = None  # type: ignore[assignment]

_EVENT: Any = event  # untyped
# A kernel alone takes less than a second: nobody has to hear of that.
PATIENCE_S = 1.0


class _Clock(_EVENT.Listener if _EVENT else object):  # type: ignore[misc]
    """Adds up what compiling takes."""

    def __init__(self) -> None:
        self.depth = 0  # kernels compile those that they call
        self.now_s = self.since_s = self.spent_s = 0.0

    def on_start(self, _event: Any) -> None:
        self.now_s = time.perf_counter()
        if self.depth == 0:
            self.since_s = self.now_s
        self.depth += 1

    def on_end(self, _event: Any) -> None:
        self.depth -= 1
        self.now_s = time.perf_counter()
        if self.depth == 0:
            self.spent_s += self.now_s - self.since_s


_CLOCK = _Clock()
if _EVENT:
    _EVENT.register("numba:compile", _CLOCK)


def working_s() -> float:
    """A stopwatch that stands still while a kernel is being compiled."""
    return time.perf_counter() - _CLOCK.spent_s


class _Watch(_Clock):
    def __init__(self, tell: Callable[[str, float], None]) -> None:
        super().__init__()
        self._tell = tell
        self._needed: set[Any] = set()

    def on_start(self, event: Any) -> None:
        if self.depth == 0:
            self._needed |= {each for each in _called_by(event.data["dispatcher"]) if not each.overloads}
        super().on_start(event)
        self._say()

    def on_end(self, event: Any) -> None:
        super().on_end(event)
        if self.depth:
            self._say()

    def _say(self) -> None:
        if self.spent_s + self.now_s - self.since_s >= PATIENCE_S:
            ready, of = sum(bool(each.overloads) for each in self._needed), len(self._needed)
            self._tell(f"compiling what robots run, only this time: {ready} of about {of} functions", ready / of)


def _called_by(kernel: Any) -> set[Any]:
    """The kernel, and all that it calls, directly or not."""
    found, todo = {kernel}, [kernel]
    while todo:
        function = todo.pop().py_func
        names, here = function.__code__.co_names, function.__globals__
        modules = [vars(here[name]) for name in names if isinstance(here.get(name), ModuleType)]
        called = (place.get(name) for place in (here, *modules) for name in names)
        new = {each for each in called if isinstance(each, Dispatcher)} - found
        found |= new
        todo += new
    return found


@contextlib.contextmanager
def telling_of_compiling(tell: Callable[[str, float], None]) -> Iterator[None]:
    """While the body runs, `tell` hears how many of the kernels that it needs are ready, in words and as a share.

    It hears of it once a second has been spent on compiling, and nothing where all is found on disk, however slow the
    machine is. That there are about so many: which kernels one calls is read from names.
    """
    if not _EVENT:
        yield
        return
    watch = _Watch(tell)
    _EVENT.register("numba:compile", watch)
    try:
        yield
    finally:
        _EVENT.unregister("numba:compile", watch)
