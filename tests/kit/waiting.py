"""Wait in real time: for a condition, and for how long an event loop's longest turn took."""

from __future__ import annotations

import asyncio
import gc
import time

import pytest

# The test that runs; conftest.py sets it.
RUNNING: list[pytest.Item] = []


def in_real_time():
    """Whoever waits beside tests that compute would be late."""
    marks = {mark.name for mark in RUNNING[0].iter_markers()}
    assert marks & {"waits", "alone"}, "mark this test as one that `waits` (CONTRIBUTING.md)"


async def eventually(condition, timeout_s: float = 10.0, every_s: float = 0.02):
    """Wait until `condition()` is true, and say which one never was."""
    deadline = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout_s} s: {getattr(condition, '__name__', condition)}"
        await asyncio.sleep(every_s)
    return value


def wait_until(condition, timeout_s: float = 10.0):
    """`eventually`, for tests without an event loop."""
    deadline = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout_s} s"
        time.sleep(0.02)
    return value


class Turns:
    """The longest turn of this event loop, in seconds of processor time: what others do with the machine is not in it."""

    def __init__(self) -> None:
        # As a command does before it starts (runs, cli/options.py): all that pytest holds takes long to be looked through.
        gc.collect()
        gc.freeze()
        self.longest_s, self._before_s = 0.0, time.thread_time()
        asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        now_s = time.thread_time()
        self.longest_s, self._before_s = max(self.longest_s, now_s - self._before_s), now_s
        asyncio.get_running_loop().call_later(0.001, self._turn)
