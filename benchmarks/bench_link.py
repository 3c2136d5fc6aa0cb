"""What the link costs, against limits measured in the same run.

    python benchmarks/bench_link.py [--quick] [--json]

Times differ between machines and from minute to minute; ratios of two things measured in turn hardly do. Ends with 1
if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import platform
import sys

from bench_codec import bench_codec
from bench_latency import bench_latency
from bench_tick import bench_tick
from rows import Row, print_table

SWARMS = (12, 100, 1000)


def measure(quick: bool) -> list[Row]:
    def say(what: str) -> None:
        print(f"{what} …", file=sys.stderr, flush=True)

    say("sealing")
    rows = bench_codec(*(3, 100) if quick else (15, 1000))
    say("latency")
    rows += asyncio.run(bench_latency(*(2, 20) if quick else (10, 200)))
    say("ticks")
    for robots in SWARMS:
        rows += bench_tick(robots, *(2, 3) if quick else (9, 50))
    return sorted(rows, key=lambda row: row.section or 9)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="everything, tiny: seconds, coarse, and no verdict")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    rows = measure(options.quick)
    machine = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load": [round(load, 2) for load in os.getloadavg()],
    }
    if options.json:
        print(json.dumps({"rows": [row.json() for row in rows], **machine}))
    else:
        print_table(rows)
        print(", ".join(f"{key} {value}" for key, value in machine.items()))
    exceeded = [row.what for row in rows if row.holds is False]
    if options.quick:
        return 0
    for what in exceeded:
        print(f"limit exceeded: {what}", file=sys.stderr)
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
