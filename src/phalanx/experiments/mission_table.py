"""The CSV behind a figure of the second shield: it grows by whole cases, and goes on where it was stopped.

    # phalanx mission-fig8b {origin as JSON}
    case,odometry_p50_m,...
    fixed;3;0.06;0;seed 4,1.41,...          as many lines as the case has
    # end fixed;3;0.06;0;seed 4

Only this file reads or writes that CSV. Lines that no `# end` follows belong to a case that was cut short: they are
ignored when reading and cut off before writing on.
"""

from __future__ import annotations

import fcntl
import json
import os
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import Unavailable, UsageError

END = "# end "
ELSEWHERE = "use another folder with --out, or move the file away"
Rows = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CaseTable:
    """A CSV's origin and cases.

    Args:
        figure: its name.
        version: of the program that measured.
        columns: of the rows.
        cases: (rows, columns) of each, in the order measured.
    """

    figure: str
    version: str
    columns: tuple[str, ...]
    cases: dict[str, Rows]

    def column(self, case: str, name: str) -> Rows:
        """(rows,) of a case."""
        values: Rows = self.cases[case][:, self.columns.index(name)]
        return values


def read_case_table(path: Path) -> CaseTable:
    """The table in a CSV.

    Raises: UsageError: no such file, or not one of ours. Unavailable: it cannot be read.
    Source: none.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise UsageError(f"no file {path}", "phalanx reproduce makes one") from error
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}") from error
    return _parse(path, data)[0]


class CaseFile:
    """A CSV that grows by whole cases. Use as `with`: entered, it is ours alone and ends with a whole case.

    Args:
        path: made if it is not there, with its folder.
        figure, version, columns: all must agree for two measurements to share a file.
    Raises: on entering, UsageError: the file is another measurement's, or another process writes to it.
    Source: none.
    """

    def __init__(self, path: Path, figure: str, version: str, columns: tuple[str, ...]) -> None:
        self._path = path
        self._head = f"# phalanx {figure} {json.dumps({'version': version})}\n{','.join(('case', *columns))}\n"
        self._file: IO[bytes] | None = None
        self.done: set[str] = set()

    def __enter__(self) -> Self:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("a+b")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._file.seek(0)
            data = self._file.read()
            if not data:
                self._file.write(self._head.encode())
            else:
                self._go_on(data)
            self._file.flush()
        except BlockingIOError as error:
            self._close()
            raise UsageError(f"another process writes to {self._path}", "wait for it, or use another --out") from error
        except OSError as error:
            self._close()
            raise Unavailable(f"cannot write {self._path}: {error.strerror}") from error
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def append(self, case: str, rows: Rows) -> None:
        """Write a whole case.

        Raises: Unavailable: the disk is full.
        """
        assert self._file is not None, "used outside of `with`"
        lines = [f"{case},{','.join(format(value, '.6g') for value in row)}\n" for row in rows.tolist()]
        try:
            self._file.write("".join([*lines, f"{END}{case}\n"]).encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise Unavailable(f"cannot write {self._path}: {error.strerror}") from error
        self.done.add(case)

    def _go_on(self, data: bytes) -> None:
        assert self._file is not None, "opened before"
        table, whole = _parse(self._path, data)
        if not data.startswith(self._head.encode()):
            raise UsageError(f"{self._path} was measured by another version or for another figure", ELSEWHERE)
        self._file.truncate(whole)
        self.done = set(table.cases)

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def _parse(path: Path, data: bytes) -> tuple[CaseTable, int]:
    """(table, length of the part that ends with a whole case).

    Raises: UsageError: it is none of ours.
    """
    try:
        return _parsed(data)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise UsageError(f"{path} is not a figure's table: {str(error)[:100]}", ELSEWHERE) from error


def _parsed(data: bytes) -> tuple[CaseTable, int]:
    head, names, *lines = data.decode().splitlines(keepends=True)
    mark, program, figure, origin = head.split(" ", 3)
    first, *columns = names.strip().split(",")
    if (mark, program, first) != ("#", "phalanx", "case"):
        raise ValueError("the first lines are another program's")
    at = whole = len((head + names).encode())
    cases: dict[str, Rows] = {}
    rows: list[list[float]] = []
    for line in lines:
        at += len(line.encode())
        if not line.endswith("\n"):
            break
        if line.startswith(END):
            cases[line[len(END) :].strip()] = np.array(rows, np.float64).reshape(len(rows), len(columns))
            rows, whole = [], at
        else:
            rows.append([float(cell) for cell in line.strip().split(",")[1:]])
    return CaseTable(figure, str(json.loads(origin)["version"]), tuple(columns), cases), whole
