"""The trail: who joined, drove, was refused and was removed. No payload is in it.

No visitor fills the disk, or takes the room of others' lines: each has room of its own, and so has what was left out.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from phalanx.pace import Pace

from .chain_file import ChainFile

ADDED_UP_S = 10.0  # refusals, stops, and what was left out: they may come in thousands
KINDS = 8  # of robots and reasons, of a visitor in that time; the rest is added up without the robot
SUMS_PER_TICK = 16  # visitors whose sums are written at once
LINES_AT_ONCE, LINES_PER_S = 50, 0.2  # of a visitor
NEWCOMERS_AT_ONCE, NEWCOMERS_PER_S = 2000, 5.0  # visitors that have lines at all
DRIVE_ENDS_S = 10.0  # after the last command
LIST_MOST = 48  # in a line: robots' addresses have 64 characters
GATEWAY = 0  # whose lines are no visitor's


@dataclass(slots=True)
class _Drive:
    visitor: int
    began_s: float  # monotonic
    last_s: float
    commands: int


@dataclass(slots=True)
class _Sums:
    since_s: float
    counts: Counter[tuple[str, str, str]] = field(default_factory=Counter)  # of event, robot and reason


class Trail:
    """Writes the trail. Without a path nothing is written. Raises: Unavailable: it cannot be opened."""

    def __init__(self, path: Path | None) -> None:
        self._file = ChainFile(path) if path else None
        self._drives: dict[str, _Drive] = {}
        self._sums: dict[int, _Sums] = {}  # by visitor, the oldest first
        self._here: set[int] = set()
        self._paces: dict[int, Pace] = {}  # of visitors
        self._newcomers = Pace(NEWCOMERS_PER_S, NEWCOMERS_AT_ONCE, time.monotonic())
        self._left_out: Counter[int] = Counter()  # lines, by visitor
        self._told_s = 0.0
        if self._file and self._file.found:
            event, words = self._file.found
            self._append(GATEWAY, event, words)

    def close(self) -> None:
        """Write what is still open, and close the file."""
        for robot in list(self._drives):
            self._end_drive(robot)
        for visitor in list(self._sums):
            self._write_sums(visitor)
        self._tell_left_out()
        if self._file:
            self._file.sync()
            self._file.close()
            self._file = None

    def write(self, event: str, /, *, durable: bool = False, **words: Any) -> None:
        """Add a line of what an operator did; a long list takes several. It is on disk then, if it is `durable`."""
        for part in _parts(words):
            self._append(GATEWAY, event, part)
        if durable and self._file:
            self._file.sync()

    def joined(self, visitor: int, **words: Any) -> None:
        """Take note of a visitor that came."""
        self._here.add(visitor)
        self._of_visitor(visitor, "joined", **words)

    def left(self, visitor: int) -> None:
        """Take note of a visitor that went."""
        self._here.discard(visitor)
        self._of_visitor(visitor, "left")

    def drives(self, visitor: int, robot: str, command: str, now_s: float) -> None:
        """Take note of a command that was carried out: a line when a visitor begins, and one when it has ended."""
        drive = self._drives.get(robot)
        if drive and drive.visitor != visitor:
            self._end_drive(robot)
            drive = None
        if drive is None:
            self._of_visitor(visitor, "drives", robot=robot, command=command)
            drive = self._drives[robot] = _Drive(visitor, now_s, now_s, 0)
        drive.last_s = now_s
        drive.commands += 1

    def stops(self, visitor: int, robot: str, now_s: float) -> None:
        """Count a stop; it begins and ends no drive. A driver's own stop is not counted."""
        drive = self._drives.get(robot)
        if drive is None or drive.visitor != visitor:
            self._add("stopped", visitor, robot, "", now_s)

    def refused(self, visitor: int, robot: str, reason: str, now_s: float) -> None:
        """Count a refusal."""
        self._add("refused", visitor, robot[:64], reason, now_s)

    def tick(self, now_s: float) -> None:
        """Write what is due; `now_s` is monotonic."""
        for robot, drive in list(self._drives.items()):
            if now_s - drive.last_s >= DRIVE_ENDS_S:
                self._end_drive(robot)
        for visitor in list(islice(self._sums, SUMS_PER_TICK)):
            if now_s - self._sums[visitor].since_s >= ADDED_UP_S:
                self._write_sums(visitor)
        if now_s - self._told_s >= ADDED_UP_S:
            self._told_s = now_s
            self._tell_left_out()
            self._paces = {
                each: pace for each, pace in self._paces.items() if each in self._here or not pace.is_full(now_s)
            }

    def _add(self, event: str, visitor: int, robot: str, reason: str, now_s: float) -> None:
        counts = self._sums.setdefault(visitor, _Sums(now_s)).counts
        key = event, robot, reason
        counts[key if key in counts or len(counts) < KINDS else (event, "", reason)] += 1

    def _write_sums(self, visitor: int) -> None:
        for (event, robot, reason), count in self._sums.pop(visitor).counts.items():
            words = {"robot": robot, "reason": reason, "count": count}
            self._of_visitor(visitor, event, **{key: word for key, word in words.items() if word})

    def _end_drive(self, robot: str) -> None:
        drive = self._drives.pop(robot)
        lasted_s = round(drive.last_s - drive.began_s, 1)
        self._of_visitor(drive.visitor, "drove", robot=robot, commands=drive.commands, lasted_s=lasted_s)

    def _of_visitor(self, visitor: int, event: str, **words: Any) -> None:
        """Add a line of what a visitor did, if it has room for one."""
        now_s = time.monotonic()
        pace = self._paces.get(visitor)
        if pace is None and not self._newcomers.wait_s(now_s):
            self._newcomers.use()
            pace = self._paces[visitor] = Pace(LINES_PER_S, LINES_AT_ONCE, now_s)
        if pace is None or pace.wait_s(now_s):
            self._left_out[visitor] += 1
            return
        pace.use()
        self._append(visitor, event, {"visitor": visitor, **words})

    def _append(self, visitor: int, event: str, words: dict[str, Any]) -> bool:
        if self._file is None or self._file.append({"at": round(time.time(), 3), "event": event, **words}):
            return True
        self._left_out[visitor] += 1
        return False

    def _tell_left_out(self) -> None:
        """Say how many lines were not written, and of whom most: one line every ten seconds always has room."""
        left_out, self._left_out = self._left_out, Counter()
        if left_out:
            most = [visitor for visitor, _ in left_out.most_common(LIST_MOST)]
            if not self._append(GATEWAY, "left_out", {"lines": left_out.total(), "visitors": most}):
                self._left_out = left_out


def _parts(words: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield words for one line each: a part of the list that is too long for one."""
    key = next((key for key, word in words.items() if isinstance(word, list) and len(word) > LIST_MOST), None)
    if key is None:
        yield words
        return
    for at in range(0, len(words[key]), LIST_MOST):
        yield {**words, key: words[key][at : at + LIST_MOST]}
