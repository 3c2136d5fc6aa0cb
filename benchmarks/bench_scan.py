"""What a scan of 1080 beams costs: casting its rays, and finding walls, corners, doorways and rooms in it.

    python benchmarks/bench_scan.py [--quick] [--json]

Ends with 1 if a limit is exceeded. The notes say what the same functions take uncompiled.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time

import numpy as np
from rows import Row, print_table

from phalanx.config.lidar import LidarConfig
from phalanx.mission.landmarks import extract
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.walkers import free_place

RUNS, QUICK_RUNS, PLAIN_RUNS = 400, 50, 6
LIMIT_US = 150.0
CAST, OFFICE, SWEEP, EXTRACT, LANDMARKS = (
    "rays against 100 walls",
    "rays in office_40x40",
    "a sweep with noise, office_40x40",
    "features of a scan",
    "features as landmarks",
)


def median_us(work, arguments) -> float:
    work(*arguments[0])
    times = []
    for given in arguments:
        start = time.perf_counter()
        work(*given)
        times.append(time.perf_counter() - start)
    return 1e6 * statistics.median(times)


def measure(runs: int) -> dict[str, float]:
    random = np.random.default_rng(1)
    plan = load_floorplan("office_40x40")
    poses = [(*free_place(plan, 0.3, random), random.uniform(-math.pi, math.pi)) for _ in range(runs)]
    office = Lidar(plan.walls)
    # A hundred walls of one to six metres, anywhere around.
    ends = random.uniform(-15, 15, (100, 2))
    turns, lengths = random.uniform(0, math.tau, 100), random.uniform(1, 6, 100)
    hundred = Lidar(np.hstack([ends, ends + lengths[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])]))
    around = [(*random.uniform(-10, 10, 2), random.uniform(-math.pi, math.pi)) for _ in range(runs)]
    scans = [office.sweep(pose, random) for pose in poses]
    features = [extract(scan) for scan in scans]
    return {
        CAST: median_us(hundred.true_ranges, [(pose,) for pose in around]),
        OFFICE: median_us(office.true_ranges, [(pose,) for pose in poses]),
        SWEEP: median_us(lambda pose: office.sweep(pose, random), [(pose,) for pose in poses]),
        EXTRACT: median_us(extract, [(scan,) for scan in scans]),
        LANDMARKS: median_us(lambda seen, pose: seen.landmarks(*pose), list(zip(features, poses, strict=True))),
    }


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--quick", action="store_true", help="coarse, and no verdict")
    words.add_argument("--json", action="store_true")
    words.add_argument("--plain", action="store_true", help=argparse.SUPPRESS)
    said = words.parse_args()
    if said.plain:
        print(json.dumps(measure(PLAIN_RUNS)))
        return 0
    compiled = measure(QUICK_RUNS if said.quick else RUNS)
    plain = json.loads(
        subprocess.run(
            [sys.executable, __file__, "--plain"],
            env={**os.environ, "PHALANX_PURE": "1"},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    )
    rows = [
        Row(
            section=3 if name in (CAST, EXTRACT) else 0,
            what=f"{name}, {LidarConfig().beams} beams",
            measured=us,
            unit="µs",
            limit=LIMIT_US if name in (CAST, EXTRACT) else None,
            note=f"uncompiled {plain[name]:.0f} µs, {plain[name] / us:.0f} times",
        )
        for name, us in compiled.items()
    ]
    if said.json:
        print(json.dumps([row.json() for row in rows]))
    else:
        print_table(rows)
    return 0 if said.quick or all(row.holds is not False for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
