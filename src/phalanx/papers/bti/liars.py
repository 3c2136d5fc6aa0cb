"""RoboRebound Figs. 2, 8 and 9: flocks whose compromised robots keep the others from the goal until they are stopped.

For Fig. 2 the paper gives neither positions nor gains nor duration, so `bti-fig2` uses our own. Its obstacles repel
(c1_beta and c2_beta 0.5; Table 3 has 0, for an evaluation without obstacles). The ten attackers share the work, so that
each robot receives as many false states as in Fig. 8; ten times as many would saturate the channel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from phalanx.config.flock import Disc
from phalanx.papers.statement import Statement, quantiles
from phalanx.papers.table import Rows

from .flock import Flock, FlockRun, FlockRuns, mean_distances_m, read_reference

# Radius about the goal that the flock fills: 125 robots 20 m apart need 118 m, and obstacles take some of that.
ARRIVED_M = 140.0
# From this time on honest robots have come to rest.
LATE_FROM_S = 200.0
MOST_PCT = 50.0
TIMES_S = (50.0, 100.0, 150.0)
# Tolerance between two implementations of the same control law that broadcast at different times.
HONEST_SHARE = 0.03
# From this time on the flock is at rest under attack. The attacker draws the forged sender at random, so that now and
# then a robot gets past: the reference's mean sinks by 3 % until the end, and ours by up to 5 % for single seeds.
PLATEAU_FROM_S = 100.0
PLATEAU_SHARE = 0.05
# Largest distance of the reference's flock from its own baseline when its attacker is switched off after 10 s.
NEAR_M = 4.0


def compare_many(table: FlockRuns) -> list[Statement]:
    """Compare our measurements with Fig. 2. Source: RoboRebound §2.4."""
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
            why="none, checked every 5 s",
        ),
        Statement(
            what=f"mean distance from {LATE_FROM_S:g} s on, m, all honest; ten liars",
            paper="correct robots stay away from the destination",
            ours=f"{quantiles(means)}; {quantiles(attacked_means)}",
            agrees=bool((attacked_means >= 2 * means).all()),
            why="with liars at least twice as far, every seed",
        ),
        Statement(
            what=f"correct robots farther than {ARRIVED_M:g} m from {LATE_FROM_S:g} s on, %, ten liars",
            paper="even those out of range of all liars are affected",
            ours=f"{quantiles(away)}; the nearest at {quantiles(nearest)} m",
            agrees=bool((away > MOST_PCT).all()),
            why="most of them, every seed; false positions are 150 m from the goal; the liars themselves go on to it",
        ),
    ]


def _to_goal_m(run: FlockRun) -> NDArray[np.float64]:
    """Return (T, correct robots) distances to the goal."""
    return run.distances_m(_goal())[:, ~run.liars]


@cache
def _goal() -> tuple[float, float]:
    return FIG2.scenario("honest", 0).goal_m


def _late(run: FlockRun) -> NDArray[np.bool_]:
    return run.times_s >= LATE_FROM_S


def _inside(run: FlockRun) -> NDArray[np.bool_]:
    """Return (T, N) flags of the robots inside an obstacle."""
    found = np.zeros(run.positions_m.shape[:2], bool)
    for each in FIG2.scenario("honest", 0).obstacles:
        assert isinstance(each, Disc), "the figure's are round"
        found |= np.hypot(*(run.positions_m - (each.x_m, each.y_m)).transpose(2, 0, 1)) < each.radius_m
    return found


def compare_unstopped(table: FlockRuns) -> list[Statement]:
    """Compare our measurements with Fig. 8 and with the independent reference.

    Source: RoboRebound §5.3; docs/spec/world.md (tolerances: 3 % honest).
    """
    goal_m = FIG8.scenario("honest", 0).goal_m
    honest, attacked = table.of("honest"), table.of("attacked")
    statements = _at_times(
        table,
        mean_distances_m(table, "honest", goal_m, of_the_honest_in_both=False),
        "honest",
        robots="all honest",
        at_the_end="near the goal at 150 s",
        agrees=lambda ours_m, reference_m: bool(np.all(np.abs(ours_m / reference_m - 1) <= HONEST_SHARE)),
        why=f"every seed within {HONEST_SHARE:.0%} of the reference",
    )
    late = honest[0].times_s >= PLATEAU_FROM_S
    ours_m = mean_distances_m(table, "attacked", goal_m)[:, late].mean(axis=1)
    rows = read_reference()["attacked"]
    reference_m = float(rows[rows[:, 0] >= PLATEAU_FROM_S, 1].mean())
    stopped = [run for run in attacked if run.summary["compromised"][0]["safe_mode_s"]]
    touched, pressed = (np.array([run.summary["contacts"] for run in runs], float) for runs in (honest, attacked))
    return [
        *statements,
        Statement(
            what=f"mean distance from {PLATEAU_FROM_S:g} s on, one liar, m",
            paper="held near 150",
            reference=f"{reference_m:.1f}",
            ours=quantiles(ours_m),
            agrees=bool(np.all(np.abs(ours_m / reference_m - 1) <= PLATEAU_SHARE)),
            why=f"every seed within {PLATEAU_SHARE:.0%} of the reference: z = 150 m, plus the spacing",
        ),
        Statement(
            what="seeds in which the liar was stopped",
            paper="none: there is no defence",
            ours=f"{len(stopped)} of {len(attacked)}",
            agrees=not stopped,
            why="the run has no defence",
        ),
        Statement(
            what="contacts between two robots: all honest; one liar",
            paper="flocking avoids crashes",
            ours=f"{touched.sum():.0f}; {quantiles(pressed, '.0f')}",
            agrees=not touched.any(),
            why="none while all are honest; the control law has no collision term, so a liar can push robots together",
        ),
    ]


def compare_stopped(table: FlockRuns) -> list[Statement]:
    """Compare our measurements with Fig. 9 and with the independent reference.

    Source: RoboRebound §5.3; docs/promises.md (P1, P2); docs/spec/world.md (within 4 m of the baseline).
    """
    scenario = FIG9.scenario("attacked", 0)
    liars = [run.summary["compromised"][0] for run in table.of("attacked")]
    delay_s = np.array(
        [np.inf if each["safe_mode_s"] is None else each["safe_mode_s"] - each["first_deviation_s"] for each in liars]
    )
    bound_s = scenario.bti.stop_bound_ms(output_missing=False) / 1000
    both = [run.summary for case in ("honest", "attacked") for run in table.of(case)]
    wronged = sum(len(summary["correct_in_safe_mode"]) for summary in both)
    alone = sum(len(summary["without_quorum"]) for summary in both)
    honest_m, attacked_m = (mean_distances_m(table, case, scenario.goal_m) for case in ("honest", "attacked"))
    apart_m = np.abs(attacked_m - honest_m).max(axis=1)
    return [
        Statement(
            what="from the first false state to Safe Mode, s",
            paper="disabled quickly; at most T_val (§4)",
            ours=quantiles(delay_s, ".2f"),
            agrees=bool(delay_s.max() <= bound_s),
            why=f"every seed within T_val + P_check + 1 ms = {bound_s:.3f} s; T_val of 10 s is our choice: the paper's "
            "text gives no value",
        ),
        Statement(
            what="correct robots put in Safe Mode, all runs",
            paper="none",
            ours=f"{wronged}, and {alone} for lack of a quorum",
            agrees=wronged == alone == 0,
            why=f"of {len(both)} runs of {scenario.robots} robots, half of them without a liar",
        ),
        Statement(
            what="farthest from the run without a liar, m",
            paper="disturbed briefly",
            reference=f"within {NEAR_M:g}",
            ours=quantiles(apart_m, ".2f"),
            agrees=bool(apart_m.max() <= NEAR_M),
            why="mean distance to the goal of the same correct robots, every 5 s, every seed",
        ),
        *_at_times(
            table,
            attacked_m,
            "stopped_at_25s",
            robots="one liar",
            at_the_end="as without a liar",
            agrees=lambda ours_m, reference_m: bool(
                abs(np.median(ours_m) - reference_m) <= max(NEAR_M, HONEST_SHARE * reference_m)
            ),
            why=f"median within {NEAR_M:g} m or {HONEST_SHARE:.0%}: the reference's liar is the middle robot",
        ),
    ]


def _at_times(
    table: FlockRuns,
    means_m: Rows,
    series: str,
    *,
    robots: str,
    at_the_end: str,
    agrees: Callable[[Rows, float], bool],
    why: str,
) -> list[Statement]:
    """Compare (S, T) mean distances with a series of the reference at TIMES_S, interpolated linearly."""
    found = []
    for t_s in TIMES_S:
        ours_m = np.array([np.interp(t_s, table.of("honest")[0].times_s, row) for row in means_m])
        reference_m = float(np.interp(t_s, *read_reference()[series].T[:2]))
        found.append(
            Statement(
                what=f"mean distance at {t_s:g} s, {robots}, m",
                paper=at_the_end if t_s == TIMES_S[-1] else "",
                reference=f"{reference_m:.1f}",
                ours=quantiles(ours_m),
                agrees=agrees(ours_m, reference_m),
                why=why,
            )
        )
    return found


FIG2 = Flock(name="bti-fig2", reference={}, find=compare_many)
FIG8 = Flock(name="bti-fig8", reference={"honest": "honest", "attacked": "attacked"}, find=compare_unstopped)
FIG9 = Flock(name="bti-fig9", reference={"honest": "honest", "attacked": "stopped_at_25s"}, find=compare_stopped)
