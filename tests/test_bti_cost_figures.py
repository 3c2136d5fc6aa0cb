"""bti-fig2, bti-fig6 and bti-fig7: what is counted, and that each statement can be seen to agree and to differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phalanx.lab.figures.plot import draw
from phalanx.papers.bti import costs, fig6, fig7, liars
from phalanx.papers.bti.flock import HONEST, LIAR, FlockRun, FlockRuns
from phalanx.papers.figure import FIGURES
from phalanx.papers.table import Table, TableFile
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

SMALL = Scenario(robots=6, grid_step_m=4.0, d_m=4.0, duration_s=16.0)


def row(audit=2000.0, log=4000.0, growth=800.0, neighbours=24.0, **more):
    values = {
        "app_bytes_per_s": 18.0,
        "audit_bytes_per_s": audit,
        "audit_airtime_pct": 1.0,
        "log_bytes_per_s": growth,
        "log_bytes": log,
        "stored_bytes": log + 1000,
        "neighbours": neighbours,
        "wronged": 0,
        "without_quorum": 0,
        "contacts": 0,
    }
    return np.array([[float((values | more)[name]) for name in costs.COLUMNS]])


def a_table(figure, row_of):
    return Table(figure.__name__, {}, costs.COLUMNS, {case: row_of(case) for case in figure.cases(2)})


def as_in_fig6(case, **more):
    f_max, t_s = (int(part.split()[1]) for part in case.split(";")[:2])
    return row((f_max + 1) * (810 + 100 / t_s) if f_max else 0, 806.67 * t_s + 200, 806.67, **more)


def as_in_fig7(case, **more):
    robots, spacing_m = (int(part.split()[0]) for part in case.split(";")[:2])
    near = robots - 1 if spacing_m < 64 else 8 - 12 / robots**0.5
    growth = costs.paper_log_bytes_per_s(near)
    return row(3 * growth, 4 * growth, growth, near, **more)


def differing(figure, row_of):
    return [k for k, each in enumerate(figure.compare(a_table(figure, row_of))) if not each.agrees]


def test_what_the_paper_s_text_says_is_what_its_figures_are_compared_with():
    assert costs.paper_log_bytes_per_s(24) == pytest.approx(costs.paper()["the log"], abs=0.01)
    assert costs.paper_log_bytes_per_s(0) == pytest.approx(136 + 104 + 34 / 1.5, abs=0.01)
    assert costs.paper_stored_bytes(4.0) == pytest.approx(4 * 806.67 + 2 * 690, abs=0.1)


def test_a_row_is_the_run_s():
    told = []
    (found,) = costs.measure_costs(SMALL, told.append)
    got = dict(zip(costs.COLUMNS, found))
    run = Run(SMALL)
    run.advance(SMALL.duration_s)
    assert got["audit_bytes_per_s"] == run.summary()["tried_bytes_per_s_per_robot"]["audit"]
    assert got["neighbours"] == 5
    assert got["log_bytes_per_s"] == pytest.approx(costs.paper_log_bytes_per_s(5), rel=0.1)
    longest = run.world.fleet.robot["log_max"].mean()
    assert 0.8 * longest < got["log_bytes"] <= longest < got["stored_bytes"]
    assert told[-1] == 1.0
    (bare,) = costs.measure_costs(replace(SMALL, defence="none", duration_s=1.0), told.append)
    assert dict(zip(costs.COLUMNS, bare))["stored_bytes"] == 0


def test_fig6_agrees_with_the_paper_s_own_sums():
    assert differing(fig6, as_in_fig6) == []


@pytest.mark.parametrize(
    "case, more, wrong",
    [
        ("f_max 3;T_audit 4 s", {"app_bytes_per_s": 20}, {0}),
        ("f_max 2;T_audit 4 s", {"audit_bytes_per_s": 9000}, {1}),
        ("f_max 3;T_audit 10 s", {"audit_bytes_per_s": 9000}, {2}),
        ("f_max 3;T_audit 4 s", {"log_bytes_per_s": 500}, {3}),
        ("f_max 3;T_audit 10 s", {"log_bytes": 20_000}, {4}),
        ("f_max 5;T_audit 4 s", {"log_bytes": 9000}, {5}),
        ("f_max 1;T_audit 2 s", {"contacts": 1}, {6}),
    ],
)
def test_fig6_sees_what_is_wrong(case, more, wrong):
    found = differing(fig6, lambda each: as_in_fig6(each, **more if each.startswith(f"{case};") else {}))
    assert wrong <= set(found) <= wrong | {5}


def test_fig7_agrees_with_the_paper_s_own_sums():
    assert differing(fig7, as_in_fig7) == []


@pytest.mark.parametrize(
    "case, more, wrong",
    [
        ("36 robots;4 m", {"audit_bytes_per_s": 1.0}, {0}),
        ("100 robots;64 m", {"audit_bytes_per_s": 20_000.0}, {1}),
        ("324 robots;64 m", {"audit_bytes_per_s": 20_000.0}, {2}),
        ("36 robots;4 m", {"stored_bytes": 1.0}, {3}),
        ("324 robots;64 m", {"stored_bytes": 20_000.0}, {5}),
        ("16 robots;4 m", {"log_bytes_per_s": 1.0}, {6}),
        ("16 robots;8 m", {"without_quorum": 1.0}, {7}),
    ],
)
def test_fig7_sees_what_is_wrong(case, more, wrong):
    found = differing(fig7, lambda each: as_in_fig7(each, **more if each.startswith(f"{case};") else {}))
    assert set(found) == wrong


@pytest.mark.parametrize("figure, row_of", [(fig6, as_in_fig6), (fig7, as_in_fig7)])
def test_they_are_drawn_from_the_csv(figure, row_of, tmp_path):
    pytest.importorskip("matplotlib")
    name = f"bti-{figure.__name__.rpartition('.')[2]}"
    path = tmp_path / f"{name}.csv"
    with TableFile(path, Table(figure=name, columns=costs.COLUMNS, origin={"version": "0"})) as file:
        for case in figure.cases(1):
            file.append(case, row_of(case))
    _, svg = draw(path, FIGURES[name])
    assert "<!-- paper's" in svg.read_text()


def test_cases_name_scenarios_that_can_be():
    for figure in (fig6, fig7):
        made = {case: figure.scenario_of(case) for case in figure.cases(2)}
        assert {each.seed for each in made.values()} == {0, 1}
        assert len({repr(each) for each in made.values()}) == len(made)
    assert fig6.scenario_of("f_max 0;T_audit 4 s;seed 0").defence == "none"
    assert {each.bti.f_max for each in made.values()} == {2}, "a robot in the corner hears three others at 64 m"


# --- bti-fig2 ---------------------------------------------------------------------------------------------------------


def fig2_run(case, seed, distance_m, odd_m=None):
    times_s = np.arange(0.0, 201.0, 5.0)
    positions_m = np.tile(np.array(liars.FIG2.scenario(case, seed).goal_m), (len(times_s), 20, 1))
    positions_m[:, :, 0] += distance_m
    if odd_m is not None:
        positions_m[-1, 5, 0] += odd_m
    states = np.full(positions_m.shape[:2], HONEST, np.int8)
    compromised = []
    if case == "attacked":
        states[4:, :2] = LIAR
        compromised = [{"robot": r, "first_deviation_s": 15.0, "safe_mode_s": None} for r in (1, 2)]
    return FlockRun(case, seed, times_s, positions_m, states, {"compromised": compromised, "robots": 20})


@pytest.mark.parametrize(
    "honest_m, odd_m, attacked_m, wrong",
    [
        (50.0, None, 160.0, []),
        (50.0, 100.0, 160.0, [0]),
        (26.0, None, 160.0, []),
        (50.0, None, 135.0, [3]),
        (110.0, None, 160.0, [2]),
    ],
)
def test_fig2_sees_what_is_wrong(honest_m, odd_m, attacked_m, wrong):
    runs = [fig2_run("honest", seed, honest_m, odd_m) for seed in range(2)]
    runs += [fig2_run("attacked", seed, attacked_m) for seed in range(2)]
    found = liars.compare_many(FlockRuns({(run.case, run.seed): run for run in runs}))
    assert [k for k, each in enumerate(found) if not each.agrees] == wrong


def test_fig2_sees_who_is_inside_an_obstacle():
    inside = fig2_run("honest", 0, 25.0)
    inside.positions_m[3, 7] += (0.0, 25.0)
    told = liars.compare_many(FlockRuns({("honest", 0): inside, ("attacked", 0): fig2_run("attacked", 0, 160.0)}))[1]
    assert (told.ours, told.agrees) == ("1 of 20", False)


def test_fig2_is_125_robots_of_whom_ten_lie_among_obstacles():
    scenario = liars.FIG2.scenario("attacked", 3)
    assert (scenario.robots, len(scenario.attacks), scenario.defence, scenario.seed) == (125, 10, "none", 3)
    assert min(scenario.flock.c1_beta, scenario.flock.c2_beta) > 0
    assert len(scenario.obstacles) == 16
    assert liars.FIG2.scenario("honest", 3).attacks == ()
