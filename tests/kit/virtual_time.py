"""An event loop in which waiting takes no time: what is on the way on loopback arrives before the clock goes on."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Coroutine
from typing import Any

BEGAN_S = 1000.0
THREADS_S = 0.01  # without a timer something else, a thread or a child, is waited for


class _Selector(selectors.DefaultSelector):
    loop: VirtualLoop

    def select(self, timeout=None):
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            return super().select(THREADS_S)
        self.loop.now_s += max(timeout, 0.0)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """The loop; its clock is `time.monotonic` while `run_in_virtual_time` runs."""

    def __init__(self) -> None:
        self.now_s = BEGAN_S
        selector = _Selector()
        selector.loop = self
        super().__init__(selector)

    def time(self) -> float:
        return self.now_s


def run_in_virtual_time(job: Coroutine[Any, Any, Any], monkeypatch) -> Any:
    """Return what a job returns."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner, monkeypatch.context() as patch:
        loop = runner.get_loop()
        patch.setattr(time, "monotonic", loop.time)
        patch.setattr(time, "monotonic_ns", lambda: round(loop.time() * 1e9))
        return runner.run(job)
