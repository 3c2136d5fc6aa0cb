"""Run a coroutine from the command line until it ends or a signal stops it in order: Ctrl-C, `kill`, a closed terminal.

A thread receives the signals, so that they also end a process whose event loop hangs in a user's own code.
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

# Python 3.11's `wait_for` can swallow a cancellation: a task that has not ended by then is cancelled again.
AGAIN_S = 3.0
HUNG_S = 5.0
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)


def run(job: Coroutine[Any, Any, None], hung_s: float = HUNG_S) -> bool:
    """Run `job` and clean up; return whether it ended by itself, and not by a signal of ENDS or SIGHUP.

    If the event loop has not processed the signal after `hung_s`, the process exits with 1, without cleaning up.
    """

    async def watched() -> bool:
        task, loop = asyncio.ensure_future(job), asyncio.get_running_loop()
        stopped = threading.Event()

        def stop() -> None:
            stopped.set()
            task.cancel()
            loop.call_later(AGAIN_S, stop)

        def on_signal() -> None:
            loop.call_soon_threadsafe(stop)
            if not stopped.wait(hung_s):
                sys.stderr.write("phalanx: error: a call did not return after the signal: exit without cleaning up\n")
                sys.stderr.flush()
                os._exit(1)

        with _signals(on_signal), contextlib.suppress(asyncio.CancelledError):
            await task
        return not stopped.is_set()

    return asyncio.run(watched())


@contextlib.contextmanager
def needs_ros2() -> Iterator[None]:
    """Turn a failed import of ROS 2, which is an extra, into an error with a hint. Raises: UsageError."""
    try:
        yield
    except ImportError as error:
        raise UsageError(f"ROS 2 is not installed: {error}", "run pip install '.[ros2]' in a clone") from error


@contextlib.contextmanager
def _signals(on_signal: Callable[[], None]) -> Iterator[None]:
    """Call `on_signal` in a thread at each signal, even if the main thread is in a call that does not return."""
    ends = [*ENDS]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # unless set by nohup
        ends.append(signal.SIGHUP)
    ours, theirs = socket.socketpair()

    def listen() -> None:
        while number := ours.recv(1):
            if number[0] in ends:
                on_signal()

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
