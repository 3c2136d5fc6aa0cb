"""The CSV behind a figure of the second shield: it grows by whole cases, and goes on where it was stopped.

    # phalanx mission-fig8b {origin as JSON}
    case,odometry_p50_m,...
    fixed;3;0.06;0;seed 4,1.41,...          as many lines as the case has
    # end fixed;3;0.06;0;seed 4

Only this file reads or writes that CSV (growing_table.py says how). Lines that no `# end` follows belong to a case that
was cut short.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.experiments.growing_table import ELSEWHERE, GrowingTable, read_growing_table

END = "# end "
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
    """
    return _parse(path, read_growing_table(path))[0]


class CaseFile(GrowingTable):
    """The CSV while it grows, by whole cases.

    Args:
        path: made if it is not there, with its folder.
        figure, version, columns: all must agree for two measurements to share a file.
    """

    def __init__(self, path: Path, figure: str, version: str, columns: tuple[str, ...]) -> None:
        head = f"# phalanx {figure} {json.dumps({'version': version})}\n{','.join(('case', *columns))}\n"
        super().__init__(path, head)
        self.done: set[str] = set()

    def append(self, case: str, rows: Rows) -> None:
        """Write a whole case, now."""
        lines = [f"{case},{','.join(format(value, '.6g') for value in row)}\n" for row in rows.tolist()]
        self._write("".join([*lines, f"{END}{case}\n"]))
        self.done.add(case)

    def _whole(self, data: bytes) -> int:
        table, whole = _parse(self.path, data)
        if not data.startswith(self._head.encode()):
            raise UsageError(f"{self.path} was measured by another version or for another figure", ELSEWHERE)
        self.done = set(table.cases)
        return whole


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
