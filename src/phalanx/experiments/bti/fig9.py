"""RoboRebound Fig. 9: one robot lies, its audits fail, it is stopped, and the flock arrives."""

from __future__ import annotations

import numpy as np

from phalanx.experiments.statement import Statement, quantiles

from .attack_trial import stop_bound_s
from .flock import Flock, FlockRuns, at_times, mean_distances_m, read_reference

TIMES_S = (50.0, 100.0, 150.0)
# How far the reference's flock ever is from its own baseline when its liar is switched off after 10 s.
NEAR_M = 4.0
HONEST_SHARE = 0.03


def compare_runs(table: FlockRuns) -> list[Statement]:
    """What the paper says of Fig. 9, the independent reference, and ours.

    Source: RoboRebound §5.3; docs/spec/rebound.md (P1, P2); docs/spec/world.md (within 4 m of the baseline).
    """
    seeds = table.seeds()
    scenario = FLOCK.scenario("attacked", 0)
    told = [table.runs["attacked", seed].summary["compromised"][0] for seed in seeds]
    lived_s = np.array(
        [np.inf if each["safe_mode_s"] is None else each["safe_mode_s"] - each["first_deviation_s"] for each in told]
    )
    bound_s = stop_bound_s(scenario, output_missing=False) or np.inf
    both = [table.runs[case, seed].summary for case in ("honest", "attacked") for seed in seeds]
    wronged = sum(len(summary["correct_in_safe_mode"]) for summary in both)
    alone = sum(len(summary["without_quorum"]) for summary in both)
    statements = [
        Statement(
            what="from its first lie to Safe Mode, s",
            paper="disabled quickly: within T_val, 10 s",
            ours=quantiles(lived_s, ".2f"),
            agrees=bool(lived_s.max() <= bound_s),
            why=f"every seed within T_val + P_check + 1 ms = {bound_s:.3f} s",
        ),
        Statement(
            what="correct robots put in Safe Mode, all runs",
            paper="none",
            ours=f"{wronged}, and {alone} for want of a quorum",
            agrees=wronged == alone == 0,
            why=f"of {len(both)} runs of {scenario.robots} robots, half of them without a liar",
        ),
    ]
    honest_m = mean_distances_m(table, "honest", scenario.goal_m)
    attacked_m = mean_distances_m(table, "attacked", scenario.goal_m)
    times_s = table.runs["attacked", seeds[0]].times_s
    reference = read_reference()["stopped_at_25s"].T
    apart_m = np.abs(attacked_m - honest_m).max(axis=1)
    statements.append(
        Statement(
            what="farthest from the run without a liar, m",
            paper="disturbed briefly",
            reference=f"within {NEAR_M:g}",
            ours=quantiles(apart_m, ".2f"),
            agrees=bool(apart_m.max() <= NEAR_M),
            why="mean distance to the goal of the same correct robots, every 5 s, every seed",
        )
    )
    for t_s in TIMES_S:
        ours_m = at_times(attacked_m, times_s, t_s)
        reference_m = float(np.interp(t_s, reference[0], reference[1]))
        statements.append(
            Statement(
                what=f"mean distance at {t_s:g} s, one liar, m",
                paper="as without a liar" if t_s == TIMES_S[-1] else "",
                reference=f"{reference_m:.1f}",
                ours=quantiles(ours_m),
                agrees=bool(abs(np.median(ours_m) - reference_m) <= max(NEAR_M, HONEST_SHARE * reference_m)),
                why=f"median within {NEAR_M:g} m or {HONEST_SHARE:.0%}: the reference's liar is the middle robot",
            )
        )
    return statements


FLOCK = Flock(name="bti-fig9", reference={"honest": "honest", "attacked": "stopped_at_25s"}, find=compare_runs)
