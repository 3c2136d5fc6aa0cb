"""`phalanx robot advise`: a planner as a separate process. Robots' packets are untrusted."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import stat
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path

from phalanx.errors import Unavailable, UsageError
from phalanx.net.udp_radio import OF_ADDRESS, OF_PORT, parse_address
from phalanx.robot.planner import MOST_BYTES, Adviser

from .far_planner import HINT

MOST_LINKS = 256
AT_ONCE = 32  # packets from one robot before others are served


async def advise(where: str, adviser: Adviser, ready: Callable[[], None]) -> None:
    """Advise robots until cancelled; call `ready` first. Raises: UsageError, Unavailable, or a planner's own error."""
    loop = asyncio.get_running_loop()
    failed: asyncio.Future[None] = loop.create_future()
    server = _Server(adviser, loop, failed)
    with _listening(where) as listens:
        is_stream = listens.family == socket.AF_UNIX
        loop.add_reader(listens, server.on_connect if is_stream else server.on_datagrams, listens)
        ready()
        try:
            await failed
        finally:
            loop.remove_reader(listens)
            server.close()


class _Server:
    def __init__(self, adviser: Adviser, loop: asyncio.AbstractEventLoop, failed: asyncio.Future[None]) -> None:
        self._adviser, self._loop, self._failed = adviser, loop, failed
        self._links: set[socket.socket] = set()

    def on_connect(self, listens: socket.socket) -> None:
        """Accept a robot's connection."""
        with contextlib.suppress(OSError):
            link, _ = listens.accept()
            if len(self._links) >= MOST_LINKS:
                link.close()
                return
            link.setblocking(False)
            self._links.add(link)
            self._loop.add_reader(link, self._on_packets, link)

    def _on_packets(self, link: socket.socket) -> None:
        for _ in range(AT_ONCE):
            try:
                packet = link.recv(MOST_BYTES + 1)
            except BlockingIOError:
                return
            except OSError:
                packet = b""
            if not packet:
                self._forget(link)
                return
            if answer := self._answer(link, "", packet):
                with contextlib.suppress(OSError):
                    link.send(answer)

    def on_datagrams(self, listens: socket.socket) -> None:
        """Answer datagrams received over UDP."""
        for _ in range(AT_ONCE):
            try:
                packet, address = listens.recvfrom(MOST_BYTES + 1)
            except OSError:
                return
            if answer := self._answer(address, address[0], packet):
                with contextlib.suppress(OSError):
                    listens.sendto(answer, address)

    def _answer(self, sender: Hashable, host: str, packet: bytes) -> bytes:
        try:
            return self._adviser.answer(sender, host, packet)
        except Exception as error:  # noqa: BLE001 - an error of the planner is raised by `advise`
            if not self._failed.done():
                self._failed.set_exception(error)
            return b""

    def _forget(self, link: socket.socket) -> None:
        self._loop.remove_reader(link)
        self._links.discard(link)
        link.close()

    def close(self) -> None:
        """Close all connections."""
        for link in [*self._links]:
            self._forget(link)


@contextlib.contextmanager
def _listening(where: str) -> Iterator[socket.socket]:
    kind, _, at = where.partition(":")
    if kind != "udp" and not (kind == "unix" and at):
        raise UsageError(f"invalid address {where}", HINT)
    with _at_address(at) if kind == "udp" else _at_path(Path(at)) as made:
        made.setblocking(False)
        try:
            yield made
        finally:
            if kind == "unix":
                Path(at).unlink(missing_ok=True)


def _at_path(path: Path) -> socket.socket:
    with contextlib.suppress(OSError):
        if stat.S_ISSOCK(path.lstat().st_mode) and _is_dead(path):
            path.unlink()  # left by a killed process
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    before = os.umask(0o177)  # accessible to its owner only
    try:
        made.bind(str(path))
        made.listen(MOST_LINKS)
    except OSError as error:
        made.close()
        raise Unavailable(f"cannot listen at {path}: {error.strerror or error}", "use another, shorter path") from error
    finally:
        os.umask(before)
    return made


def _is_dead(path: Path) -> bool:
    # Other errors mean that a process listens there: of another kind, of another user, or with a full queue.
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        probe.setblocking(False)
        return probe.connect_ex(str(path)) == errno.ECONNREFUSED


def _at_address(at: str) -> socket.socket:
    host, port = parse_address(at)
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        hint = OF_ADDRESS if error.errno != errno.EADDRINUSE else OF_PORT
        raise Unavailable(f"cannot listen at {at}: {error.strerror}", hint) from error
    return made
