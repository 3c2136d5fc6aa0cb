"""How much faster two workers make a sweep than one: at least 1.8 times, with each start of dask.

    python benchmarks/bench_sweep.py [--runs 600] [--pairs 3] [--json]

Both make the same runs, in turns, and the median of the pairs counts. It wants two processors that nobody else uses:
the note says what share of a processor each worker had. Ends with 1 if the limit is not kept.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

from rows import Row, print_table

from phalanx.experiments.sweep.cluster import run_sweep
from phalanx.experiments.sweep.plan import read_sweep
from phalanx.experiments.sweep.store import Store

LIMIT = 1.8
SWEEP = "scenario: flock-12\nseeds: {runs}\n"


def sweep(folder: Path, runs: int, workers: int) -> tuple[float, float]:
    """Seconds that the whole took, and of the processor that the runs alone did."""
    file = folder / "sweep.yaml"
    file.write_text(SWEEP.format(runs=runs))
    plan = read_sweep(file)
    with tempfile.TemporaryDirectory(dir=folder) as out, Store(Path(out), plan, "bench") as store:
        began = time.perf_counter()
        failed = run_sweep(plan, store, workers=workers)
        took_s = time.perf_counter() - began
        store.write()
        assert not failed, failed
        return took_s, sum(row["cpu_s"] for row in store.rows())


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--runs", type=int, default=600)
    words.add_argument("--pairs", type=int, default=3)
    words.add_argument("--json", action="store_true")
    said = words.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sweep(Path(folder), 2, 1)  # compiled
        pairs = [[sweep(Path(folder), said.runs, workers) for workers in (1, 2)] for _ in range(said.pairs)]
    ratios = [one_s / two_s for (one_s, _), (two_s, _) in pairs]
    shares = [
        statistics.median(cpu_s / (k + 1) / took_s for took_s, cpu_s in (pair[k] for pair in pairs)) for k in (0, 1)
    ]
    rows = [
        Row(
            section=0,
            what=f"{said.runs} runs of flock-12: two workers, of one",
            measured=statistics.median(ratios),
            unit="times",
            limit=LIMIT,
            at_least=True,
            note=f"{min(ratios):.2f} to {max(ratios):.2f} in {said.pairs} pairs; runs took {100 * shares[0]:.0f} % of "
            f"the one's time, {100 * shares[1]:.0f} % of each of two",
        ),
        Row(
            section=0,
            what="runs a second, one worker",
            measured=statistics.median(said.runs / one_s for (one_s, _), _ in pairs),
            unit="1/s",
        ),
    ]
    if said.json:
        print(json.dumps([row.json() for row in rows]))
    else:
        print_table(rows)
    return int(any(row.holds is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
