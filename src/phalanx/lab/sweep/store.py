"""Store of a sweep's rows in a folder of Parquet files, which are written atomically and never changed.

sweep.json               version and axes of the sweep
runs/part-00000.parquet  some rows
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib import import_module
from pathlib import Path
from statistics import fmean
from typing import Any, Self

from phalanx.errors import Unavailable, UsageError
from phalanx.net.private_file import write_whole

from .plan import SWEEP_HINT, Cell, Job, Plan

OTHER_FOLDER_HINT = "choose another folder with --out, or move this one away"
WRITE_S, WRITE_ROWS = 1.0, 500  # a part is written after this time or number of rows
# Columns of a run's outcome, with Arrow's types.
OUTCOME = {
    "digest": "string",
    "mean_distance_to_goal_m": "double",
    "score": "double",  # of a protocol's correct robots
    "liars": "int64",
    "liars_stopped": "int64",
    "liars_never_stopped": "int64",  # counts liars that deviated
    "slowest_stop_s": "double",  # from the first deviation to Safe Mode
    "correct_in_safe_mode": "int64",
    "without_quorum": "int64",
    "contacts": "int64",
    "app_bytes_per_s": "double",
    "audit_bytes_per_s": "double",  # sent by one robot, each radio attempt counted
    "audit_airtime_pct": "double",  # share of the time that these packets occupy the channel
    "log_bytes_max": "int64",
    "broadcast_delivery": "double",
    "unicast_delivery": "double",
    "cpu_s": "double",
}


def outcome(summary: Mapping[str, Any], cpu_s: float) -> dict[str, Any]:
    """Return the columns of OUTCOME from a run's summary, with lists of robots replaced by their length."""
    liars = summary["compromised"]
    deviated = [liar for liar in liars if liar["first_deviation_s"] is not None]
    stops_s = [each["safe_mode_s"] - each["first_deviation_s"] for each in deviated if each["safe_mode_s"] is not None]
    rates = summary["tried_bytes_per_s_per_robot"]
    counted = {name: len(summary[name]) for name in ("correct_in_safe_mode", "without_quorum")}
    of_liars = {
        "score": next(iter(summary.get("task", {}).values()), None),
        "liars": len(liars),
        "liars_stopped": sum(liar["safe_mode_s"] is not None for liar in liars),
        "liars_never_stopped": len(deviated) - len(stops_s),
        "slowest_stop_s": max(stops_s, default=None),
        "app_bytes_per_s": rates["app"],
        "audit_bytes_per_s": rates["audit"],
        "audit_airtime_pct": summary["airtime_pct_per_robot"]["audit"],
        "cpu_s": cpu_s,
    }
    same = {name: summary[name] for name in OUTCOME if name in summary and name not in counted}
    return same | counted | of_liars


class Store:
    """Folder of rows, as a context manager that locks it.

    `columns` are those of a run's outcome, with Arrow's types. `done` has the keys of all stored rows.

    Raises: on entering, UsageError: the folder is of another sweep, a run's file has changed, or another process
        writes to it; Unavailable: pyarrow is not installed, or a file cannot be read or written, then or later.
    """

    def __init__(self, folder: Path, sweep: Plan, version: str, columns: Mapping[str, str] = OUTCOME) -> None:
        try:
            pa: Any = import_module("pyarrow")
            pq: Any = import_module("pyarrow.parquet")
        except ImportError as error:
            raise Unavailable("pyarrow is not installed", SWEEP_HINT) from error
        self.folder = folder
        self.done: set[str] = set()
        self._parquet, self._arrow = pq, pa
        self._sweep = sweep
        self._head: dict[str, Any] = {
            "version": version,
            "axes": {name: _type(values) for name, values in sweep.axes.items()},
        }
        types = {"key": "string"} | self._head["axes"] | {"seed": "int64"} | dict(columns)
        self._schema = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in types.items()])
        self._rows: list[dict[str, Any]] = []
        self._written_s = time.monotonic()
        self._parts = 0
        self._lock = -1

    @property
    def runs(self) -> Path:
        """Return the folder of the table, for example for `pandas.read_parquet`."""
        return self.folder / "runs"

    def __enter__(self) -> Self:
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            if self.runs.lstat().st_uid != os.geteuid():  # planted in a shared folder
                raise UsageError(f"{self.runs} belongs to another user", OTHER_FOLDER_HINT)
            self._lock = os.open(self.folder, os.O_RDONLY)
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise UsageError(
                    f"another sweep writes to {self.folder}", "wait for it, or choose another --out"
                ) from error
            self._check_head()
            for partial in self.runs.glob("part-*.tmp"):
                partial.unlink()
            for part in self._all_parts():
                self.done.update(self._keys(part))
                self._parts = max(self._parts, int(part.stem.rpartition("-")[2]) + 1)
        except OSError as error:
            self.__exit__()
            raise self._unwritable(error) from error
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Write pending rows and release the folder."""
        if self._lock >= 0:
            try:
                self.write()
            finally:
                os.close(self._lock)
                self._lock = -1

    def add(self, job: Job, row: Mapping[str, Any]) -> None:
        """Add a run's row unless it is stored. Rows reach the disk with the first row after a second, or at the end."""
        if job.key in self.done:
            return
        self.done.add(job.key)
        self._rows.append({"key": job.key, **dict(job.point), "seed": job.seed, **row})
        if len(self._rows) >= WRITE_ROWS or time.monotonic() - self._written_s >= WRITE_S:
            self.write()

    def write(self) -> None:
        """Write all pending rows to disk."""
        self._written_s = time.monotonic()
        if not self._rows:
            return
        path = self.runs / f"part-{self._parts:05}.parquet"
        partial = path.with_suffix(".tmp")
        try:
            self._parquet.write_table(self._arrow.Table.from_pylist(self._rows, self._schema), partial)
            with partial.open("rb") as file:
                os.fsync(file.fileno())
            partial.replace(path)
        except OSError as error:
            raise self._unwritable(error) from error
        self._parts += 1
        self._rows.clear()

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield all rows on disk, in the order of arrival."""
        for part in self._all_parts():
            yield from self._read(part, None).to_pylist()

    def _all_parts(self) -> list[Path]:
        return sorted(self.runs.glob("part-*.parquet"))

    def _read(self, part: Path, columns: list[str] | None) -> Any:
        try:
            file = self._parquet.ParquetFile(part)
            if not part.stem.partition("-")[2].isdecimal() or not file.schema_arrow.equals(self._schema):
                raise UsageError(f"{part} is not part of this sweep", "move it out of the folder")
            return file.read(columns)
        except (self._arrow.ArrowException, OSError) as error:
            if isinstance(error, OSError) and error.errno:  # Arrow's parse errors have no errno
                raise
            raise Unavailable(f"{part} is damaged", "remove it: its runs will be repeated") from error

    def _keys(self, part: Path) -> Iterator[str]:
        """Return keys of a part's rows. Raises: UsageError: a run's settings have changed, so it would count twice."""
        where = [*self._head["axes"], "seed"]
        for row in self._read(part, ["key", *where]).to_pylist():
            planned = self._planned.get(tuple(row[name] for name in where))
            if planned and row["key"] not in planned:
                at = ", ".join(f"{name} {row[name]}" for name in where)
                raise UsageError(f"{self.folder} has another run at {at}: a file has changed since", OTHER_FOLDER_HINT)
            yield row["key"]

    @cached_property
    def _planned(self) -> Mapping[tuple[Cell, ...], set[str]]:
        """Return the keys of the planned runs, by the values of the axes and the seed."""
        keys: dict[tuple[Cell, ...], set[str]] = {}
        for job in self._sweep.jobs:
            keys.setdefault((*(value for _, value in job.point), job.seed), set()).add(job.key)
        return keys

    def _check_head(self) -> None:
        path, ours = self.folder / "sweep.json", json.dumps(self._head)
        if not path.exists() or not self._all_parts():  # no rows yet
            write_whole(path, ours.encode(), OTHER_FOLDER_HINT)
            return
        try:
            stored = json.loads(path.read_text())
        except ValueError:
            stored = None
        for name, what in (("axes", "axes"), ("version", "version of phalanx")):
            if not isinstance(stored, dict) or stored.get(name) != self._head[name]:
                raise UsageError(f"{self.folder} has a sweep with other {what}", OTHER_FOLDER_HINT)

    def _unwritable(self, error: OSError) -> Unavailable:
        return Unavailable(
            f"cannot write {error.filename or self.folder}: {error.strerror or error}", OTHER_FOLDER_HINT
        )


def _type(values: tuple[Cell, ...]) -> str:
    return (
        "string" if isinstance(values[0], str) else "double" if any(isinstance(v, float) for v in values) else "int64"
    )


def points(sweep: Plan, rows: Iterator[dict[str, Any]]) -> list[dict[str, Any]]:
    """Average the runs of each grid point, in grid order; ignore rows of other points."""
    at: dict[tuple[Cell, ...], list[dict[str, Any]]] = {}
    of_job = {job.key: at.setdefault(tuple(value for _, value in job.point), []) for job in sweep.jobs}
    for row in rows:
        if row["key"] in of_job:
            of_job[row["key"]].append(row)
    return [
        dict(zip(sweep.axes, point, strict=True))
        | {"runs": len(of)}
        | {name: sum(row[name] for row in of) for name in OUTCOME if name.startswith(("liars", "correct", "without"))}
        | {
            "slowest_stop_s": max(_known(of, "slowest_stop_s"), default=None),
            "contacts": sum(row["contacts"] for row in of),
            "score": fmean(scores) if (scores := _known(of, "score")) else None,
        }
        for point, of in at.items()
    ]


def _known(rows: list[dict[str, Any]], column: str) -> list[float]:
    return [row[column] for row in rows if row[column] is not None]
