"""How many robots complete a mission, over many seeds, and whether any fix was false.

    python scripts/mission_completion.py [MISSION] [--profile sealed] [--noise 0.03,0.05,stage] [--seeds 50]

One line a seed, and one in all.
"""

from __future__ import annotations

import argparse
import random

from phalanx.cli.mission.files import read_plain
from phalanx.mission import BuildOptions, Profile, build
from phalanx.sim.building.floorplan import load_floorplan
from phalanx.sim.building.odometry import OdometryNoise
from phalanx.sim.missions.run import run_mission, summary
from phalanx.sim.missions.setup import MissionRun, Part


def main() -> None:
    """Print the table."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("mission", nargs="?", default="office")
    words.add_argument("--profile", choices=["paper", "sealed"], default="paper")
    words.add_argument("--noise", default="0.03,0.05,stage")
    words.add_argument("--seeds", type=int, default=50)
    words.add_argument("--first", type=int, default=0)
    said = words.parse_args()
    plain = read_plain(said.mission)
    plan = load_floorplan(plain.floor_plan)
    assert plan.start is not None, "our maps say where robots begin"
    built = build(plain, BuildOptions(profile=Profile[said.profile.upper()]), random.Random(0).randbytes)  # noqa: S311
    parts = tuple(Part(each.mission, each.key, plan.start) for each in built)
    completed = false_fixes = 0
    for seed in range(said.first, said.first + said.seeds):
        run = MissionRun(plan=plan, parts=parts, seed=seed, noise=OdometryNoise.parse(said.noise))
        told = summary(run, run_mission(run))
        completed += told["completed"]
        false_fixes += told["false_fixes"]
        print(
            f"seed {seed:3}   completed {told['completed']}   {told['decoded']}/{told['nodes']}   "
            f"{told['t_s']:.0f} s   false fixes {told['false_fixes']}   "
            f"pose error {told['pose_error_m_p50']:.3f} / {told['pose_error_m_max']:.3f} m   "
            f"odometry {told['odometry_error_m_max']:.1f} m   {told['not_validated']}",
            flush=True,
        )
    print(
        f"{said.mission} {said.profile} {said.noise}: {completed} of {said.seeds} completed, {false_fixes} false fixes"
    )


if __name__ == "__main__":
    main()
