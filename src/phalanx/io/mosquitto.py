"""mosquitto as a supervised child: started with a configuration of ours, started again when it dies."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import logging
import os
import pwd
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path

from phalanx.errors import Unavailable

from .ports import LOOPBACK

log = logging.getLogger(__name__)

# Our own packets are small, an older page's list the largest; one of these holds up a phone's websocket for seconds.
EMBEDDED_PACKET_BYTES = 512 * 1024
MEMORY_BYTES = 256 * 1024 * 1024
START_TIMEOUT_S = 5.0
RESTART_S = 0.3
END_TIMEOUT_S = 1.0
PR_SET_PDEATHSIG = 1


def find_mosquitto() -> str | None:
    """Path of the mosquitto program; Debian puts it where only root's PATH looks."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def configuration(tcp_port: int, ws_host: str, ws_port: int) -> str:
    """mosquitto.conf: TCP for the gateway on loopback, websockets for browsers where asked."""
    return "\n".join(
        (
            "# written by phalanx",
            "per_listener_settings false",
            "allow_anonymous true",  # nobody trusts the broker; the messages are sealed
            "persistence false",
            "retain_available false",
            "sys_interval 0",
            f"max_packet_size {EMBEDDED_PACKET_BYTES}",
            # Clients that subscribe and never read would otherwise be given all the memory there is.
            f"memory_limit {MEMORY_BYTES}",
            "max_queued_messages 1000",
            "max_inflight_messages 100",
            "set_tcp_nodelay true",
            "log_dest stderr",
            "log_type error",
            "log_type warning",
            "connection_messages false",
            f"listener {tcp_port} {LOOPBACK}",
            "max_connections 200",
            f"listener {ws_port} {ws_host}",
            "protocol websockets",
            # Without it mosquitto 2.0.11 (Debian 12) ignores the address and listens for everybody.
            f"socket_domain {'ipv6' if ':' in ws_host else 'ipv4'}",
            "max_connections 1000",
            "",
        )
    )


def _whose() -> str | None:
    """As whom to run it. mosquitto gives up root by itself, but that would undo what `_die_with_parent` asks for."""
    if os.geteuid() != 0:
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return "mosquitto" if "mosquitto" in names else "nobody"


def _die_with_parent() -> None:
    # A gateway that is killed outright must not leave a broker behind.
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


@contextlib.asynccontextmanager
async def mosquitto(tcp_port: int, ws_host: str, ws_port: int) -> AsyncIterator[None]:
    """A running mosquitto, for as long as the context lasts.

    Raises: Unavailable: not installed, or it does not start (a port taken, say).
    """
    program = find_mosquitto()
    if program is None:
        raise Unavailable("mosquitto is not installed", "apt-get install mosquitto, or --broker amqtt")
    if ":" in ws_host and ws_host != "::":
        raise Unavailable(f"mosquitto cannot serve browsers at {ws_host} alone", "--host :: or --broker amqtt")
    with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
        path = Path(folder) / "mosquitto.conf"
        path.write_text(configuration(tcp_port, ws_host, ws_port))
        path.chmod(0o644)
        os.chmod(folder, 0o755)  # noqa: PTH101, S103  # nothing secret in it, and the broker may run as another user
        listens: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        keeper = asyncio.create_task(_keep(program, path, tcp_port, listens))
        try:
            await asyncio.wait((keeper, listens), return_when=asyncio.FIRST_COMPLETED)
            if keeper.done():
                keeper.result()
            yield
        finally:
            keeper.cancel()
            await asyncio.gather(keeper, return_exceptions=True)


async def _keep(program: str, path: Path, tcp_port: int, listens: asyncio.Future[None]) -> None:
    while True:
        try:
            async with _child(program, path) as process:
                await _until_it_listens(process, tcp_port)
                if not listens.done():
                    listens.set_result(None)
                assert process.stderr is not None
                while line := await process.stderr.readline():
                    log.warning("mosquitto: %s", line.decode(errors="replace").rstrip())
                log.warning("mosquitto ended (%s); starting it again", await process.wait())
        except (Unavailable, OSError, ValueError) as error:  # OSError: out of files or processes, for the moment
            if not listens.done():
                raise
            log.error("%s; trying again", error)  # noqa: TRY400  # the trace says nothing more
            await asyncio.sleep(1)
        await asyncio.sleep(RESTART_S)


@contextlib.asynccontextmanager
async def _child(program: str, path: Path) -> AsyncIterator[asyncio.subprocess.Process]:
    """A mosquitto that is gone when the context is left, in whatever way, and its pipe closed."""
    process = await asyncio.create_subprocess_exec(
        program,
        "-c",
        str(path),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,  # Ctrl-C in the terminal is for us; we end it when the last message is out
        preexec_fn=_die_with_parent,
        user=_whose(),
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


async def _until_it_listens(process: asyncio.subprocess.Process, tcp_port: int) -> None:
    deadline = asyncio.get_running_loop().time() + START_TIMEOUT_S
    while process.returncode is None and asyncio.get_running_loop().time() < deadline:
        try:
            _, writer = await asyncio.open_connection(LOOPBACK, tcp_port)
        except OSError:
            await asyncio.sleep(0.02)
            continue
        writer.close()
        return
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    assert process.stderr is not None
    said = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
    raise Unavailable(f"mosquitto does not start: {said[-1] if said else 'no reason given'}", "phalanx doctor")
