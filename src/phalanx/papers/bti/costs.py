"""Measure the cost of audits, in bytes sent and stored: shared by RoboRebound Figs. 6 and 7.

A case is one point under one seed; its row holds means over the robots. The paper's points come from the numbers in
its text (data/paper_costs.csv) and from sums of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from phalanx.papers.statement import Statement
from phalanx.papers.table import Rows, Table, read_data
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run

COLUMNS = (
    "app_bytes_per_s",  # sent, flock states only
    "audit_bytes_per_s",  # sent, audit packets, every radio attempt counted
    "audit_airtime_pct",  # share of the time that audit packets occupy the channel
    "log_bytes_per_s",  # growth of the log
    "log_bytes",  # largest length of the log during the run
    "stored_bytes",  # largest length of log and checkpoints together
    "neighbours",  # robots in radio range, mean over the run
    "wronged",  # correct robots in Safe Mode, whole run
    "without_quorum",
    "contacts",
)
DURATION_S = 50.0  # as in the paper
WARM_S = 10.0  # by then the first audit rounds are over, and every neighbour is known
NEIGHBOURS = 24  # in the paper's estimate


@cache
def paper() -> dict[str, float]:
    """Return the values in data/paper_costs.csv by quantity."""
    return {row["what"]: float(row["value"]) for row in read_data("paper_costs.csv")}


def paper_log_bytes_per_s(neighbours: float) -> float:
    """Return the log growth of a robot with that many neighbours. Source: RoboRebound §5.2."""
    of_states = paper()["state entries"] * (neighbours + 1) / (NEIGHBOURS + 1)
    return paper()["sensor entries"] + paper()["actuator entries"] + of_states


def paper_stored_bytes(t_audit_s: NDArray[np.float64] | float, neighbours: float = NEIGHBOURS) -> NDArray[np.float64]:
    """Return the size of one round's log and two checkpoints, as RoboRebound §5.2 estimates it.

    The paper prunes checkpoints "down to the most recent two".
    """
    checkpoint = paper()["a checkpoint"] - paper()["of it a neighbour"] * (NEIGHBOURS - neighbours)
    return np.asarray(t_audit_s * paper_log_bytes_per_s(neighbours) + 2 * checkpoint)


def cases_of(points: Iterable[str], seeds: int) -> list[str]:
    """Return the cases ordered by seed, so that an interrupted measurement has all points of the finished seeds."""
    named = list(points)
    return [f"{point};seed {seed}" for seed in range(seeds) for point in named]


def measure_costs(scenario: Scenario, tell: Callable[[float], None]) -> Rows:
    """Run the scenario and return one row of COLUMNS, (1, len(COLUMNS))."""
    most = {"log_len": np.zeros(scenario.robots), "stored": np.zeros(scenario.robots)}
    grown, grew_s = np.zeros(scenario.robots), np.zeros(scenario.robots)
    before: tuple[float, NDArray[np.int64]] | None = None
    neighbours: list[float] = []

    def look(run: Run) -> None:
        nonlocal before
        robot, now_s = run.world.fleet.robot, run.now_s
        length: NDArray[np.int64] = robot["log_len"].copy()
        most["log_len"] = np.maximum(most["log_len"], length)
        # A robot that stores no log takes no checkpoints.
        most["stored"] = np.maximum(most["stored"], length + (robot["start_len"] + robot["pending_len"]) * (length > 0))
        if before and now_s > WARM_S:
            more = length - before[1]
            grown[more > 0] += more[more > 0]  # a log that was truncated in between does not show its growth
            grew_s[more >= 0] += now_s - before[0]
        before = now_s, length
        if now_s % 5.0 == 0.0:
            neighbours.append(_neighbours(run))
        tell(now_s / scenario.duration_s)

    summary = run_scenario(scenario, on_step=look).summary()
    rates = summary["tried_bytes_per_s_per_robot"]
    return np.array(
        [
            (
                rates["app"],
                rates["audit"],
                summary["airtime_pct_per_robot"]["audit"],
                float((grown / np.maximum(grew_s, 1e-9)).mean()),
                float(most["log_len"].mean()),
                float(most["stored"].mean()),
                float(np.mean(neighbours)),
                len(summary["correct_in_safe_mode"]),
                len(summary["without_quorum"]),
                summary["contacts"],
            )
        ],
        np.float64,
    )


def _neighbours(run: Run) -> float:
    places_m = run.positions_m
    apart_m = np.linalg.norm(places_m[:, None] - places_m[None], axis=2)
    return float((apart_m <= run.scenario.radio.range_m).sum() / len(places_m) - 1)


def over_seeds(table: Table, point: str, column: str) -> NDArray[np.float64]:
    """Return (S,) values of a column for a point, one for each measured seed."""
    at = table.columns.index(column)
    return np.array([rows[0, at] for case, rows in table.cases.items() if case.startswith(f"{point};")])


def medians(table: Table, points: Iterable[str], column: str) -> NDArray[np.float64]:
    """Return (P,) medians over the seeds of each point."""
    return np.array([np.median(over_seeds(table, point, column)) for point in points])


def check_no_harm(table: Table) -> Statement:
    """Check that no robots collided and no correct robot was put into Safe Mode. Source: RoboRebound §5.2."""
    wronged, alone, contacts = (
        sum(int(rows[0, table.columns.index(name)]) for rows in table.cases.values())
        for name in ("wronged", "without_quorum", "contacts")
    )
    return Statement(
        what="correct robots in Safe Mode; contacts, all runs",
        paper="none; none",
        ours=f"{wronged}, and {alone} for lack of a quorum; {contacts}",
        agrees=wronged == alone == contacts == 0,
        why=f"none, in {len(table.cases)} runs",
    )
