"""RoboRebound Fig. 6: bandwidth and storage of 25 robots at 4 m spacing, by f_max and by T_audit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phalanx.config import BtiConfig
from phalanx.papers.statement import Statement, quantiles
from phalanx.papers.table import Rows, Table, seed_of
from phalanx.scenarios.scenario import Scenario

from . import costs

COLUMNS = costs.COLUMNS
ROBOTS, SPACING_M = 25, 4.0
F_MAX, T_AUDIT_S = (1, 2, 3, 4, 5), (2, 4, 6, 8, 10)
PAPERS_F_MAX, PAPERS_T_S = 3, 4
UNPROTECTED = "f_max 0;T_audit 4 s"
# Relative difference up to which medians count as equal, and up to which log growth matches the paper's.
SAME, NEAR = 0.35, 0.1


def point(f_max: int, t_audit_s: int) -> str:
    """Return the name of a point, without the seed."""
    return f"f_max {f_max};T_audit {t_audit_s} s"


def cases(seeds: int) -> list[str]:
    """Return all cases: the run without audits first, then each f_max with each T_audit."""
    return costs.cases_of([UNPROTECTED, *(point(f_max, t_s) for f_max in F_MAX for t_s in T_AUDIT_S)], seeds)


def scenario_of(case: str) -> Scenario:
    """Return the scenario of a case.

    T_val is the larger of 10 s and 2.5 T_audit, so that it spans as many audit rounds as in the paper.
    """
    f_max_part, t_audit, _ = case.split(";")
    f_max, t_s = int(f_max_part.split()[1]), int(t_audit.split()[1])
    bti = BtiConfig(f_max=f_max or PAPERS_F_MAX, t_audit_ms=1000 * t_s, t_val_ms=max(10_000, 2500 * t_s))
    return Scenario(
        name="bti-fig6",
        robots=ROBOTS,
        grid_step_m=SPACING_M,
        d_m=SPACING_M,
        duration_s=costs.DURATION_S,
        defence="hardened" if f_max else "none",
        bti=bti,
        seed=seed_of(case),
    )


def origin() -> dict[str, str]:
    """Return the settings that must be equal for two measurements to share a CSV."""
    return {"scenario": repr(scenario_of(f"{point(PAPERS_F_MAX, PAPERS_T_S)};seed 0"))}


def measure_case(case: str, tell: Callable[[float], None]) -> Rows:
    """Run one case and return its row."""
    return costs.measure_costs(scenario_of(case), tell)


def compare(table: Table) -> list[Statement]:
    """Compare our measurements with the statements about Fig. 6 in §5.2."""
    papers = point(PAPERS_F_MAX, PAPERS_T_S)
    over_f = [point(f_max, PAPERS_T_S) for f_max in F_MAX]
    over_t = [point(PAPERS_F_MAX, t_s) for t_s in T_AUDIT_S]
    app = costs.medians(table, [UNPROTECTED, *over_f, *over_t], "app_bytes_per_s")
    audit_f, audit_t = (costs.medians(table, points, "audit_bytes_per_s") for points in (over_f, over_t))
    logs_f, logs_t = (costs.medians(table, points, "log_bytes") for points in (over_f, over_t))
    growth = costs.over_seeds(table, papers, "log_bytes_per_s")
    slope = float(np.polyfit(T_AUDIT_S, logs_t, 1)[0])
    stored = costs.medians(table, over_f, "stored_bytes")
    the_log = costs.paper()["the log"]
    return [
        Statement(
            what="states sent, with audits and without, B/s",
            paper="a small, fixed amount",
            ours=f"{app.min():.1f} to {app.max():.1f}",
            agrees=bool(app.max() <= 1.02 * app.min()),
            why="the same within 2 %",
        ),
        Statement(
            what="audits sent, each try counted, f_max 1 to 5, T_audit 4 s, kB/s",
            paper="increases with f_max",
            ours=" ".join(f"{each / 1000:.2f}" for each in audit_f),
            agrees=bool((np.diff(audit_f) > 0).all()),
            why=f"each more than the one before; the log alone goes to f_max + 1 auditors, "
            f"{2 * the_log / 1000:.1f} to {6 * the_log / 1000:.1f}",
        ),
        Statement(
            what="audits sent, each try counted, T_audit 2 to 10 s, f_max 3, kB/s",
            paper="does not vary significantly; decreases",
            ours=" ".join(f"{each / 1000:.2f}" for each in audit_t),
            agrees=bool(audit_t.max() <= (1 + SAME) * audit_t.min() and (np.diff(audit_t) <= 0).all()),
            why=f"the greatest at most {SAME:.0%} above the least, never rising: each round sends a checkpoint too, "
            f"of {costs.paper()['a checkpoint']:g} B by the paper's count",
        ),
        Statement(
            what="growth of the log, B/s",
            paper=f"{the_log:g} (up to)",
            ours=quantiles(growth),
            agrees=bool(np.abs(growth / the_log - 1).max() <= NEAR),
            why=f"every seed within {NEAR:.0%}",
        ),
        Statement(
            what="the log's length over T_audit, slope, B/s",
            paper="linear, about 800",
            ours=f"{slope:.0f}",
            agrees=abs(slope / the_log - 1) <= 2 * NEAR,
            why=f"within {2 * NEAR:.0%} of {the_log:g}",
        ),
        Statement(
            what="log and checkpoints, f_max 1 to 5, T_audit 4 s, kB",
            paper="do not grow with f_max",
            ours=" ".join(f"{each / 1000:.2f}" for each in stored),
            agrees=bool((logs_f <= (1 + NEAR) * logs_f[0]).all()),
            why=f"no log more than {NEAR:.0%} longer than with f_max 1: they are shorter",
        ),
        costs.check_no_harm(table),
    ]
