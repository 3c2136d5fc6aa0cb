"""Temporary signal handlers."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

Handler = Callable[[int, FrameType | None], object] | signal.Handlers


@contextlib.contextmanager
def handled_by(handler: Handler, *numbers: signal.Signals) -> Iterator[bool]:
    """Send these signals to `handler` in the body of this context; restore the previous handlers afterwards.

    Outside the main thread, which alone receives signals, this yields False and does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield False
        return
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield True
    finally:
        for number, was in before.items():
            signal.signal(number, was)
