"""A file to which lines are only added. Each has the hash of the line before it, so that none is changed unnoticed.

A second file, the mark, has the hash of the last line: so its own writer and `phalanx link trail verify` see that the
end was cut off. Whoever may write both can forge both.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable, UsageError

log = logging.getLogger(__name__)

FIRST = "0" * 64  # hash before the first line
CHAIN = "chain"
LINE_BYTES = 4096  # the longest that is written
TAIL_BYTES = 64 * 1024  # longer than any line of an earlier version
MARK = '{{"bytes":{size:15},"top":"{top}"}}\n'


class ChainFile:
    """The file at `path`, made if it is not there. A damaged one is moved aside, and a new one begun.

    Attributes:
        found: what was wrong with what was there, an event and its words; None: nothing.

    Raises: Unavailable: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.found: tuple[str, dict[str, str]] | None = None
        self._troubled = False
        try:
            self._file = _open(path, os.O_APPEND)
            try:
                self._size, self._top = _last(self._file)
            except ValueError as error:
                self._move_aside(str(error))
            self._mark = _open(mark_of(path))
            if not self.found:
                self._compare()
        except OSError as error:
            raise Unavailable(f"cannot open {path}: {error.strerror}", "a folder that is yours") from error

    def append(self, words: dict[str, Any]) -> bool:
        """Add a line; return whether it is in the file now. One that is not leaves no trace."""
        top, line = chained(words, self._top)
        try:
            if len(line) > LINE_BYTES:
                raise OSError(0, f"a line of {len(line)} bytes")
            if os.write(self._file, line) != len(line):
                raise OSError(0, "no room")
        except OSError as error:
            if not self._troubled:
                log.error("%s: %s; lines are left out", self._path, error.strerror)  # noqa: TRY400
            self._troubled = True
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)  # a part of it may be there
            return False
        self._size, self._top, self._troubled = self._size + len(line), top, False
        with contextlib.suppress(OSError):  # a mark that is behind is no fault
            os.pwrite(self._mark, MARK.format(size=self._size, top=top).encode(), 0)
        return True

    def sync(self) -> None:
        """Return when all lines are on disk; a disk that fails is told by the next line."""
        try:
            os.fdatasync(self._file)
            os.fdatasync(self._mark)
        except OSError as error:
            log.error("%s: %s", self._path, error.strerror)  # noqa: TRY400

    def close(self) -> None:
        """Close the files."""
        os.close(self._file)
        os.close(self._mark)

    def _move_aside(self, why: str) -> None:
        aside = self._path.with_name(f"{self._path.stem}-{time.time_ns()}{self._path.suffix}")
        self._path.rename(aside)
        os.close(self._file)
        log.warning("%s %s: it is %s now, and a new one begins", self._path, why, aside.name)
        self._file, self._size, self._top = _open(self._path, os.O_APPEND), 0, FIRST
        self.found = "moved_aside", {"file": aside.name}

    def _compare(self) -> None:
        """Look for the line that the mark tells of."""
        mark = read_mark(self._path)
        if mark is None:
            return
        size, top = mark
        line = os.pread(self._file, TAIL_BYTES, max(0, size - TAIL_BYTES))[: min(size, TAIL_BYTES)]
        if not line.endswith(f'"{CHAIN}":"{top}"}}\n'.encode()):
            log.warning("%s was cut off or changed, or a power cut took its end: its next line says so", self._path)
            self.found = "cut_off", {"top": top}


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a file, checked one by one. Raises: UsageError: one was changed, or taken out."""
    top = FIRST
    try:
        with path.open("rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(TAIL_BYTES), b""), 1):
                words = _words(line)
                if words is None:
                    raise UsageError(f"{path}: line {number} is cut off, or no line of a trail", "restore it")
                top, expected = chained({k: v for k, v in words.items() if k != CHAIN}, top)
                if line != expected:
                    hint = "it was changed, or one before it was taken out"
                    raise UsageError(f"{path}: line {number} does not follow from those before it", hint)
                yield words
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", "phalanx up --state FOLDER writes it") from error


def mark_of(path: Path) -> Path:
    """Return where the hash of a file's last line is."""
    return path.with_suffix(".top")


def read_mark(path: Path) -> tuple[int, str] | None:
    """Return the size of a file and the hash of its last line, as its writer left them; None: it left none."""
    try:
        with mark_of(path).open("rb") as file:
            words = json.loads(file.read(LINE_BYTES))
        size, top = words["bytes"], words["top"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return (size, top) if isinstance(size, int) and size > 0 and isinstance(top, str) else None


def as_line(words: dict[str, Any]) -> str:
    """Return words as they stand in the file."""
    return json.dumps(words, ensure_ascii=True, separators=(",", ":"))


def chained(words: dict[str, Any], before: str) -> tuple[str, bytes]:
    """Return a line's hash, and the line: canonical JSON, with the hash of the line before and itself."""
    content = as_line(words)
    top = hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()
    return top, f'{content[:-1]},"{CHAIN}":"{top}"}}\n'.encode()


def _open(path: Path, more: int = 0) -> int:
    return os.open(path, os.O_RDWR | more | os.O_CREAT | os.O_NOFOLLOW, 0o600)


def _words(line: bytes) -> dict[str, Any] | None:
    try:
        words = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return words if isinstance(words, dict) else None


def _last(file: int) -> tuple[int, str]:
    """Return the size of what is whole, and the hash of its last line.

    What a power cut left of a line after it is cut off. Raises: ValueError: the last line is none.
    """
    size = os.fstat(file).st_size
    tail = os.pread(file, TAIL_BYTES, max(0, size - TAIL_BYTES))
    whole = tail.rfind(b"\n") + 1
    if not size:
        return 0, FIRST
    words = _words(tail[tail.rfind(b"\n", 0, max(0, whole - 1)) + 1 : whole])
    top = words.get(CHAIN) if words else None
    if not isinstance(top, str) or len(top) != len(FIRST):
        raise ValueError("has a last line that is none of a trail")
    size -= len(tail) - whole
    os.ftruncate(file, size)
    return size, top
