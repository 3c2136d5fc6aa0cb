"""RoboRebound Fig. 2: 125 robots in a grid of obstacles, and ten of them that keep the others away from the goal.

The paper gives neither places, nor gains, nor the time: `bti-fig2` says ours, with obstacles that push (c1_beta and
c2_beta 0.5; Table 3 has 0 for an evaluation without obstacles). The ten share the work, so that each robot hears as
many lies as in Fig. 8; ten times as many fill the channel.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from phalanx.config.flock import Disc
from phalanx.experiments.statement import Statement, quantiles

from .flock import Flock, FlockRun, FlockRuns

# Where the grid of obstacles ends; 125 robots 20 m apart fill 118 m about the goal, and obstacles take some of that.
ARRIVED_M = 140.0
# When honest robots have come to rest.
LATE_FROM_S = 200.0
MOST_PCT = 50.0


def compare_runs(table: FlockRuns) -> list[Statement]:
    """What the paper says of Fig. 2, and ours. Source: RoboRebound §2.4."""
    honest, attacked = table.of("honest"), table.of("attacked")
    arrived = np.array([100 * (_to_goal_m(run)[-1] <= ARRIVED_M).mean() for run in honest])
    nearest = np.array([_to_goal_m(run)[_late(run)].min(axis=1).mean() for run in attacked])
    means, attacked_means = (
        np.array([_to_goal_m(run)[_late(run)].mean() for run in runs]) for runs in (honest, attacked)
    )
    away = np.array([100 * (_to_goal_m(run)[_late(run)] > ARRIVED_M).mean() for run in attacked])
    hit = sum(int(_inside(run).any(axis=0).sum()) for run in honest)
    return [
        Statement(
            what=f"all honest: robots within {ARRIVED_M:g} m of the goal at the end, %",
            paper="all reach the target as a group",
            ours=quantiles(arrived),
            agrees=bool((arrived == 100).all()),
            why="all of them, every seed",
        ),
        Statement(
            what="all honest: robots ever inside an obstacle",
            paper="all move around them",
            ours=f"{hit} of {sum(run.positions_m.shape[1] for run in honest)}",
            agrees=hit == 0,
            why="none, looked at every 5 s",
        ),
        Statement(
            what=f"mean distance from {LATE_FROM_S:g} s on, m, all honest; ten liars",
            paper="correct robots stay away from the destination",
            ours=f"{quantiles(means)}; {quantiles(attacked_means)}",
            agrees=bool((attacked_means >= 2 * means).all()),
            why="with liars at least twice as far, every seed",
        ),
        Statement(
            what=f"correct robots farther than {ARRIVED_M:g} m from then on, %, ten liars",
            paper="even those that hear no liar are affected",
            ours=f"{quantiles(away)}; the nearest at {quantiles(nearest)} m",
            agrees=bool((away > MOST_PCT).all()),
            why="most of them, every seed; lies are at z = 150 m, and liars themselves go on to the goal",
        ),
    ]


def _to_goal_m(run: FlockRun) -> NDArray[np.float64]:
    """(T, correct robots)."""
    return run.distances_m(_goal())[:, ~run.liars]


@cache
def _goal() -> tuple[float, float]:
    return FLOCK.scenario("honest", 0).goal_m


def _late(run: FlockRun) -> NDArray[np.bool_]:
    return run.times_s >= LATE_FROM_S


def _inside(run: FlockRun) -> NDArray[np.bool_]:
    """(T, N), whether a robot is within an obstacle."""
    found = np.zeros(run.positions_m.shape[:2], bool)
    for each in FLOCK.scenario("honest", 0).obstacles:
        assert isinstance(each, Disc), "the figure's are round"
        found |= np.hypot(*(run.positions_m - (each.x_m, each.y_m)).transpose(2, 0, 1)) < each.radius_m
    return found


FLOCK = Flock(name="bti-fig2", reference={}, find=compare_runs)
