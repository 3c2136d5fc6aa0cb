"""What a controller must not do while it is asked: take for ever, sleep, start a thread, look at a file."""

from __future__ import annotations

import contextlib
import inspect
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

from phalanx.robot.controllers.python_controller import OwnMistake, overridden
from phalanx.sim.signals import handled_by

LONGEST_CALL_S = 10.0  # of processor time; of waiting, thrice as much
# What Python tells of before it does it, and what a controller does then.
FORBIDDEN = {
    "open": "opens a file",
    "os.listdir": "reads a folder",
    "os.scandir": "reads a folder",
    "os.system": "starts a program",
    "subprocess.Popen": "starts a program",
    "os.fork": "starts a process",
    "socket.__new__": "opens a socket",
}
# What is done in these is not the controller's doing: modules that are first needed now.
ALLOWED = "importlib"

# What it does not tell of.
UNTOLD: tuple[tuple[Any, str, str], ...] = ((time, "sleep", "sleeps"), (threading.Thread, "start", "starts a thread"))

_calls: list[list[str]] = []  # those that are watched, and what was seen of each


class Endless(OwnMistake):
    """A call that does not return. Nor will it the next time."""


@contextlib.contextmanager
def watched(controller: object, method: str, call: str) -> Iterator[None]:
    """The body asks `controller` this.

    Outside the main thread nobody looks at the time.

    Raises: OwnMistake: it did what it must not, whatever it caught itself. Endless: it did not return.
    """
    _listen()

    def late(_number: int, frame: FrameType | None) -> None:
        if not _is_allowed(frame):
            what = f"{method} has not returned for {LONGEST_CALL_S:g} s ({call})"
            raise Endless(what, "is there a loop that does not end, or does it wait?", controller, method)

    method = overridden(controller, method)
    seen: list[str] = []
    _calls.append(seen)
    with _timed(late):
        try:
            yield
        except Endless:
            seen.clear()
            raise
        finally:
            _calls.pop()
            if seen:
                raise OwnMistake(f"{method} {seen[0]} ({call})", "only its inputs may decide", controller, method)


@contextlib.contextmanager
def _timed(late: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    timers = {signal.ITIMER_VIRTUAL: LONGEST_CALL_S, signal.ITIMER_REAL: 3 * LONGEST_CALL_S}
    with handled_by(late, signal.SIGVTALRM, signal.SIGALRM) as main:
        for timer, seconds in timers.items() if main else ():
            signal.setitimer(timer, seconds, seconds)
        try:
            yield
        finally:
            for timer in timers if main else ():
                signal.setitimer(timer, 0.0)


@cache
def _listen() -> None:
    """From now on we are told. That cannot be taken back, and changes nothing while no call is watched."""
    sys.addaudithook(lambda event, _told: _note(FORBIDDEN.get(event)))
    for owner, name, what in UNTOLD:
        does = getattr(owner, name)

        def told(*args: Any, does: Callable[..., Any] = does, what: str = what) -> Any:
            _note(what)
            return does(*args)

        setattr(owner, name, told)


def _note(what: str | None) -> None:
    if what and _calls and not _is_allowed(inspect.currentframe()):
        _calls[-1].append(what)
        raise PermissionError(what)


def _is_allowed(frame: FrameType | None) -> bool:
    while frame:
        if any(part.startswith(ALLOWED) for part in Path(frame.f_code.co_filename.strip("<>")).parts):
            return True
        frame = frame.f_back
    return False
