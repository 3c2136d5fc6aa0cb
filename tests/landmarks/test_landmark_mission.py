"""Floor plan → landmarks → encoded mission, for every map."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest

from phalanx.config.lidar import ExtractionConfig
from phalanx.mission import BuildOptions, Profile, build
from phalanx.mission.authoring.survey import most_spacious_start, survey
from phalanx.mission.authoring.survey import with_start as begun_in
from phalanx.mission.landmarks import landmarks_of
from phalanx.world.building.floorplan import MAPS, load_floorplan

OTHERS = Path(__file__).parent.parent / "data" / "maps"
# A whole floor, and halls of shelves: most of the time of all the maps.
LARGE = dict.fromkeys(("willow-full", "nav2_warehouse", "nav2_depot"), pytest.mark.long)


def draws(size, seed=[0]):  # noqa: B006  # counts the draws
    seed[0] += 1
    return hashlib.shake_256(str(seed[0]).encode()).digest(size)


@pytest.mark.parametrize(
    "path",
    [
        *(pytest.param(MAPS / f"{name}.yaml", marks=pytest.mark.long) for name in ("nav2_depot", "aws_small_house")),
        *(pytest.param(path, marks=LARGE.get(path.stem, ())) for path in sorted(OTHERS.glob("*.yaml"))),
    ],
    ids=lambda path: path.stem,
)
def test_every_map_of_ros_compiles_to_a_mission(path):
    plan = load_floorplan(path)
    if plan.start is None:
        plan = begun_in(plan, most_spacious_start(plan))
    if len(plan.walls) > 3000:
        # A whole floor of an institute: compiled here without its thousand corners.
        plan = replace(plan, outlines=plan.outlines[:3])
    (built,) = build(survey(plan), BuildOptions(profile=Profile.PAPER), draws)
    assert len(built.mission.nodes) > 5


def test_settings_for_real_doors_change_what_a_map_shows():
    plan = load_floorplan(OTHERS / "willow-full.yaml")
    papers, real = landmarks_of(plan), landmarks_of(plan, ExtractionConfig(door_min_m=0.7))
    count = [sum(site.type == "doorway" for site in sites) for sites in (papers, real)]
    assert count[1] > count[0]
