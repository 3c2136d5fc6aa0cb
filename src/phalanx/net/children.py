"""Child processes: they end with this process, are restarted when they fail, and their stderr goes to the log."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import logging
import os
import resource
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial

from phalanx.errors import Unavailable

log = logging.getLogger(__name__)

Child = AbstractAsyncContextManager[asyncio.subprocess.Process]

PR_SET_PDEATHSIG = 1
COMPLAINT_BYTES, COMPLAINTS_APART_S = 500, 1.0
END_TIMEOUT_S = 1.0
RESTART_S = 0.3
PROBE_EVERY_S, PROBE_TIMEOUT_S, PROBES = 1.0, 3.0, 2
BEGINS_WITHIN_S = 20.0  # time to start on a busy machine, before a child counts as hanging


def die_with_parent(most_bytes: int = 0) -> None:
    """In a child: end when the parent does, even if that is killed; limit the memory to `most_bytes`, if not 0."""
    if most_bytes:
        resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def end_with_parent(parent: int) -> None:
    """In a Python child, first of all: end when the parent does, or now if it has ended already."""
    die_with_parent()
    if os.getppid() != parent:
        sys.exit()


def run_python_child(module: str, *arguments: str, pass_fds: Sequence[int] = ()) -> Child:
    """Start a module of phalanx as a child; its first argument is the parent's process id, for `end_with_parent`.

    This needs no `preexec_fn`, for which Python would copy the gateway's memory while the event loop waits.
    """
    return run_child(sys.executable, "-m", module, str(os.getpid()), *arguments, pass_fds=pass_fds, forks=False)


@contextlib.asynccontextmanager
async def run_child(
    *arguments: str, user: str | None = None, pass_fds: Sequence[int] = (), most_bytes: int = 0, forks: bool = True
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run a program, and end it when the context is left."""
    process = await asyncio.create_subprocess_exec(
        *arguments,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,  # Ctrl-C in the terminal ends only this process, which ends the child at last
        # Otherwise the child would outlive a killed gateway.
        preexec_fn=partial(die_with_parent, most_bytes) if forks else None,
        user=user,
        pass_fds=pass_fds,
    )
    try:
        yield process
    finally:
        try:
            with contextlib.suppress(ProcessLookupError, TimeoutError):
                process.terminate()
                await asyncio.wait_for(process.wait(), END_TIMEOUT_S)
        finally:  # also after another cancellation
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            # `wait` alone would leave the pipe open until the garbage collector finds it, after the event loop's end.
            await process.communicate()


async def answer(host: str, port: int, said: bytes, length: int) -> bytes | None:
    """Send `said`, and return `length` bytes of the answer; b"" if it is missing or late, None if out of resources."""
    writer = None
    try:  # closed explicitly, because no connection may outlive a cancellation
        async with asyncio.timeout(PROBE_TIMEOUT_S):
            reader, writer = await asyncio.open_connection(host, port)
            writer.write(said)
            return await reader.readexactly(length)
    except (TimeoutError, asyncio.IncompleteReadError, ConnectionError):
        return b""
    except OSError:  # out of files or ports on this side: no statement about the server
        return None
    finally:
        if writer is not None:
            writer.transport.abort()


Probe = Callable[[], Awaitable[bool | None]]  # returns whether a child serves; None: unknown
Begins = Callable[[asyncio.subprocess.Process], Awaitable[None]]


@contextlib.asynccontextmanager
async def supervise_child(
    name: str, child: Callable[[], Child], serves: Probe, begins: Begins | None = None
) -> AsyncIterator[None]:
    """Keep a child running; `begins`, if given, waits until it serves. Raises: Unavailable: it does not start."""
    begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    keeper = asyncio.create_task(_keep(name, child, serves, begins, begun))
    try:
        await asyncio.wait((keeper, begun), return_when=asyncio.FIRST_COMPLETED)
        if keeper.done():
            try:
                keeper.result()
            except OSError as error:
                raise Unavailable(f"{name} does not start: {error.strerror}", "run phalanx doctor") from error
        yield
    finally:
        keeper.cancel()
        await asyncio.gather(keeper, return_exceptions=True)


async def _keep(
    name: str, child: Callable[[], Child], serves: Probe, begins: Begins | None, begun: asyncio.Future[None]
) -> None:
    while True:
        try:
            async with child() as process:
                if begins:
                    await begins(process)
                if not begun.done():
                    begun.set_result(None)
                watching = asyncio.create_task(_watch(name, process, serves, serves_already=begins is not None))
                try:
                    await _repeat(process, name)
                finally:
                    watching.cancel()
                log.warning("%s ended (%s); restarting it", name, await process.wait())
        except (Unavailable, OSError) as error:  # OSError: out of files or processes, perhaps temporarily
            if not begun.done():
                raise
            log.error("%s; trying again", error)  # noqa: TRY400  # a traceback would add nothing
            await asyncio.sleep(1)
        await asyncio.sleep(RESTART_S)


async def _repeat(process: asyncio.subprocess.Process, name: str) -> None:
    """Log a child's stderr until it ends; at most a line per second, because strangers can cause messages."""
    assert process.stderr is not None
    quiet_until_s = 0.0
    while raw := await process.stderr.read(COMPLAINT_BYTES):
        if time.monotonic() >= quiet_until_s:
            line = raw.decode(errors="replace").strip()
            log.warning("%s: %s", name, "".join(c if c.isprintable() else " " for c in line))
            quiet_until_s = time.monotonic() + COMPLAINTS_APART_S


async def _watch(name: str, process: asyncio.subprocess.Process, serves: Probe, *, serves_already: bool) -> None:
    """Kill a child that no longer serves, because it is stopped or out of memory. Runs until cancelled."""
    failures, patient_until_s = 0, time.monotonic() + BEGINS_WITHIN_S
    while failures < PROBES or not (serves_already or time.monotonic() > patient_until_s):
        await asyncio.sleep(PROBE_EVERY_S)
        does = await serves()
        serves_already = serves_already or bool(does)
        if does is not None:
            failures = 0 if does else failures + 1
    log.warning("%s does not serve", name)
    with contextlib.suppress(ProcessLookupError):
        process.kill()  # a stopped process reacts to no other signal
