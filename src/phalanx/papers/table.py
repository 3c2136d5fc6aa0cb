"""CSV file of a figure's measurement: it grows by whole cases, and an interrupted measurement continues it.

    # phalanx mission-fig8b {"version": ...}     and other settings that must be equal to continue the file
    case,odometry_p50_m,...
    fixed;3;0.06;0;seed 4,1.41,...               one or more lines per case
    # end fixed;3;0.06;0;seed 4 {...}            optionally with further results of the case

In some files each line is a case, without an end line. Only this module writes such CSVs and decides which cases are
complete. After a crash or a full disk the last case may be incomplete: reading ignores it, and writing removes it.
"""

from __future__ import annotations

import csv
import fcntl
import json
import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from phalanx import __version__
from phalanx.config.written import read_at_most
from phalanx.errors import Unavailable, UsageError

from .figure import Figure

Rows = NDArray[np.float64]
END = "# end "
MOST_BYTES = 1 << 30
OTHER_FOLDER_HINT = "use another folder with --out, or move the file away"


@dataclass(frozen=True, slots=True)
class Table:
    """Content of a CSV. A table without cases describes a new CSV."""

    figure: str
    # Settings of the measurement, including the program's version. To continue a file all of them must be equal,
    # except those in `free`.
    origin: Mapping[str, Any]
    columns: tuple[str, ...]  # without the case name
    cases: dict[str, Rows] = field(default_factory=dict)  # (rows, columns) by case, in the order measured
    kept: dict[str, dict[str, Any]] = field(default_factory=dict)  # further results by case
    by_line: bool = False  # each line is a case; else cases have names, and all other cells are numbers
    free: frozenset[str] = frozenset()
    # If each line is a case: line number in the file, and cells.
    lines: list[tuple[int, list[str]]] = field(default_factory=list)

    @property
    def head(self) -> str:
        """Return the first two lines of the file."""
        names = self.columns if self.by_line else ("case", *self.columns)
        return f"# phalanx {self.figure} {json.dumps(dict(self.origin))}\n{','.join(names)}\n"

    @property
    def version(self) -> str:
        """Return the version of the program that started the file."""
        return str(self.origin.get("version", ""))

    @property
    def seeds(self) -> int | None:
        """Return the least number of seeds of any point; None if no case has a seed."""
        points = Counter(case.rpartition("seed ")[0] for case in self.cases if "seed " in case)
        return min(points.values(), default=None)

    def column(self, case: str, name: str) -> Rows:
        """Return (rows,) values of a column for a case."""
        values: Rows = self.cases[case][:, self.columns.index(name)]
        return values


def read_table(path: Path, figure: str = "") -> Table:
    """Read the table in a CSV; if `figure` is given, it must be of that figure.

    Raises: UsageError: no such file, or not a CSV of a figure. Unavailable: the file cannot be read.
    """
    return _parse(path, read_at_most(path, MOST_BYTES, "create it with phalanx reproduce"), figure)[0]


class TableFile:
    """A CSV opened for appending cases, as a context manager that locks it and removes an incomplete end.

    On entering, the file and its folder are created if missing. `table` is then the existing content, or `begin` for a
    new file, and `done` has the names of its cases. `check` raises UsageError on a table that does not fit the figure.

    Raises: on entering, UsageError: the file is of another measurement, or another run is writing to it; it stays
        unchanged. Unavailable: the file cannot be written, on entering or later.
    """

    def __init__(self, path: Path, begin: Table, check: Callable[[Table], object] = lambda _table: None) -> None:
        self.path = path
        self._check = check
        self._fd = -1
        self.table = begin
        self.done: set[str] = set()

    def __enter__(self) -> Self:
        with self._writing():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o644)
        try:
            self._continue()
        except BaseException:
            os.close(self._fd)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._fd)

    def append(self, case: str, rows: Rows, kept: Mapping[str, Any] | None = None) -> None:
        """Write a complete case: its (rows, columns), and further results if any. The name must have no comma."""
        lines = [f"{case},{','.join(format(value, '.6g') for value in row)}\n" for row in rows.tolist()]
        end = f"{END}{case}{f' {json.dumps(dict(kept))}' if kept is not None else ''}\n"
        self._write("".join([*lines, end]))
        self.done.add(case)

    def append_line(self, cells: Iterable[str]) -> None:
        """Write a case that consists of one line."""
        self._write(",".join(cells) + "\n")

    def _continue(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(f"another run writes to {self.path}", "wait for it, or choose another --out") from error
        data = self.path.read_bytes()
        begin = self.table
        if begin.head.encode().startswith(data):  # new, or a run crashed while writing the head
            self._truncate(0)
            self._write(begin.head)
            return
        self.table, whole = _parse(self.path, data, begin.figure)
        if self.table.columns != begin.columns:
            raise UsageError(f"{self.path} has other columns", OTHER_FOLDER_HINT)
        for name, ours in begin.origin.items():
            theirs = self.table.origin.get(name)
            if theirs != ours and name not in begin.free:
                shown = f" {theirs}, this run has {ours}" if len(f"{theirs}{ours}") < 80 else " than this run"
                raise UsageError(f"{self.path} was measured with another {name}:{shown}", OTHER_FOLDER_HINT)
        self._check(self.table)
        self.done = set(self.table.cases)
        self._truncate(whole)

    def _truncate(self, size: int) -> None:
        with self._writing():
            os.ftruncate(self._fd, size)

    def _write(self, text: str) -> None:
        """Write and flush to the operating system, so that a crash of this process loses nothing."""
        data = memoryview(text.encode())
        with self._writing():
            while data:
                data = data[os.write(self._fd, data) :]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            hint = "choose another folder with --out"
            raise Unavailable(f"cannot write {self.path}: {error.strerror}", hint) from error


def version() -> str:
    """Return the version of this program, with the commit if it runs from a checkout."""
    root = Path(__file__).parents[3]
    git = shutil.which("git")
    if git is None or not ((root / ".git").exists() and (root / "pyproject.toml").exists()):
        return __version__
    command = [git, "-C", str(root), "describe", "--always", "--dirty"]
    # Without this variable git may lock the index, and a concurrent commit would fail.
    quiet = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=quiet)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__} ({found.stdout.strip()})"


def read_data(name: str) -> list[dict[str, str]]:
    """Return the rows of a CSV in phalanx/data, without its leading comments."""
    lines = (files("phalanx") / "data" / name).read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def by_seed(seeds: int) -> list[str]:
    """Return the cases of a figure with one case per seed."""
    return [f"seed {seed}" for seed in range(seeds)]


def seed_of(case: str) -> int:
    """Return the seed at the end of a case's name."""
    return int(case.rpartition("seed ")[2])


# Measures the given cases in any order; yields each case's name and the result of `measure_case`. The callback receives
# the completed share of the current case, from 0 to 1.
EachCase = Callable[[Figure, Sequence[str], Callable[[float], None]], Iterable[tuple[str, Any]]]


def measure_serially(
    figure: Figure, todo: Sequence[str], on_share: Callable[[float], None]
) -> Iterator[tuple[str, Any]]:
    """Measure the cases in this process; an `EachCase`."""
    for case in todo:
        yield case, figure.body.measure_case(case, on_share)


def measure(
    folder: Path,
    figure: Figure,
    seeds: int,
    on_progress: Callable[[float, int], None] = lambda _done, _of: None,
    each: EachCase = measure_serially,
) -> Path:
    """Measure all missing cases of a figure into its CSV in `folder`, and return the CSV's path.

    `on_progress` receives the number of completed cases and the total.

    Raises: UsageError: a CSV of another measurement, or `seeds` is out of range. Unavailable: the disk is full.
    """
    figure.check({"seeds": seeds})
    body, path = figure.body, figure.csv(folder)
    cases = body.cases(seeds)
    origin = body.origin() if hasattr(body, "origin") else {}
    done = 0

    def report(share: float) -> None:
        on_progress(done + share, len(cases))

    begin = Table(figure.name, {**origin, "version": version()}, body.COLUMNS)
    with TableFile(path, begin, getattr(body, "check", lambda _table: None)) as file:
        todo = [case for case in cases if case not in file.done]
        done = len(cases) - len(todo)
        report(0.0)
        for case, measured in each(figure, todo, report):
            file.append(case, *(measured if isinstance(measured, tuple) else (measured,)))
            done += 1
            report(0.0)
    return path


def _parse(path: Path, data: bytes, figure: str) -> tuple[Table, int]:
    """Return the table and the length of the complete part. Raises: UsageError: not a CSV of a figure."""
    lines = data[: data.rfind(b"\n") + 1].split(b"\n")[:-1]
    try:
        table = _parse_head(lines, figure)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise UsageError(f"{path} is not a CSV of {figure or 'a figure'}", OTHER_FOLDER_HINT) from error
    at = whole = len(lines[0]) + len(lines[1]) + 2
    rows: list[list[str]] = []
    for number, line in enumerate(lines[2:], start=3):
        at += len(line) + 1
        try:
            text = line.decode()
            if table.by_line or not text.startswith(END):
                rows.append(text.split(","))
                if len(rows[-1]) != len(table.columns) + (not table.by_line):
                    raise ValueError(text)
            else:
                _end_case(table, text, rows)
        except (ValueError, TypeError) as error:
            raise UsageError(f"line {number} of {path} is malformed", OTHER_FOLDER_HINT) from error
        if table.by_line:
            table.lines.append((number, rows.pop()))
        if not rows:
            whole = at
    return table, whole


def _parse_head(lines: list[bytes], figure: str) -> Table:
    mark, program, name, origin = lines[0].decode().split(" ", 3)
    first, *others = lines[1].decode().split(",")
    settings = json.loads(origin)
    if (mark, program) != ("#", "phalanx") or name != (figure or name) or not isinstance(settings, dict):
        raise ValueError(name)
    by_line = first != "case"
    return Table(name, settings, (first, *others) if by_line else tuple(others), by_line=by_line)


def _end_case(table: Table, text: str, rows: list[list[str]]) -> None:
    case, brace, kept = text.removeprefix(END).partition(" {")
    if {row[0] for row in rows} - {case}:
        raise ValueError(case)
    numbers = [[float(cell) for cell in row[1:]] for row in rows]
    table.cases[case] = np.array(numbers, np.float64).reshape(len(rows), len(table.columns))
    if brace:
        table.kept[case] = json.loads(brace.strip() + kept)
    rows.clear()
