"""Ray casting and feature extraction of a 1080-beam scan: microseconds, compiled and plain, in one run.

Asked: 1080 beams against 100 walls, and the extraction, in 150 us each (docs/adr/0019).
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import time

import numpy as np

from phalanx.config.lidar import LidarConfig
from phalanx.mission.landmarks import extract
from phalanx.sim.floorplan import load_floorplan
from phalanx.sim.lidar import Lidar
from phalanx.sim.walkers import free_place

RUNS = 400


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
        "cast, 100 walls": median_us(hundred.true_ranges, [(pose,) for pose in around]),
        f"cast, office ({len(plan.walls)} walls)": median_us(office.true_ranges, [(pose,) for pose in poses]),
        "sweep with noise, office": median_us(lambda pose: office.sweep(pose, random), [(pose,) for pose in poses]),
        "extract": median_us(extract, [(scan,) for scan in scans]),
        "landmarks": median_us(lambda seen, pose: seen.landmarks(*pose), list(zip(features, poses, strict=True))),
    }


def main() -> None:
    if "--plain" in sys.argv:
        print(json.dumps(measure(6)))
        return
    compiled = measure(RUNS)
    plain = json.loads(
        subprocess.run(
            [sys.executable, __file__, "--plain"],
            env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    )
    print(f"{LidarConfig().beams} beams, median of {RUNS}, us")
    for name, us in compiled.items():
        print(f"{name:28}{us:9.1f}   plain {plain[name]:11.0f}   {plain[name] / us:6.0f} x")


if __name__ == "__main__":
    main()
