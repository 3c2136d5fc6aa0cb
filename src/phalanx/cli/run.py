"""Running a coroutine from the command line: Ctrl-C, `kill` and a terminal that closes end it in order."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Coroutine
from typing import Any

# Python 3.11's `wait_for` can swallow a cancellation: who has not ended by then is told again.
AGAIN_S = 3.0


def run(job: Coroutine[Any, Any, None]) -> bool:
    """Run `job`; true if it came to its end, false if Ctrl-C, SIGTERM or SIGHUP stopped it, after cleaning up."""

    async def watched() -> bool:
        task = asyncio.ensure_future(job)
        stopped = False

        def stop() -> None:
            nonlocal stopped
            stopped = True
            task.cancel()
            loop.call_later(AGAIN_S, stop)

        loop = asyncio.get_running_loop()
        ends = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup has it
            ends.append(signal.SIGHUP)
        for number in ends:
            loop.add_signal_handler(number, stop)
        with contextlib.suppress(asyncio.CancelledError):
            await task
        return not stopped

    return asyncio.run(watched())
