"""Signals that go elsewhere for a while."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

Handler = Callable[[int, FrameType | None], object] | signal.Handlers


@contextlib.contextmanager
def handled_by(handler: Handler, *numbers: signal.Signals) -> Iterator[bool]:
    """While the body runs, these signals go to `handler`; afterwards to whom they went before.

    False, and nothing changes, outside the main thread, which alone is sent signals.
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
