"""A small run that is recorded, with a liar, a disc and a box."""

from __future__ import annotations

from phalanx.config.flock import Box, Disc, FlockConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario

SCENARIO = Scenario(
    name="small",
    robots=9,
    grid_step_m=10.0,
    d_m=10.0,
    goal_m=(80.0, 30.0),
    duration_s=17.1,
    seed=5,
    attacks=(AttackSpec(name="spoof", robot=4, at_s=2.0),),
    obstacles=(Disc(x_m=40, y_m=60, radius_m=3), Box(left_m=50, bottom_m=-60, right_m=60, top_m=-55)),
    flock=FlockConfig(c1_beta=1.0),
)
