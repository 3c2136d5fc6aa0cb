"""`phalanx mission draw`: run the robots whose paths are drawn."""

from __future__ import annotations

import os
import random

from phalanx.cli.terminal import Progress, end_status_line
from phalanx.mission import BuildOptions, Mission, Profile, build
from phalanx.mission.landmarks.floorplan import FloorPlan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.report import Report
from phalanx.world.missions.run import run_mission

NOISE = OdometryNoise(0.03, 0.05)  # the defaults of phalanx mission run


def simulate_parts(mission: Mission, plan: FloorPlan, seed: int) -> list[Report]:
    """Run a robot for each part, in the paper profile, which is faster. Raises: UsageError: no room at a start."""
    draws = random.Random(seed).randbytes  # noqa: S311  # the secrets of a simulation protect nothing
    orders = orders_of(mission, build(mission, BuildOptions(profile=Profile.PAPER), draws), plan)
    run = orders.run(noise=NOISE, seed=seed, keep_trace=True)
    progress = Progress()
    try:
        return run_mission(run, os.cpu_count() or 1, lambda share: progress.tell("simulated", share))
    finally:
        end_status_line()
