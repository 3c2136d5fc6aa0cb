"""The line to a robot's trusted nodes: bytes to a process, a Unix socket, a TCP port or a serial device, and back.

Only this file opens one. What stands on it is docs/spec/serial.md's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import struct
import subprocess
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

from phalanx.errors import Unavailable, UsageError

from .children import die_with_parent

BAUD = 115_200
BITS_A_BYTE = 10  # with start and stop
READ_BYTES = 65_536
OPEN_TIMEOUT_S = 5.0
AGAIN_S = 0.02  # somebody who listens soon is waited for
END_TIMEOUT_S = 1.0
ROOT = 0
HINT = "process:PROGRAM,FLASH_FILE, unix:PATH, tcp:HOST:PORT or serial:DEVICE[@BAUD]"


class SerialLine:
    """Bytes there and back, by a file descriptor; whoever ends it ends a process of ours as well.

    Attributes:
        where: as it was opened.
        byte_s: how long a byte is on the way, seconds.
        process: ours, at the other end.
    """

    def __init__(
        self, where: str, fd: int, process: subprocess.Popen[bytes] | None = None, byte_s: float = 0.0
    ) -> None:
        self.where, self.process, self.byte_s, self._fd = where, process, byte_s, fd
        self._came = b""
        os.set_blocking(fd, False)

    def send(self, raw: bytes, until_s: float) -> None:
        """Send bytes before `until_s` of time.monotonic. Raises: Unavailable: the other end is gone, or takes none."""
        while raw:
            can_read, can_write, _ = select.select([self._fd], [self._fd], [], max(0.0, until_s - time.monotonic()))
            if can_write:
                with self._gone(), contextlib.suppress(BlockingIOError):
                    raw = raw[os.write(self._fd, raw) :]
            elif can_read:
                # A board that waits for its answer to be taken takes nothing itself.
                self._came = (self._came + self._read())[-READ_BYTES:]
            else:
                raise Unavailable(f"{self.where} takes no bytes")

    def receive(self, until_s: float) -> bytes:
        """Return what has come by `until_s`, as soon as something has. Raises: Unavailable: the other end is gone."""
        if self._came:
            came, self._came = self._came, b""
            return came
        if not select.select([self._fd], [], [], max(0.0, until_s - time.monotonic()))[0]:
            return b""
        return self._read()

    def _read(self) -> bytes:
        with self._gone():
            try:
                raw = os.read(self._fd, READ_BYTES)
            except BlockingIOError:
                return b""
            if not raw:
                raise ConnectionResetError
        return raw

    @contextlib.contextmanager
    def _gone(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:
            raise Unavailable(f"{self.where} is gone") from error

    def close(self) -> None:
        """Nothing is left open, and no process of ours runs."""
        with contextlib.suppress(OSError):
            os.close(self._fd)
        if self.process:
            self.process.kill()
            self.process.wait(END_TIMEOUT_S)


def open_line(where: str, *more: str) -> SerialLine:
    """Open a line; see HINT. `more` are words of a process. Raises: UsageError: no such kind; Unavailable."""
    kind, _, rest = where.partition(":")
    try:
        if kind == "process":
            program, _, flash = rest.rpartition(",")
            return _process(where, program, flash, *more)
        if kind == "unix":
            return SerialLine(where, _connected(socket.AF_UNIX, rest))
        if kind == "tcp":
            host, _, port = rest.rpartition(":")
            return SerialLine(where, _connected(socket.AF_INET, (host, int(port))))
        if kind == "serial":
            return _device(where, *rest.partition("@")[::2])
    except ValueError as error:
        raise UsageError(f"{where}: no number", HINT) from error
    except (OSError, termios.error) as error:
        told = error.strerror if isinstance(error, OSError) else error.args[-1]
        raise Unavailable(f"{where} cannot be opened: {told}") from error
    raise UsageError(f"{where}: no such kind of line", HINT)


def _process(where: str, program: str, flash: str, *more: str) -> SerialLine:
    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(
            [str(Path(program).absolute()), flash, *more],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=die_with_parent,  # noqa: PLW1509 - or it outlives who is killed outright
        )
    return SerialLine(where, ours.detach(), process)


def _connected(family: int, address: str | tuple[str, int]) -> int:
    until_s = time.monotonic() + OPEN_TIMEOUT_S
    while True:
        with socket.socket(family) as made:
            try:
                made.settimeout(max(AGAIN_S, until_s - time.monotonic()))
                made.connect(address)
                if family == socket.AF_INET:
                    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                else:
                    check_owner(made)
                return made.detach()
            except (FileNotFoundError, ConnectionRefusedError):
                if time.monotonic() > until_s:
                    raise
                time.sleep(AGAIN_S)


def check_owner(made: socket.socket) -> None:
    """Who listens is us, or root: whoever made the socket first would be given the keys. Raises: PermissionError."""
    _, uid, _ = struct.unpack("3i", made.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    if uid not in (ROOT, os.geteuid()):
        raise PermissionError(errno.EPERM, f"user {uid} listens there, who is neither you nor root")


def _device(where: str, path: str, baud: str) -> SerialLine:
    speed = getattr(termios, f"B{int(baud or BAUD)}", None)
    if speed is None:
        raise UsageError(f"{where}: no such speed", "9600, 115200, 460800, 921600, for example")
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(fd)
        attributes = termios.tcgetattr(fd)
        attributes[tty.ISPEED] = attributes[tty.OSPEED] = speed
        termios.tcsetattr(fd, termios.TCSANOW, attributes)
        termios.tcflush(fd, termios.TCIOFLUSH)
    except termios.error:
        os.close(fd)
        raise
    return SerialLine(where, fd, byte_s=BITS_A_BYTE / int(baud or BAUD))
