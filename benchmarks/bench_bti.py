"""How much faster than real time protected swarms are simulated, on one core, and where the time goes.

    python benchmarks/bench_bti.py [--quick] [--json]

A run counts only if no correct robot with a quorum was stopped. Stages are told apart by leaving them out: the same
robots without a defence, then whole. Ends with 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from dataclasses import replace

from rows import Row, print_table

from phalanx.config import BtiConfig
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import Scenario

# Robots, grid step and spacing in metres, f_max, least factor of real time.
SWARMS = (
    (25, 25.0, 20.0, 3, 50.0),
    (324, 64.0, 64.0, 2, 5.0),
    (100, 4.0, 4.0, 3, None),
)


def factor(scenario: Scenario) -> tuple[float, dict]:
    """Simulated seconds in a second of CPU, and the run's summary; setting up does not count."""
    run = Run(scenario)
    run.advance(0.1)
    began = time.process_time()
    run.advance(scenario.duration_s)
    return (scenario.duration_s - 0.1) / (time.process_time() - began), run.summary()


def bench_bti(repetitions: int, seconds: float) -> list[Row]:
    rows = []
    for robots, step_m, d_m, f_max, limit in SWARMS:
        bti = BtiConfig(f_max=f_max)
        whole = Scenario(robots=robots, grid_step_m=step_m, d_m=d_m, duration_s=seconds, bti=bti)
        stages = (
            ("bodies, controllers, radio", replace(whole, defence="none")),
            ("trusted nodes, logs and audits", whole),
        )
        name = f"{robots} robots at {step_m:g} m, f_max {f_max}"
        before_ms = 0.0
        for stage, scenario in stages:
            told = [factor(replace(scenario, seed=seed)) for seed in range(repetitions)]
            ms = 1000 / statistics.median(times for times, _ in told)
            note = "CPU a simulated second"
            rows.append(Row(section=0, what=f"  {stage}", measured=ms - before_ms, unit="ms", note=note))
            before_ms = ms
        stopped = sum(len(summary["correct_in_safe_mode"]) for _, summary in told)
        alone = sum(len(summary["without_quorum"]) for _, summary in told)
        rows.insert(
            len(rows) - len(stages),
            Row(
                section=1,
                what=name,
                measured=0.0 if stopped else 1000 / ms,
                unit="x real time",
                limit=limit,
                at_least=True,
                note=f"{seconds:g} s, {repetitions} seeds; correct robots stopped {stopped}, without quorum {alone}",
            ),
        )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one short run each, and no verdict")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    Run(Scenario(robots=5, duration_s=1.0, bti=BtiConfig(f_max=1))).advance(1.0)  # compiles
    rows = bench_bti(1, 2.0) if options.quick else bench_bti(5, 50.0)
    if options.json:
        print(json.dumps({"rows": [row.json() for row in rows]}))
    else:
        print_table(rows)
    exceeded = [row.what for row in rows if row.holds is False]
    if options.quick:
        return 0
    for what in exceeded:
        print(f"limit missed: {what}", file=sys.stderr)
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
