"""RoboRebound Fig. 8: one robot lies, nobody stops it, and the flock stays away from its goal."""

from __future__ import annotations

import numpy as np

from phalanx.experiments.statement import Statement, quantiles

from .flock import Flock, FlockRuns, at_times, mean_distances_m, read_reference

TIMES_S = (50.0, 100.0, 150.0)
# Two implementations of one law, whose broadcasts come at other moments.
HONEST_SHARE = 0.03
# When the flock has come to rest before the lies. Whose name is used for whom is drawn, so that now and then a robot
# slips through: the reference's own mean sinks by 3 % from then to the end, and ours by up to 5 % in single seeds.
PLATEAU_FROM_S = 100.0
PLATEAU_SHARE = 0.05


def compare_runs(table: FlockRuns) -> list[Statement]:
    """What the paper says of Fig. 8, the independent reference, and ours.

    Source: RoboRebound §5.3; docs/spec/world.md (tolerances: 3 % honest).
    """
    goal_m = FLOCK.scenario("honest", 0).goal_m
    honest_m = mean_distances_m(table, "honest", goal_m, of_the_honest_in_both=False)
    attacked_m = mean_distances_m(table, "attacked", goal_m)
    reference = read_reference()
    times_s = table.runs["honest", table.seeds()[0]].times_s
    statements = []
    for t_s in TIMES_S:
        ours_m = at_times(honest_m, times_s, t_s)
        reference_m = float(np.interp(t_s, *reference["honest"].T[:2]))
        agrees = bool(np.all(np.abs(ours_m / reference_m - 1) <= HONEST_SHARE))
        statements.append(
            Statement(
                what=f"mean distance at {t_s:g} s, all honest, m",
                paper="near the goal at 150 s" if t_s == TIMES_S[-1] else "",
                reference=f"{reference_m:.1f}",
                ours=quantiles(ours_m),
                agrees=agrees,
                why=f"every seed within {HONEST_SHARE:.0%} of the reference",
            )
        )
    late = times_s >= PLATEAU_FROM_S
    ours_m = attacked_m[:, late].mean(axis=1)
    rows = reference["attacked"]
    reference_m = float(rows[rows[:, 0] >= PLATEAU_FROM_S, 1].mean())
    statements.append(
        Statement(
            what=f"mean distance from {PLATEAU_FROM_S:g} s on, one liar, m",
            paper="held near 150",
            reference=f"{reference_m:.1f}",
            ours=quantiles(ours_m),
            agrees=bool(np.all(np.abs(ours_m / reference_m - 1) <= PLATEAU_SHARE)),
            why=f"every seed within {PLATEAU_SHARE:.0%} of the reference: lies are at z = 150 m, spacing comes on top",
        )
    )
    stopped = [seed for seed in table.seeds() if table.runs["attacked", seed].summary["compromised"][0]["safe_mode_s"]]
    statements.append(
        Statement(
            what="seeds in which the liar was stopped",
            paper="none: nobody stops it",
            ours=f"{len(stopped)} of {len(table.seeds())}",
            agrees=not stopped,
            why="there is no defence",
        )
    )
    touched = {
        case: np.array([table.runs[case, seed].summary["contacts"] for seed in table.seeds()], float)
        for case in ("honest", "attacked")
    }
    statements.append(
        Statement(
            what="times that two robots touched: all honest; one liar",
            paper="flocking avoids crashes",
            ours=f"{touched['honest'].sum():.0f}; {quantiles(touched['attacked'], '.0f')}",
            agrees=not touched["honest"].any(),
            why="none while all are honest; the law knows no collisions, so that a liar can press robots together",
        )
    )
    return statements


FLOCK = Flock(name="bti-fig8", reference={"honest": "honest", "attacked": "attacked"}, find=compare_runs)
