"""Append-only file in which each line contains the hash of the previous one, so that changes are detected.

A second file, the mark, contains the hash of the last line. It lets the gateway and `phalanx link trail verify` detect
a truncated file. An attacker who can write both files can forge both.
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
LINE_BYTES = 4096  # longest line written
TAIL_BYTES = 64 * 1024  # longer than any line of an earlier version
MARK = '{{"bytes":{size:15},"top":"{top}"}}\n'


class ChainFile:
    """The file at `path`, created if missing. A damaged file is renamed, and a new one is started.

    Attributes:
        found: damage found when opening, as an event and its fields; None if there was none.

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
            raise Unavailable(f"cannot open {path}: {error.strerror}", "use a folder that you can write to") from error

    def append(self, words: dict[str, Any]) -> bool:
        """Add a line; return whether it was written. A line that was not written leaves no trace."""
        top, line = chained(words, self._top)
        try:
            if len(line) > LINE_BYTES:
                raise OSError(0, f"a line of {len(line)} bytes")
            if os.write(self._file, line) != len(line):
                raise OSError(0, "no room")
        except OSError as error:
            if not self._troubled:
                log.error("%s: %s; lines are being dropped", self._path, error.strerror)  # noqa: TRY400
            self._troubled = True
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)  # remove a partial line
            return False
        self._size, self._top, self._troubled = self._size + len(line), top, False
        with contextlib.suppress(OSError):  # an outdated mark is harmless
            os.pwrite(self._mark, MARK.format(size=self._size, top=top).encode(), 0)
        return True

    def sync(self) -> None:
        """Flush all lines to disk; errors are logged."""
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
        log.warning("the trail %s %s; renamed it to %s and started a new file", self._path, why, aside.name)
        self._file, self._size, self._top = _open(self._path, os.O_APPEND), 0, FIRST
        self.found = "moved_aside", {"file": aside.name}

    def _compare(self) -> None:
        """Check that the file contains the line whose hash the mark has."""
        mark = read_mark(self._path)
        if mark is None:
            return
        size, top = mark
        line = os.pread(self._file, TAIL_BYTES, max(0, size - TAIL_BYTES))[: min(size, TAIL_BYTES)]
        if not line.endswith(f'"{CHAIN}":"{top}"}}\n'.encode()):
            log.warning("%s: the end is missing or changed, perhaps by a power cut: the next line notes it", self._path)
            self.found = "cut_off", {"top": top}


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a file, each checked. Raises: UsageError: a line was changed or removed."""
    top = FIRST
    try:
        with path.open("rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(TAIL_BYTES), b""), 1):
                words = _words(line)
                if words is None:
                    raise UsageError(f"{path}: line {number} is incomplete, or not a line of a trail", "restore it")
                top, expected = chained({k: v for k, v in words.items() if k != CHAIN}, top)
                if line != expected:
                    hint = "this line was changed, or one before it was removed"
                    raise UsageError(f"{path}: line {number} does not match the lines before it", hint)
                yield words
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", "phalanx up --state FOLDER writes it") from error


def mark_of(path: Path) -> Path:
    """Return the path of the mark file."""
    return path.with_suffix(".top")


def read_mark(path: Path) -> tuple[int, str] | None:
    """Return the stored size of a file and the hash of its last line, or None without a valid mark."""
    try:
        with mark_of(path).open("rb") as file:
            words = json.loads(file.read(LINE_BYTES))
        size, top = words["bytes"], words["top"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return (size, top) if isinstance(size, int) and size > 0 and isinstance(top, str) else None


def as_line(words: dict[str, Any]) -> str:
    """Return a line's fields as canonical JSON."""
    return json.dumps(words, ensure_ascii=True, separators=(",", ":"))


def chained(words: dict[str, Any], before: str) -> tuple[str, bytes]:
    """Return a line's hash and the line: canonical JSON with the hash, which includes that of the previous line."""
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
    """Return the size of all complete lines and the hash of the last one.

    Truncate a partial line, as a power cut leaves it. Raises: ValueError: the last line is malformed.
    """
    size = os.fstat(file).st_size
    tail = os.pread(file, TAIL_BYTES, max(0, size - TAIL_BYTES))
    whole = tail.rfind(b"\n") + 1
    if not size:
        return 0, FIRST
    words = _words(tail[tail.rfind(b"\n", 0, max(0, whole - 1)) + 1 : whole])
    top = words.get(CHAIN) if words else None
    if not isinstance(top, str) or len(top) != len(FIRST):
        raise ValueError("has a malformed last line")
    size -= len(tail) - whole
    os.ftruncate(file, size)
    return size, top
