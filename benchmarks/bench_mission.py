"""What the hash search costs, against hashlib in a loop measured in the same run.

    python benchmarks/bench_mission.py [--quick] [--json]

Ends with 1 if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import statistics
import struct
import sys
from collections.abc import Callable

import numpy as np
from rows import Row, print_table, timed

from phalanx.config.mission import CodingConfig
from phalanx.crypto.keys import scrypt
from phalanx.crypto.sha3 import Targets, find_patched
from phalanx.mission import (
    BuildOptions,
    Draft,
    Experience,
    Landmark,
    Position,
    Profile,
    State,
    Walker,
    build,
    parse_mission,
)
from phalanx.mission.walk.searched import spiral

MESSAGE_BYTES = 40
FINE_RINGS = 20  # ±0.5 m at 2.5 cm: 1681 cells
MISSION_NODES = 10_000


def faster(section: int, what: str, ours: list[float], theirs: list[float], limit: float, count: int) -> Row:
    """Theirs over ours: how many times as fast; times in microseconds for `count` hashes."""
    ratios = [other / mine for mine, other in zip(ours, theirs, strict=True)]
    return Row(
        section=section,
        what=what,
        measured=statistics.median(ratios),
        unit="times",
        limit=limit,
        at_least=True,
        note=f"{1000 * statistics.median(ours) / count:.0f} ns a hash, "
        f"hashlib {1000 * statistics.median(theirs) / count:.0f}",
    )


def in_turn(jobs: dict[str, Callable[[], object]], repetitions: int, count: int) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()  # warm
    for _ in range(repetitions):
        for name, job in jobs.items():
            times[name].append(timed(job, count))
    return times


def bench_hashes(repetitions: int, count: int) -> list[Row]:
    steps = spiral(FINE_RINGS)
    before, after = bytes(9), bytes(MESSAGE_BYTES - 17)
    targets = Targets([os.urandom(32) for _ in range(32)])
    wanted = {targets.rows[i].tobytes() for i in range(32)}
    dx, dy = (np.array(axis) for axis in zip(*steps, strict=True))

    def search() -> object:
        xs, ys = (120 + dx).astype(np.uint32).astype(np.uint64), (77 + dy).astype(np.uint32).astype(np.uint64)
        return find_patched(before + bytes(8) + after, len(before), xs | ys << np.uint64(32), targets)

    def search_with_hashlib() -> object:
        for x, y in steps:
            if hashlib.sha3_256(before + struct.pack("<ii", 120 + x, 77 + y) + after).digest() in wanted:
                return x, y
        return None

    times = in_turn(
        {
            "search": search,
            "plain": search_with_hashlib,
        },
        repetitions,
        count,
    )
    return [
        faster(1, "search of 1681 cells without a match", times["search"], times["plain"], 2.5, len(steps)),
        Row(
            section=0,
            what="search of 1681 cells without a match",
            measured=statistics.median(times["search"]),
            unit="µs",
        ),
    ]


def big_mission() -> Draft:
    draft = Draft("big")
    draft.node("0", Position(0, 0), start=True)
    for i in range(1, MISSION_NODES):
        draft.node(str(i), Landmark("doorway", 4.0 * (i % 100) + 0.013 * (i % 7), 4.0 * (i // 100), 0.1 * (i % 9)))
        draft.way(str(i - 1), str(i), both=True)
    return draft


def bench_missions(repetitions: int) -> list[Row]:
    coding = CodingConfig(delta_mm=400)
    kdf_us = timed(lambda: scrypt(b"p", b"s", log2_n=coding.kdf_log2_n, r=coding.kdf_r, length=64), 5)
    mission = big_mission().mission()
    options = BuildOptions(profile=Profile.PAPER)
    compile_us = timed(lambda: build(mission, options, os.urandom), 1)
    (built,) = build(mission, options, os.urandom)
    raw = built.mission.encode()
    parse_us = timed(lambda: parse_mission(raw), 1)
    walker = Walker(built.mission)
    state, _ = walker.step(State(), Experience(0.0, 0.0, 0.0, 0.0))
    landmarks = tuple(Landmark("doorway", 0.5 * i, 3.0 + i, 0.2 * i) for i in range(10))
    times = []
    for i in range(repetitions):
        # Half a cell on each time: nothing is remembered from the step before.
        moved = tuple(Landmark("doorway", door.x_m + 0.06 * i, door.y_m, door.orientation_rad) for door in landmarks)
        seen = Experience(0.2 + 0.01 * i, 0.0, 0.0, 0.0, landmarks=moved)
        times.append(timed(lambda seen=seen: walker.step(state, seen), 1))  # type: ignore[misc]
    return [
        Row(section=0, what=f"compiling {MISSION_NODES} nodes, paper", measured=compile_us / 1e6, unit="s", limit=10.0),
        Row(section=0, what=f"parsing them, {len(raw)} bytes", measured=parse_us / 1e6, unit="s"),
        Row(section=0, what="one try in the sealed profile (N = 2^12)", measured=kdf_us / 1000, unit="ms"),
        Row(
            section=0,
            what="a step of the walker, ten doorways in view",
            measured=statistics.median(times),
            unit="µs",
            note="paper, Δ = 0.1",
        ),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse, and no verdict")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    repetitions, count = (3, 2) if options.quick else (15, 20)
    rows = bench_hashes(repetitions, count) + bench_missions(repetitions)
    machine = {"python": platform.python_version(), "machine": platform.machine()}
    if options.json:
        print(json.dumps({"rows": [row.json() for row in rows], **machine}))
    else:
        print_table(rows)
        print(f"\n{machine['machine']}, Python {machine['python']}")
    return 0 if options.quick or all(row.holds is not False for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
