"""Children of ours: they end when we do, and what they complain of is in our log."""

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
BEGINS_WITHIN_S = 20.0  # on a busy machine it takes its time to begin; one that hangs before is no other


def die_with_parent(most_bytes: int = 0) -> None:
    """Have the calling child end when we do, even if we are killed outright; limit its memory to `most_bytes`."""
    if most_bytes:
        resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def end_with(parent: int) -> None:
    """Called in a child that is a program of ours, first of all: it ends when its parent does."""
    die_with_parent()
    if os.getppid() != parent:
        sys.exit()


def a_python_child(module: str, *words: str, pass_fds: Sequence[int] = ()) -> Child:
    """A module of ours as a child, which is told our process's number first, and calls `end_with` with that.

    So it needs no `preexec_fn`: for that Python copies a gateway's memory, and the event loop waits for it.
    """
    return a_child(sys.executable, "-m", module, str(os.getpid()), *words, pass_fds=pass_fds, forks=False)


@contextlib.asynccontextmanager
async def a_child(
    *words: str, user: str | None = None, pass_fds: Sequence[int] = (), most_bytes: int = 0, forks: bool = True
) -> AsyncIterator[asyncio.subprocess.Process]:
    """A program that is gone when the context is left, in whatever way, and its pipe closed."""
    process = await asyncio.create_subprocess_exec(
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,  # Ctrl-C in the terminal is for us; we end it when the last message is out
        # Or a gateway that is killed outright left it behind.
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
        finally:  # also if we are cancelled once more meanwhile
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            # Waiting alone would leave the pipe to the garbage collector, which finds the event loop closed.
            await process.communicate()


async def answer(host: str, port: int, said: bytes, length: int) -> bytes | None:
    """Return so many bytes that answer `said`; b"" if they do not come in time, None if we could not even ask."""
    writer = None
    try:  # by hand, for nothing of it may outlive a cancellation
        async with asyncio.timeout(PROBE_TIMEOUT_S):
            reader, writer = await asyncio.open_connection(host, port)
            writer.write(said)
            return await reader.readexactly(length)
    except (TimeoutError, asyncio.IncompleteReadError, ConnectionError):
        return b""
    except OSError:  # we are out of files or of ports: that says nothing of who listens there
        return None
    finally:
        if writer is not None:
            writer.transport.abort()


Probe = Callable[[], Awaitable[bool | None]]  # whether a child serves, or None if nobody knows
Begins = Callable[[asyncio.subprocess.Process], Awaitable[None]]


@contextlib.asynccontextmanager
async def kept(
    name: str, child: Callable[[], Child], serves: Probe, begins: Begins | None = None
) -> AsyncIterator[None]:
    """Keep a child running; `begins`, if given, waits until it serves. Raises: Unavailable: it does not begin."""
    begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    keeper = asyncio.create_task(_keep(name, child, serves, begins, begun))
    try:
        await asyncio.wait((keeper, begun), return_when=asyncio.FIRST_COMPLETED)
        if keeper.done():
            try:
                keeper.result()
            except OSError as error:
                raise Unavailable(f"{name} does not start: {error.strerror}", "phalanx doctor") from error
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
                log.warning("%s ended (%s); starting it again", name, await process.wait())
        except (Unavailable, OSError) as error:  # OSError: out of files or processes, for the moment
            if not begun.done():
                raise
            log.error("%s; trying again", error)  # noqa: TRY400  # the trace says nothing more
            await asyncio.sleep(1)
        await asyncio.sleep(RESTART_S)


async def _repeat(process: asyncio.subprocess.Process, name: str) -> None:
    """Log what it complains of, until it ends; not all of it, for strangers can make it complain of them."""
    assert process.stderr is not None
    quiet_until_s = 0.0
    while said := await process.stderr.read(COMPLAINT_BYTES):
        if time.monotonic() >= quiet_until_s:
            line = said.decode(errors="replace").strip()
            log.warning("%s: %s", name, "".join(c if c.isprintable() else " " for c in line))
            quiet_until_s = time.monotonic() + COMPLAINTS_APART_S


async def _watch(name: str, process: asyncio.subprocess.Process, serves: Probe, *, serves_already: bool) -> None:
    """End one that lives but serves no longer: stopped, or its memory full. Runs until cancelled."""
    failures, patient_until_s = 0, time.monotonic() + BEGINS_WITHIN_S
    while failures < PROBES or not (serves_already or time.monotonic() > patient_until_s):
        await asyncio.sleep(PROBE_EVERY_S)
        does = await serves()
        serves_already = serves_already or bool(does)
        if does is not None:
            failures = 0 if does else failures + 1
    log.warning("%s does not serve", name)
    with contextlib.suppress(ProcessLookupError):
        process.kill()  # a stopped process hears nothing else
