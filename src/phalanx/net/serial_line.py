"""Byte stream to a robot's trusted nodes: over a process, a Unix socket, a TCP port or a serial device.

Only this file opens such a line. The protocol on it is in docs/spec/serial.md.
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
BITS_A_BYTE = 10  # with start and stop bit
READ_BYTES = 65_536
OPEN_TIMEOUT_S = 5.0
AGAIN_S = 0.02  # pause between attempts to connect
END_TIMEOUT_S = 1.0
ROOT = 0
HINT = "use process:PROGRAM,FLASH_FILE, unix:PATH, tcp:HOST:PORT or serial:DEVICE[@BAUD]"


class SerialLine:
    """Byte stream over a file descriptor; closing it also ends the process at the other end, if this one started it.

    Attributes:
        where: argument of `open_line`.
        byte_s: transmission time of a byte, seconds.
        process: process at the other end, if this process started it.
    """

    def __init__(
        self, where: str, fd: int, process: subprocess.Popen[bytes] | None = None, byte_s: float = 0.0
    ) -> None:
        self.where, self.process, self.byte_s, self._fd = where, process, byte_s, fd
        self._came = b""
        os.set_blocking(fd, False)

    def send(self, raw: bytes, until_s: float) -> None:
        """Send bytes before `until_s` of time.monotonic. Raises: Unavailable: the line is closed, or a timeout."""
        while raw:
            can_read, can_write, _ = select.select([self._fd], [self._fd], [], max(0.0, until_s - time.monotonic()))
            if can_write:
                with self._gone(), contextlib.suppress(BlockingIOError):
                    raw = raw[os.write(self._fd, raw) :]
            elif can_read:
                # A board that waits until its answer is read does not read itself.
                self._came = (self._came + self._read())[-READ_BYTES:]
            else:
                raise Unavailable(f"{self.where} does not read what is sent to it")

    def receive(self, until_s: float) -> bytes:
        """Return the next bytes, or b"" if none arrive before `until_s`. Raises: Unavailable: the line is closed."""
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
            raise Unavailable(f"{self.where} has closed the line") from error

    def close(self) -> None:
        """Close the line, and end the process at its other end."""
        with contextlib.suppress(OSError):
            os.close(self._fd)
        if self.process:
            self.process.kill()
            self.process.wait(END_TIMEOUT_S)


def open_line(where: str, *more: str) -> SerialLine:
    """Open a line, see HINT; `more` are arguments for a process. Raises: UsageError: not valid; Unavailable."""
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
        raise UsageError(f"{where}: the port or baud rate is not a number", HINT) from error
    except (OSError, termios.error) as error:
        why = error.strerror if isinstance(error, OSError) else error.args[-1]
        raise Unavailable(f"{where} cannot be opened: {why}") from error
    raise UsageError(f"{where}: unknown kind of line", HINT)


def _process(where: str, program: str, flash: str, *more: str) -> SerialLine:
    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(
            [str(Path(program).absolute()), flash, *more],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=die_with_parent,  # noqa: PLW1509 - otherwise it would outlive a killed parent
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
    """Raise PermissionError unless this user or root listens: another user could create the socket to get the keys."""
    _, uid, _ = struct.unpack("3i", made.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    if uid not in (ROOT, os.geteuid()):
        raise PermissionError(errno.EPERM, f"user {uid} listens there, neither you nor root")


def _device(where: str, path: str, baud: str) -> SerialLine:
    speed = getattr(termios, f"B{int(baud or BAUD)}", None)
    if speed is None:
        raise UsageError(f"{where}: unknown baud rate", "use for example 9600, 115200, 460800 or 921600")
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
