"""The radio alone, beside ns-3: CPU seconds per simulated second, with the traffic that ns-3 was given.

`python benchmarks/bench_radio.py`; ns-3's figures were measured on another machine, so read them as an order of size.
"""

from __future__ import annotations

import gc
import statistics
import sys
import time
from pathlib import Path

from rows import Row, print_table

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "kit"))

from radio_replay import replay

# Robots, spacing in metres, ns-3's CPU seconds per simulated second.
SCENES = ((25, 64, "0.03"), (100, 64, "0.32"), (324, 64, "2.5 to 2.8"), (324, 4, "12 to 19"))


def bench_radio(repetitions: int, seconds: float) -> list[Row]:
    rows = []
    for robots, spacing_m, ns3 in SCENES:
        spent = []
        for seed in range(repetitions):
            gc.collect()
            began = time.process_time()
            run = replay(robots, spacing_m, seconds=seconds, audits=True, seed=seed)
            spent.append((time.process_time() - began) / seconds)
        rows.append(
            Row(
                section=0,
                what=f"radio of {robots} robots at {spacing_m} m, a simulated second",
                measured=statistics.median(spent) * 1000,
                unit="ms CPU",
                note=f"ns-3: {ns3} s; broadcasts delivered {run.broadcast:.3f}; {run.events / seconds:.0f} events/s",
            )
        )
    return rows


if __name__ == "__main__":
    print_table(bench_radio(repetitions=5, seconds=20))
