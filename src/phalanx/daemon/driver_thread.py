"""Call a driver in a separate thread: a call that hangs delays neither the robot's audits nor the daemon's exit.

The motors stop when either side hangs. If the driver hangs, the daemon calls `stop` from a third thread. If the daemon
hangs (in a controller, a planner, trusted nodes), this thread calls `stop` after HUNG_S. A C extension that holds
Python's lock prevents both; then only the motors' own watchdog helps, as after kill -9.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import TypeVar

log = logging.getLogger(__name__)

_T = TypeVar("_T")
HUNG_S = 0.25  # longer than any audit; with the stop, under half a second
LOOK_S = 0.05
SOON_S = 0.1  # time for the running call to return before a stop
END_S = 0.3  # time limit of the last stop
CLOSE_S = 2.0
STOP = "stop"


class DriverThread:
    """Runs calls one after another. `stop` stops the motors until the next `drive`, even if a call hangs."""

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._calls: SimpleQueue[tuple[str, Callable[[], None]]] = SimpleQueue()
        self._running = ""  # name of the running call
        self._stopped = True
        self._failed: BaseException | None = None
        self._alive_s = time.monotonic()
        self._over = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="driver")
        self._thread.start()

    def alive(self) -> None:
        """Note that the daemon does not hang, so the motors may continue."""
        self._alive_s = time.monotonic()

    async def ask(self, name: str, call: Callable[[], _T], timeout_s: float) -> _T:
        """Run a call in the thread, and return its result.

        Raises: TimeoutError: a call hangs; exceptions of this call, or of a `drive` before it.
        """
        if failed := self._failed:
            self._failed = None
            raise failed
        if self._running and self._running != STOP:
            raise TimeoutError(f"{self._running} has not returned")
        answer = self._submit(name, call)
        try:
            async with asyncio.timeout(timeout_s):
                return await asyncio.wrap_future(answer)
        except TimeoutError:
            if answer.done() and not answer.cancelled():  # the driver raised it
                raise
            raise TimeoutError(f"{self._running or name} has not returned") from None

    def drive(self, call: Callable[[], None]) -> None:
        """Enqueue a call that moves the motors; its exception is raised by the next `ask`."""
        self._stopped = False
        self._calls.put(("drive", lambda: self._drive(call)))

    def stop(self) -> threading.Event:
        """Stop the motors, even if a call hangs. Return an event that is set once the driver's `stop` has returned."""
        self._stopped, done = True, threading.Event()
        self._calls.put((STOP, lambda: self._do_stop(done)))  # again after a hanging call, which could still move them
        threading.Thread(target=self._stop_beside, args=(done,), daemon=True).start()
        return done

    def close(self, call: Callable[[], None]) -> None:
        """Stop the motors, run a last call, and end the thread, or abandon it if it hangs. Idempotent."""
        if self._over:
            return
        self._over = True
        if not self.stop().wait(END_S + SOON_S):
            log.error("the driver's stop did not return within %g s", END_S + SOON_S)
        if self._running not in ("", STOP):
            return
        answer = self._submit("close", call)
        self._calls.put(("", lambda: None))
        self._thread.join(CLOSE_S)
        if answer.done() and (error := answer.exception()):
            raise error

    def _submit(self, name: str, call: Callable[[], _T]) -> Future[_T]:
        answer: Future[_T] = Future()

        def run() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                result = call()
            except BaseException as error:  # noqa: BLE001 - raised by `ask`
                self._running = ""
                answer.set_exception(_raisable(error))
            else:
                self._running = ""  # before the result: its receiver may call again at once
                answer.set_result(result)

        self._calls.put((name, run))
        return answer

    # --- run in the threads -- ----------------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            try:
                self._running, call = self._calls.get(timeout=LOOK_S)
            except Empty:
                self._watch()
                continue
            if not self._running:
                return
            call()
            self._running = ""

    def _watch(self) -> None:
        if not self._stopped and time.monotonic() - self._alive_s > HUNG_S:
            log.error("the daemon hangs: stopping the motors")
            self._stopped = True
            self._do_stop(threading.Event())

    def _drive(self, call: Callable[[], None]) -> None:
        if self._stopped:
            return
        try:
            call()
        except BaseException as error:  # noqa: BLE001 - raised by the next `ask`
            self._failed, self._stopped = _raisable(error), True
            self._do_stop(threading.Event())

    def _stop_beside(self, done: threading.Event) -> None:
        if not done.wait(SOON_S):
            self._do_stop(done)

    def _do_stop(self, done: threading.Event) -> None:
        try:
            self._stop()
        except Exception:
            log.exception("the driver's stop failed")
        done.set()


def _raisable(error: BaseException) -> BaseException:
    """Return an exception to raise instead: an event loop interprets these types as the end of its own tasks."""
    if isinstance(error, StopIteration | GeneratorExit | asyncio.CancelledError):
        return RuntimeError(repr(error)).with_traceback(error.__traceback__)
    return error
