"""The trail: who joined, drove, was refused and was removed, in a file to which lines are only added.

Each line has the hash of the line before it, so that none is changed or taken out unnoticed. No payload is in it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable, UsageError

log = logging.getLogger(__name__)

FIRST = "0" * 64  # hash before the first line
CHAIN = "chain"
LINE_BYTES = 4096  # the longest; a nickname has 32 characters
REFUSALS_EVERY_S = 10.0  # they are added up: they may come in thousands
REFUSALS_KINDS = 256  # of visitor, robot and reason, in that time
LINES_AT_ONCE, LINES_PER_S = 2000, 10.0
DRIVE_ENDS_S = 10.0  # after the last command


@dataclass(slots=True)
class _Drive:
    visitor: int
    began_s: float  # monotonic
    last_s: float
    commands: int


class Trail:
    """Writes the trail. Without a path nothing is written.

    Raises: Unavailable, UsageError: it cannot be written, or its last line is none.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._file = -1
        self.top = FIRST
        self._refusals: Counter[tuple[int, str, str]] = Counter()
        self._refusals_at_s = 0.0
        self._drives: dict[str, _Drive] = {}
        self._troubled = False
        self._room, self._room_at_s, self._left_out = float(LINES_AT_ONCE), time.monotonic(), 0
        if path is None:
            return
        try:
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
            self.top = _last(self._file, path)
        except OSError as error:
            raise Unavailable(f"cannot open {path}: {error.strerror}", "a folder that is yours") from error

    def close(self) -> None:
        """Write what is still open, and close the file."""
        now_s = time.monotonic()
        for robot in list(self._drives):
            self._end_drive(robot)
        self._write_refusals(now_s)
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def write(self, event: str, /, **words: Any) -> None:
        """Add a line; one with `durable` is on disk when this returns."""
        durable = words.pop("durable", False)
        if self._file < 0 or not self._has_room(event, durable=durable):
            return
        self.top, line = _line({"at": round(time.time(), 3), "event": event, **words}, self.top)
        try:
            os.write(self._file, line)
            if durable:
                os.fdatasync(self._file)
            self._troubled = False
        except OSError as error:
            if not self._troubled:
                log.error("%s: %s; the trail is not complete", self._path, error.strerror)  # noqa: TRY400
            self._troubled = True

    def _has_room(self, event: str, *, durable: bool) -> bool:
        """Return whether a line may be written: a visitor that comes and goes without end shall not fill the disk."""
        now_s = time.monotonic()
        self._room = min(float(LINES_AT_ONCE), self._room + (now_s - self._room_at_s) * LINES_PER_S)
        self._room_at_s = now_s
        if durable:
            return True
        if self._room < 1:
            self._left_out += 1
            return False
        self._room -= 1
        if self._left_out and event != "left_out":
            count, self._left_out = self._left_out, 0
            self.write("left_out", lines=count)
        return True

    def drives(self, visitor: int, robot: str, command: str, now_s: float) -> None:
        """Take note of a command that was carried out: a line when a visitor begins, and one when it has ended."""
        drive = self._drives.get(robot)
        if drive and drive.visitor != visitor:
            self._end_drive(robot)
            drive = None
        if drive is None:
            self.write("drives", visitor=visitor, robot=robot, command=command)
            drive = self._drives[robot] = _Drive(visitor, now_s, now_s, 0)
        drive.last_s = now_s
        drive.commands += 1

    def refused(self, visitor: int, robot: str, reason: str) -> None:
        """Count a refusal; they are written every ten seconds."""
        key = visitor, robot[:64], reason
        if key in self._refusals or len(self._refusals) < REFUSALS_KINDS:
            self._refusals[key] += 1

    def tick(self, now_s: float) -> None:
        """Write what is due; `now_s` is monotonic."""
        for robot, drive in list(self._drives.items()):
            if now_s - drive.last_s >= DRIVE_ENDS_S:
                self._end_drive(robot)
        if now_s - self._refusals_at_s >= REFUSALS_EVERY_S:
            self._write_refusals(now_s)

    def _end_drive(self, robot: str) -> None:
        drive = self._drives.pop(robot)
        lasted_s = round(drive.last_s - drive.began_s, 1)
        self.write("drove", visitor=drive.visitor, robot=robot, commands=drive.commands, lasted_s=lasted_s)

    def _write_refusals(self, now_s: float) -> None:
        self._refusals_at_s = now_s
        for (visitor, robot, reason), count in self._refusals.items():
            self.write("refused", visitor=visitor, robot=robot, reason=reason, count=count)
        self._refusals.clear()


def read_trail(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a trail, checked one by one. Raises: UsageError: one was changed, or taken out."""
    top = FIRST
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                words = _words(line, path, number)
                top, expected = _line({k: v for k, v in words.items() if k != CHAIN}, top)
                if line != expected:
                    hint = "it was changed, or one before it was taken out"
                    raise UsageError(f"{path}: line {number} does not follow from those before it", hint)
                yield words
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}", "phalanx up --state FOLDER writes it") from error


def _line(words: dict[str, Any], before: str) -> tuple[str, bytes]:
    """Return a line's hash, and the line: canonical JSON, with the hash of the line before and itself."""
    content = json.dumps(words, ensure_ascii=True, separators=(",", ":"))
    top = hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()
    return top, f'{content[:-1]},"{CHAIN}":"{top}"}}\n'.encode()


def _words(line: bytes, path: Path, number: int) -> dict[str, Any]:
    try:
        words = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: line {number} is cut off, or no line of a trail", "restore it") from error
    if not isinstance(words, dict):
        raise UsageError(f"{path}: line {number} is no line of a trail", "restore it")
    return words


def _last(file: int, path: Path) -> str:
    """Return the hash of the last line; what a power cut left of a line after it is cut off."""
    size = os.fstat(file).st_size
    tail = os.pread(file, 2 * LINE_BYTES, max(0, size - 2 * LINE_BYTES))
    whole = tail.rfind(b"\n") + 1
    if whole < len(tail):
        os.ftruncate(file, size - (len(tail) - whole))
    if not whole:
        if size >= 2 * LINE_BYTES:
            raise UsageError(f"{path} is no trail", "move it away")
        return FIRST
    words = _words(tail[tail.rfind(b"\n", 0, whole - 1) + 1 : whole], path, 0)
    top = words.get(CHAIN)
    if not isinstance(top, str) or len(top) != len(FIRST):
        raise UsageError(f"{path} is no trail", "move it away")
    return top
