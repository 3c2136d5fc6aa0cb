"""The CSV behind every figure: it grows by whole cases while they are measured, and goes on where it was stopped.

    # phalanx mission-fig8b {"version": ...}     and what else two measurements that share a file must agree in
    case,odometry_p50_m,...
    fixed;3;0.06;0;seed 4,1.41,...               as many lines as the case has
    # end fixed;3;0.06;0;seed 4 {...}            and what else is kept of it, if anything is

Where a case is a line, it ends with the line. Only this file writes such CSVs, and only it knows what of them is whole.
A crash or a full disk may cut the end short: that is ignored when reading, and cut off before writing on.
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
ELSEWHERE = "use another folder with --out, or move the file away"


@dataclass(frozen=True, slots=True)
class Table:
    """The content of a CSV; one without cases begins a new CSV."""

    figure: str
    # With what it was measured, the version of the program among it. For two measurements to share a file all of it
    # must agree, but what is in `free`.
    origin: Mapping[str, Any]
    columns: tuple[str, ...]  # of the lines, without the case
    cases: dict[str, Rows] = field(default_factory=dict)  # (rows, columns) of each, in the order measured
    kept: dict[str, dict[str, Any]] = field(default_factory=dict)  # what else was kept of a case
    by_line: bool = False  # whether each line is a case; else cases have names, and their cells are numbers
    free: frozenset[str] = frozenset()
    # Where each line is a case, their cells and their numbers in the file.
    lines: list[tuple[int, list[str]]] = field(default_factory=list)

    @property
    def head(self) -> str:
        """The first two lines of its file."""
        names = self.columns if self.by_line else ("case", *self.columns)
        return f"# phalanx {self.figure} {json.dumps(dict(self.origin))}\n{','.join(names)}\n"

    @property
    def version(self) -> str:
        """Of the program that began it."""
        return str(self.origin.get("version", ""))

    @property
    def seeds(self) -> int | None:
        """Return the number of seeds of the point that has the fewest; None where no case has a seed."""
        points = Counter(case.rpartition("seed ")[0] for case in self.cases if "seed " in case)
        return min(points.values(), default=None)

    def column(self, case: str, name: str) -> Rows:
        """(rows,) of a case."""
        values: Rows = self.cases[case][:, self.columns.index(name)]
        return values


def read_table(path: Path, figure: str = "") -> Table:
    """The table in a CSV, of this figure or of any.

    Raises: UsageError: no such file, or not one of ours. Unavailable: it cannot be read.
    """
    return _parse(path, read_at_most(path, MOST_BYTES, "phalanx reproduce makes one"), figure)[0]


class TableFile:
    """A CSV that grows. Use as `with`: entered, it is ours alone and ends with something whole.

    Then `table` is what was there, or `begin` in a new file, and `done` names the cases that are there. `check` raises
    UsageError on a table that is none of the figure's. The file is made if it is not there, with its folder.

    Raises: on entering, UsageError: the file is another measurement's, or another run writes to it; nothing was
        altered. Unavailable: it cannot be written, on entering or later.
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
        """Write a whole case, now: its (rows, columns), and what else is kept of it. The name has no comma."""
        lines = [f"{case},{','.join(format(value, '.6g') for value in row)}\n" for row in rows.tolist()]
        end = f"{END}{case}{f' {json.dumps(dict(kept))}' if kept is not None else ''}\n"
        self._write("".join([*lines, end]))
        self.done.add(case)

    def append_line(self, cells: Iterable[str]) -> None:
        """Write a case that is a line, now."""
        self._write(",".join(cells) + "\n")

    def _continue(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(f"another run writes to {self.path}", "wait for it, or choose another --out") from error
        data = self.path.read_bytes()
        begin = self.table
        if begin.head.encode().startswith(data):  # new, or we died within the head
            self._truncate(0)
            self._write(begin.head)
            return
        self.table, whole = _parse(self.path, data, begin.figure)
        if self.table.columns != begin.columns:
            raise UsageError(f"{self.path} has other columns", ELSEWHERE)
        for name, ours in begin.origin.items():
            theirs = self.table.origin.get(name)
            if theirs != ours and name not in begin.free:
                shown = f" {theirs}, this run has {ours}" if len(f"{theirs}{ours}") < 80 else " of its own"
                raise UsageError(f"{self.path} was measured with another {name}:{shown}", ELSEWHERE)
        self._check(self.table)
        self.done = set(self.table.cases)
        self._truncate(whole)

    def _truncate(self, size: int) -> None:
        with self._writing():
            os.ftruncate(self._fd, size)

    def _write(self, text: str) -> None:
        """At once: whatever happens to us later, it is there."""
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
    """Return the version of this program; with the commit, if it runs from a checkout."""
    root = Path(__file__).parents[3]
    git = shutil.which("git")
    if git is None or not ((root / ".git").exists() and (root / "pyproject.toml").exists()):
        return __version__
    command = [git, "-C", str(root), "describe", "--always", "--dirty"]
    # Without the environment's word git would lock the index, and disturb whoever is committing.
    quiet = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=quiet)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__} ({found.stdout.strip()})"


def read_data(name: str) -> list[dict[str, str]]:
    """Return the rows of a CSV that comes with the package, without the comments it begins with."""
    lines = (files("phalanx") / "data" / name).read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def by_seed(seeds: int) -> list[str]:
    """The cases of a figure that has one a seed."""
    return [f"seed {seed}" for seed in range(seeds)]


def seed_of(case: str) -> int:
    """The seed that ends a case's name."""
    return int(case.rpartition("seed ")[2])


# Of each of these cases, in whatever order they come, its name and what the figure measured of it; a case that is
# under way may tell which share of it is done.
EachCase = Callable[[Figure, Sequence[str], Callable[[float], None]], Iterable[tuple[str, Any]]]


def one_by_one(figure: Figure, todo: Sequence[str], tell: Callable[[float], None]) -> Iterator[tuple[str, Any]]:
    """An `EachCase` in this process."""
    for case in todo:
        yield case, figure.body.measure_case(case, tell)


def measure(
    folder: Path,
    figure: Figure,
    seeds: int,
    on_progress: Callable[[float, int], None] = lambda _done, _of: None,
    each: EachCase = one_by_one,
) -> Path:
    """The CSV in `folder` with all cases in it; goes on where an earlier measurement was stopped.

    `on_progress` is told how many cases are done, and of how many.

    Raises: UsageError: a CSV of another measurement, or so many seeds. Unavailable: the disk is full.
    """
    figure.check({"seeds": seeds})
    body, path = figure.body, figure.csv(folder)
    cases = body.cases(seeds)
    origin = body.origin() if hasattr(body, "origin") else {}
    done = 0

    def tell(share: float) -> None:
        on_progress(done + share, len(cases))

    begin = Table(figure.name, {**origin, "version": version()}, body.COLUMNS)
    with TableFile(path, begin, getattr(body, "check", lambda _table: None)) as file:
        todo = [case for case in cases if case not in file.done]
        done = len(cases) - len(todo)
        tell(0.0)
        for case, measured in each(figure, todo, tell):
            file.append(case, *(measured if isinstance(measured, tuple) else (measured,)))
            done += 1
            tell(0.0)
    return path


def _parse(path: Path, data: bytes, figure: str) -> tuple[Table, int]:
    """(table, length of the part that ends with a whole case). Raises: UsageError: it is none of ours."""
    lines = data[: data.rfind(b"\n") + 1].split(b"\n")[:-1]
    try:
        table = _parse_head(lines, figure)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise UsageError(f"{path} is not a CSV of {figure or 'ours'}", ELSEWHERE) from error
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
            raise UsageError(f"line {number} of {path} is not one of ours", ELSEWHERE) from error
        if table.by_line:
            table.lines.append((number, rows.pop()))
        if not rows:
            whole = at
    return table, whole


def _parse_head(lines: list[bytes], figure: str) -> Table:
    mark, program, name, origin = lines[0].decode().split(" ", 3)
    first, *others = lines[1].decode().split(",")
    says = json.loads(origin)
    if (mark, program) != ("#", "phalanx") or name != (figure or name) or not isinstance(says, dict):
        raise ValueError(name)
    by_line = first != "case"
    return Table(name, says, (first, *others) if by_line else tuple(others), by_line=by_line)


def _end_case(table: Table, text: str, rows: list[list[str]]) -> None:
    case, brace, kept = text.removeprefix(END).partition(" {")
    if {row[0] for row in rows} - {case}:
        raise ValueError(case)
    numbers = [[float(cell) for cell in row[1:]] for row in rows]
    table.cases[case] = np.array(numbers, np.float64).reshape(len(rows), len(table.columns))
    if brace:
        table.kept[case] = json.loads(brace.strip() + kept)
    rows.clear()
