"""Count the files that one sensor reading passes on its way to the audit token that covers it.

    PHALANX_PURE=1 python scripts/files_of_a_reading.py [--names]

A small protected flock is simulated from the poll of a robot's s-node until the robot installs a token for a later
checkpoint. Every file of src/phalanx with an executed function counts; kernels run uncompiled, so that theirs count
too. The exit code is 1 if there are more than 25.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from phalanx.config import BtiConfig
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited import loop
from phalanx.world.scenarios.run import Run

MOST = 25
SOURCES = Path(__file__).resolve().parents[1] / "src" / "phalanx"
ROBOT = 0  # a row
BEGINS_S, ENDS_US, STEP_US = 6.0, 30_000_000, 5_000


@contextmanager
def noted(files: set[str]) -> Iterator[None]:
    """Record the files of all called functions."""
    prefix = f"{SOURCES}/"

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(prefix):
            files.add(frame.f_code.co_filename.removeprefix(prefix))

    sys.setprofile(note)
    try:
        yield
    finally:
        sys.setprofile(None)


def files_of_a_reading() -> set[str]:
    """Return the files, relative to src/phalanx."""
    run = Run(Scenario(robots=4, grid_step_m=10.0, duration_s=30.0, bti=BtiConfig(f_max=1)))
    run.advance(BEGINS_S)
    robot, files = run.world.fleet.robot[ROBOT], set[str]()
    step, now_us = int(robot.step), int(run.world.clock[0].now_us)
    while int(robot.step) == step:  # up to the reading before
        now_us += STEP_US
        loop.run(run.world, now_us)
    step = int(robot.step)
    with noted(files):
        while int(robot.step) == step:  # the reading
            now_us += STEP_US
            loop.run(run.world, now_us)
        checkpoint = int(robot.checkpoint_no)
        while int(robot.start_no) <= checkpoint:  # tokens cover a checkpoint that was taken later
            now_us += STEP_US
            loop.run(run.world, now_us)
            assert now_us < ENDS_US, "no token came"
    return files


def main() -> int:
    """Count, print and compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--names", action="store_true", help="print the files, a line each")
    words = parser.parse_args()
    if os.environ.get("PHALANX_PURE") != "1":
        print("kernels are compiled: PHALANX_PURE=1 python scripts/files_of_a_reading.py", file=sys.stderr)
        return 2
    files = files_of_a_reading()
    if words.names:
        print("\n".join(sorted(files)))
    print(f"{len(files)} files, at most {MOST}", file=sys.stderr)
    return int(len(files) > MOST)


if __name__ == "__main__":
    sys.exit(main())
