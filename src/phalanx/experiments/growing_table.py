"""A CSV that grows while it is measured, and goes on where it was stopped.

It begins with two lines, a comment that says what was measured and the names of the columns. What was cut short at its
end, by a crash or a full disk, is ignored when reading and cut off before writing on; nothing else is ever altered.
"""

from __future__ import annotations

import fcntl
import os
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Self

from phalanx.errors import Unavailable, UsageError

ELSEWHERE = "use another folder with --out, or move the file away"


class GrowingTable(ABC):
    """A CSV that grows. Use as `with`: entered, it is ours alone and ends with something whole.

    Args:
        path: made if it is not there, with its folder.
        head: its first two lines.
    Raises: on entering, UsageError: the file is another measurement's, or another run writes to it; nothing was
        altered. Unavailable: it cannot be written, on entering or later.
    """

    def __init__(self, path: Path, head: str) -> None:
        self.path = path
        self._head = head
        self._fd = -1

    def __enter__(self) -> Self:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            self._continue()
        except BaseException:
            os.close(self._fd)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._fd)

    @abstractmethod
    def _whole(self, data: bytes) -> int:
        """How many bytes of a file that was found are whole; what they hold is remembered.

        Raises: UsageError: it is another measurement's.
        """

    def _continue(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(f"another run writes to {self.path}", "wait for it, or choose another --out") from error
        data = self.path.read_bytes()
        if self._head.encode().startswith(data):  # new, or we died within the head
            self._truncate(0)
            self._write(self._head)
        else:
            self._truncate(self._whole(data))

    def _truncate(self, size: int) -> None:
        try:
            os.ftruncate(self._fd, size)
        except OSError as error:
            raise self._unwritable(error) from error

    def _write(self, text: str) -> None:
        """At once: whatever happens to us later, it is there."""
        data = memoryview(text.encode())
        try:
            while data:
                data = data[os.write(self._fd, data) :]
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> Unavailable:
        return Unavailable(f"cannot write {self.path}: {error.strerror}", "choose another folder with --out")


def read_growing_table(path: Path) -> bytes:
    """A CSV's bytes, what was cut short included.

    Raises: UsageError: no such file. Unavailable: it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise UsageError(f"no file {path}", "phalanx reproduce makes one") from error
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}") from error
