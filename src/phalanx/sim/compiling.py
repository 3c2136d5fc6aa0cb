"""Tells how far the compilation of robots' code is: the first time it takes minutes, and nothing else can be seen."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

_EVENT: Any = event  # untyped
# A kernel alone takes less than a second: nobody has to hear of that.
PATIENCE_S = 1.0


class _Watch(_EVENT.Listener):  # type: ignore[misc]
    def __init__(self, tell: Callable[[str, float], None]) -> None:
        self._tell = tell
        self._needed: set[Any] = set()
        self._depth = 0  # kernels compile those that they call
        self._since_s = self._spent_s = 0.0

    def on_start(self, event: Any) -> None:
        now_s = time.monotonic()
        if self._depth == 0:
            self._since_s = now_s
            self._needed |= {each for each in _called_by(event.data["dispatcher"]) if not each.overloads}
        self._depth += 1
        self._say(now_s)

    def on_end(self, _event: Any) -> None:
        self._depth -= 1
        now_s = time.monotonic()
        if self._depth:
            self._say(now_s)
        else:
            self._spent_s += now_s - self._since_s

    def _say(self, now_s: float) -> None:
        if self._spent_s + now_s - self._since_s >= PATIENCE_S:
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
    watch = _Watch(tell)
    _EVENT.register("numba:compile", watch)
    try:
        yield
    finally:
        _EVENT.unregister("numba:compile", watch)
