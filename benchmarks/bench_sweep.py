"""How much faster two workers make a sweep than one: at least 1.8 times, with each start of dask.

    python benchmarks/bench_sweep.py [--runs 2000] [--pairs 3] [--json]

Both make the same runs, in turns, and the median of the pairs counts. 2000 runs are under a minute's work; one seed of
a scorecard has five minutes and more. A start is not shared, so what is shorter gains less: a short sweep stands beside
it, without a limit. It wants two processors that nobody else uses:
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

from phalanx.lab.sweep.dealing import run_sweep
from phalanx.lab.sweep.plan import read_sweep
from phalanx.lab.sweep.store import Store

LIMIT = 1.8
SHORT = 600
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


def gain(folder: Path, runs: int, pairs: int, limit: float | None) -> list[Row]:
    """What the second worker is good for, and how many runs the first makes in a second."""
    took = [[sweep(folder, runs, workers) for workers in (1, 2)] for _ in range(pairs)]
    ratios = [one_s / two_s for (one_s, _), (two_s, _) in took]
    shares = [
        statistics.median(cpu_s / (k + 1) / took_s for took_s, cpu_s in (pair[k] for pair in took)) for k in (0, 1)
    ]
    return [
        Row(
            section=0,
            what=f"{runs} runs of flock-12: two workers, of one",
            measured=statistics.median(ratios),
            unit="times",
            limit=limit,
            at_least=True,
            note=f"{min(ratios):.2f} to {max(ratios):.2f} in {pairs} pairs; runs took {100 * shares[0]:.0f} % of "
            f"the one's time, {100 * shares[1]:.0f} % of each of two",
        ),
        Row(
            section=0,
            what=f"{runs} runs: runs a second, one worker",
            measured=statistics.median(runs / one_s for (one_s, _), _ in took),
            unit="1/s",
        ),
    ]


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--runs", type=int, default=2000)
    words.add_argument("--pairs", type=int, default=3)
    words.add_argument("--json", action="store_true")
    said = words.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        sweep(folder, 2, 1)  # warm
        rows = gain(folder, said.runs, said.pairs, LIMIT) + gain(folder, SHORT, said.pairs, None)
    if said.json:
        print(json.dumps([row.json() for row in rows]))
    else:
        print_table(rows)
    return int(any(row.holds is False for row in rows))


if __name__ == "__main__":
    sys.exit(main())
