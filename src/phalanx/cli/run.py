"""Running a coroutine from the command line: Ctrl-C, `kill` and a terminal that closes end it in order.

A thread hears the signals, so that they also end a process whose event loop hangs in somebody's own code.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from phalanx.errors import UsageError

# Python 3.11's `wait_for` can swallow a cancellation: who has not ended by then is told again.
AGAIN_S = 3.0
HUNG_S = 5.0
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)


def run(job: Coroutine[Any, Any, None], hung_s: float = HUNG_S) -> bool:
    """Run `job`; return whether it came to its end, and no signal of ENDS or SIGHUP stopped it, after cleaning up.

    A process whose event loop has not heard of the signal after `hung_s` ends with 1, without cleaning up.
    """

    async def watched() -> bool:
        task, loop = asyncio.ensure_future(job), asyncio.get_running_loop()
        stopped = threading.Event()

        def stop() -> None:
            stopped.set()
            task.cancel()
            loop.call_later(AGAIN_S, stop)

        def hear() -> None:
            loop.call_soon_threadsafe(stop)
            if not stopped.wait(hung_s):
                sys.stderr.write("phalanx: error: a call has not returned: the process ends without it\n")
                sys.stderr.flush()
                os._exit(1)

        with _signals(hear), contextlib.suppress(asyncio.CancelledError):
            await task
        return not stopped.is_set()

    return asyncio.run(watched())


@contextlib.contextmanager
def needs_ros2() -> Iterator[None]:
    """Import ROS 2, which is an extra. Raises: UsageError: it is not installed."""
    try:
        yield
    except ImportError as error:
        raise UsageError(f"ROS 2 is not installed: {error}", "pip install '.[ros2]' in a clone") from error


@contextlib.contextmanager
def _signals(hear: Callable[[], None]) -> Iterator[None]:
    """Call `hear` in a thread at each signal, even while the main thread is in a call that does not return."""
    ends = [*ENDS]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup has it
        ends.append(signal.SIGHUP)
    ours, theirs = socket.socketpair()

    def listen() -> None:
        while number := ours.recv(1):
            if number[0] in ends:
                hear()

    theirs.setblocking(False)
    thread = threading.Thread(target=listen, daemon=True, name="signals")
    thread.start()
    fd = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    before = {number: signal.signal(number, lambda *_: None) for number in ends}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(fd)
        theirs.close()
        thread.join()
        ours.close()
