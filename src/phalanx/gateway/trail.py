"""The audit trail: who joined, drove, was refused and was removed. It contains no payloads.

Each visitor has its own allowance of lines, so that nobody can fill the disk or displace others' lines.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from phalanx.pace import TokenBucket

from .chain_file import ChainFile

ADDED_UP_S = 10.0  # period for which refusals, stops and omitted lines are summed up
KINDS = 8  # of robots and reasons per visitor and period; more are summed up without the robot
SUMS_PER_TICK = 16  # visitors whose sums are written per tick
LINES_AT_ONCE, LINES_PER_S = 50, 0.2  # per visitor
NEWCOMERS_AT_ONCE, NEWCOMERS_PER_S = 2000, 5.0  # visitors that get an allowance
DRIVE_ENDS_S = 10.0  # after the last command
LIST_MOST = 48  # items in a line: addresses have up to 64 characters
GATEWAY = 0  # lines that belong to no visitor


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
    """Writes the trail; without a path nothing is written. Raises: Unavailable: the file cannot be opened."""

    def __init__(self, path: Path | None) -> None:
        self._file = ChainFile(path) if path else None
        self._drives: dict[str, _Drive] = {}
        self._sums: dict[int, _Sums] = {}  # by visitor, the oldest first
        self._here: set[int] = set()
        self._paces: dict[int, TokenBucket] = {}  # of visitors
        self._newcomers = TokenBucket(NEWCOMERS_PER_S, NEWCOMERS_AT_ONCE, time.monotonic())
        self._left_out: Counter[int] = Counter()  # lines, by visitor
        self._left_out_written_s = 0.0
        if self._file and self._file.found:
            event, words = self._file.found
            self._append(GATEWAY, event, words)

    def close(self) -> None:
        """Write what is still open, and close the file."""
        for robot in list(self._drives):
            self._end_drive(robot)
        for visitor in list(self._sums):
            self._write_sums(visitor)
        self._write_left_out()
        if self._file:
            self._file.sync()
            self._file.close()
            self._file = None

    def write(self, event: str, /, *, durable: bool = False, **words: Any) -> None:
        """Add a line about an operator's action; a long list takes several. `durable`: flush it to disk."""
        for part in _parts(words):
            self._append(GATEWAY, event, part)
        if durable and self._file:
            self._file.sync()

    def joined(self, visitor: int, **words: Any) -> None:
        """Record that a visitor joined."""
        self._here.add(visitor)
        self._of_visitor(visitor, "joined", **words)

    def left(self, visitor: int) -> None:
        """Record that a visitor left."""
        self._here.discard(visitor)
        self._of_visitor(visitor, "left")

    def drives(self, visitor: int, robot: str, command: str, now_s: float) -> None:
        """Record a command that was carried out: one line when a drive begins, one when it has ended."""
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
        """Count a stop; it begins and ends no drive. The driver's own stops are not counted."""
        drive = self._drives.get(robot)
        if drive is None or drive.visitor != visitor:
            self._add("stopped", visitor, robot, "", now_s)

    def refused(self, visitor: int, robot: str, reason: str, now_s: float) -> None:
        """Count a refusal."""
        self._add("refused", visitor, robot[:64], reason, now_s)

    def tick(self, now_s: float) -> None:
        """Write due lines; `now_s` is monotonic."""
        for robot, drive in list(self._drives.items()):
            if now_s - drive.last_s >= DRIVE_ENDS_S:
                self._end_drive(robot)
        for visitor in list(islice(self._sums, SUMS_PER_TICK)):
            if now_s - self._sums[visitor].since_s >= ADDED_UP_S:
                self._write_sums(visitor)
        if now_s - self._left_out_written_s >= ADDED_UP_S:
            self._left_out_written_s = now_s
            self._write_left_out()
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
        """Add a line about a visitor's action, if the visitor's allowance permits."""
        now_s = time.monotonic()
        pace = self._paces.get(visitor)
        if pace is None and not self._newcomers.wait_s(now_s):
            self._newcomers.use()
            pace = self._paces[visitor] = TokenBucket(LINES_PER_S, LINES_AT_ONCE, now_s)
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

    def _write_left_out(self) -> None:
        """Write the number of omitted lines and the visitors with most of them; one line per period always fits."""
        left_out, self._left_out = self._left_out, Counter()
        if left_out:
            most = [visitor for visitor, _ in left_out.most_common(LIST_MOST)]
            if not self._append(GATEWAY, "left_out", {"lines": left_out.total(), "visitors": most}):
                self._left_out = left_out


def _parts(words: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the fields of each line: a list that is too long is split over several lines."""
    key = next((key for key, word in words.items() if isinstance(word, list) and len(word) > LIST_MOST), None)
    if key is None:
        yield words
        return
    for at in range(0, len(words[key]), LIST_MOST):
        yield {**words, key: words[key][at : at + LIST_MOST]}
