"""Encoded graphs Fig. 8c: time to extract landmarks from a scan, and to search their hashes, by grid size.

In the paper's Python the extraction takes a hundred times as long as the hash search. Compiled, the extraction takes
tens of microseconds and the ratio inverts. So both are measured compiled, and as plain Python with hashlib.
"""

from __future__ import annotations

import hashlib
import math
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import U64x1, U64x2
from phalanx.config.mission import MissionConfig
from phalanx.mission import Experience
from phalanx.mission.landmarks import LaserScan, extract
from phalanx.mission.observable import MM_PER_M
from phalanx.mission.walk.cells import search_cells, search_shapes
from phalanx.mission.walk.search import Budget
from phalanx.mission.walk.search_paper import PaperSearch
from phalanx.papers.statement import Statement
from phalanx.papers.table import Rows, Table, seed_of

from .drive import encoded, record

GRIDS_MM = (400, 200, 100, 50, 25)
# (2 rings + 1)^2 for ±0.5 m, Encoded graphs §VI-B.
PAPER_CELLS = (9, 25, 121, 441, 1681)
SCANS = 60  # per drive, evenly spaced
# Search half a metre to all sides, as in the paper (§VI-B): the robot's pose is less certain than that (LOST).
PAPERS = MissionConfig(tolerance_m=0.5)
LOST = (1.0, 0.0, 0.0, 1.0, 0.0, 1e-4)
DRIFT_M = 0.15  # standard deviation of the estimate on each axis, typical between two fixes
COLUMNS = ("compiled_s", "plain_s", "trials")
EXTRACTION = "extraction"


def cases(seeds: int) -> list[str]:
    """Return the cases ordered by seed: the extraction once, the search for each grid."""
    kinds = (EXTRACTION, *(f"grid {grid_mm}" for grid_mm in GRIDS_MM))
    return [f"{kind};seed {seed}" for seed in range(seeds) for kind in kinds]


def measure_case(case: str, _tell: object = None) -> Rows:
    """Return (SCANS, 3): compiled and plain times for the scans of one drive, and hashes tried."""
    kind, named = case.split(";")
    seed = seed_of(named)
    drive = record(seed)
    picked = np.linspace(0, len(drive.scans) - 1, SCANS).astype(int)
    scans = [drive.scans[i] for i in picked]
    if kind == EXTRACTION:
        return np.column_stack([_extraction_s(scans), _plain_extraction_s(scans), np.zeros(SCANS)])
    chance = np.random.default_rng([seed, 3])
    poses = drive.poses[picked]
    poses[:, :2] += chance.normal(0, DRIFT_M, (SCANS, 2))
    grid_mm = int(kind.removeprefix("grid "))
    compiled_s, trials = _search_s(scans, poses, grid_mm)
    with use_plain_hash():
        plain_s, plain_trials = _search_s(scans, poses, grid_mm)
    assert np.array_equal(trials, plain_trials), "both search the same cells in the same order"
    return np.column_stack([compiled_s, plain_s, trials])


def _extraction_s(scans: list[LaserScan]) -> Rows:
    extract(scans[0])  # the first call takes longer
    out = []
    for scan in scans:
        started = time.perf_counter()
        extract(scan)
        out.append(time.perf_counter() - started)
    return np.array(out)


def _plain_extraction_s(scans: list[LaserScan]) -> Rows:
    """Measure the uncompiled extraction, in a new process: kernels choose the compiled form on import."""
    with mock.patch.dict(os.environ, PHALANX_PURE="1"), ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(_extraction_s, scans).result()


def _search_s(scans: list[LaserScan], poses: NDArray[np.float64], grid_mm: int) -> tuple[Rows, Rows]:
    """Return (seconds, hashes) until the first match or the end of the search, with a new search for each scan."""
    mission, config = encoded((), grid_mm), PAPERS
    nodes = tuple(range(len(mission.nodes)))
    took, trials = [], []
    for first, scan, pose in zip((True, *[False] * len(scans)), (scans[0], *scans), (poses[0], *poses), strict=True):
        x, y, heading = pose.tolist()
        search = PaperSearch(mission, config)
        nothing_seen = Experience(0.0, x, y, heading, spread=LOST)
        list(search.run(nodes, nothing_seen, (), b"", Budget(config.hash_tries)))  # builds the groups
        seen = Experience(0.0, x, y, heading, spread=LOST, landmarks=extract(scan).landmarks(x, y, heading))
        budget = Budget(config.hash_tries)
        started = time.perf_counter()
        next(search.run(nodes, seen, (), b"", budget), None)
        if not first:  # the first call takes longer
            took.append(time.perf_counter() - started)
            trials.append(budget.used)
    return np.array(took), np.array(trials, float)


@contextmanager
def use_plain_hash() -> Iterator[None]:
    """While the body runs, hash as the paper does: with hashlib, one hash at a time."""
    around: Any = search_cells
    of_all: Any = search_shapes
    with (
        mock.patch("phalanx.mission.walk.cells.find", plain_find),
        mock.patch("phalanx.mission.walk.cells.search_cells", around.py_func),
        mock.patch("phalanx.mission.walk.search_paper.search_shapes", of_all.py_func),
    ):
        yield


def plain_find(template: U64x1, word: int, shift: np.uint64, patches: U64x1, targets: U64x2) -> tuple[int, int]:
    """Uncompiled equivalent of `find` in phalanx.crypto.sha3."""
    wanted = {row.tobytes(): k for k, row in reversed(list(enumerate(targets)))}
    padded, at = bytearray(template.tobytes()), 8 * word + int(shift) // 8
    padded[-1] ^= 0x80
    trial = bytearray(padded.rstrip(b"\0")[:-1])  # without the padding suffix
    for i, patch in enumerate(patches.tolist()):
        trial[at : at + 8] = patch.to_bytes(8, "little")
        row = wanted.get(hashlib.sha3_256(trial).digest())
        if row is not None:
            return i, row
    return -1, -1


def all_of(table: Table, kind: str, column: str) -> Rows:
    """Return the times of a kind over all cases."""
    return np.concatenate([table.column(case, column) for case in table.cases if case.startswith(f"{kind};")])


def compare(table: Table) -> list[Statement]:
    """Compare our measurements with the statements about Fig. 8c in §VI-B."""
    rings = [math.ceil(PAPERS.tolerance_m * MM_PER_M / grid_mm + 0.5) - 1 for grid_mm in GRIDS_MM]
    cells = tuple((2 * each + 1) ** 2 for each in rings)
    out = [
        Statement(
            what="cells of a whole search, by grid",
            paper=" ".join(map(str, PAPER_CELLS)),
            ours=" ".join(map(str, cells)),
            agrees=cells == PAPER_CELLS,
            why="the same",
        )
    ]
    for column, code in (("plain_s", "plain Python"), ("compiled_s", "compiled")):
        extraction_s = all_of(table, EXTRACTION, column)
        for grid_mm in GRIDS_MM:
            search_s = all_of(table, f"grid {grid_mm}", column)
            ratio = float(np.median(extraction_s) / np.median(search_s))
            gains = [
                float(np.median(all_of(table, kind, "plain_s")) / np.median(all_of(table, kind, column)))
                for kind in (EXTRACTION, f"grid {grid_mm}")
            ]
            why = "10 or more: another machine, another extraction"
            if column == "compiled_s":
                # hashlib is compiled in both cases; the paper's extraction and the plain one here are not.
                why = f"10 or more; compiled: extraction {gains[0]:.0f} times as fast, search {gains[1]:.1f}"
            out.append(
                Statement(
                    what=f"landmarks / hashes, median times, {code}, {grid_mm / 1000:g} m",
                    paper="about 100 on average, 1 at worst",
                    ours=f"{ratio:.2g} ({1e3 * np.median(extraction_s):.3g} ms / {1e3 * np.median(search_s):.3g} ms)",
                    agrees=ratio >= 10,
                    why=why,
                )
            )
    return out
