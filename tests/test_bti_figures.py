"""Figures 8 and 9: what is counted, what is kept when things go wrong, and that it is drawn from the CSV alone."""

from __future__ import annotations

import csv
import re
import shutil
import statistics
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import phalanx
from phalanx.attacks import ATTACKS
from phalanx.errors import UsageError
from phalanx.lab.figures.flocks import draw_flock
from phalanx.lab.figures.plot import DRAWN_BY, draw
from phalanx.lab.scorecard.flock_trial import FlockTrial, Stop, stop_bound_s, trial_fields, try_attack
from phalanx.papers.bti import flock as bti_flock
from phalanx.papers.bti import liars
from phalanx.papers.bti.flock import (
    COLUMNS,
    HONEST,
    LIAR,
    STOPPED,
    Flock,
    FlockRun,
    FlockRuns,
    mean_distances_m,
    read_reference,
    runs_of,
)
from phalanx.papers.figure import FIGURES, Figure
from phalanx.papers.statement import band, last_line
from phalanx.papers.table import Table, TableFile, measure, read_table
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from pictures import looks_like_a_figure

ORIGIN = {"scenario": "all of it", "every_s": 5.0, "version": "0 (cafe)"}
GOAL_M = (500.0, 500.0)
SMALL = Scenario(
    name="small",
    robots=9,
    grid_step_m=10.0,
    d_m=10.0,
    goal_m=(90.0, 90.0),
    duration_s=10.0,
    attacks=(AttackSpec(name="spoof", at_s=2.0),),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallFlock(Flock):
    """The same measurement over a swarm that is done in a moment."""

    def scenario(self, case, seed):
        return replace(SMALL, seed=seed, attacks=SMALL.attacks if case == "attacked" else ())


SMALL_FIGURE = Figure(
    name="bti-fig9",
    about="small",
    made_by=SmallFlock(name="bti-fig9", reference=liars.FIG9.reference, find=liars.compare_stopped),
)


def flock_run(case, seed, distances_m, liar=None, first_s=15.0, safe_s=None, robots=25, **more):
    """All robots but the liar at the same distance from the goal, given every 5 s."""
    distances_m = np.asarray(distances_m, float)
    positions_m = np.tile(np.array(GOAL_M), (len(distances_m), robots, 1))
    positions_m[:, :, 0] -= distances_m[:, None]
    states = np.full(positions_m.shape[:2], HONEST, np.int8)
    compromised = []
    times_s = 5.0 * np.arange(len(distances_m))
    if liar is not None:
        positions_m[:, liar - 1, 0] = 0.0
        states[times_s >= first_s, liar - 1] = LIAR
        if safe_s is not None:
            states[times_s >= safe_s, liar - 1] = STOPPED
        compromised = [{"robot": liar, "attack": "spoof", "first_deviation_s": first_s, "safe_mode_s": safe_s}]
    summary = {"robots": robots, "compromised": compromised, "correct_in_safe_mode": [], "without_quorum": []}
    summary["contacts"] = 0
    return FlockRun(case, seed, times_s, positions_m.round(3), states, summary | {"seed": seed} | more)


def table_of(*runs):
    return FlockRuns({(run.case, run.seed): run for run in runs})


def same(one: FlockRun, other: FlockRun) -> bool:
    arrays = all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("times_s", "positions_m", "states")
    )
    return arrays and (one.case, one.seed, one.summary) == (other.case, other.seed, other.summary)


def opened(path, figure="bti-fig8", **changed):
    return TableFile(path, Table(figure=figure, columns=COLUMNS, origin=ORIGIN | changed), runs_of)


def append(file, run):
    samples = [
        (t_s, robot, state, *place)
        for t_s, places, states in zip(run.times_s, run.positions_m, run.states)
        for robot, (place, state) in enumerate(zip(places, states), start=1)
    ]
    file.append(f"{run.case} seed {run.seed}", np.array(samples), run.summary)


def read(path):
    return runs_of(read_table(path))


def write(path, *runs):
    with opened(path) as file:
        for run in runs:
            append(file, run)
    return path


RUNS = [
    flock_run(case, seed, [600.0 + seed, 300.0, 50.25], liar=3 if case == "attacked" else None, robots=4)
    for seed in (0, 1)
    for case in ("honest", "attacked")
]


class TestTable:
    def test_runs_come_back_as_they_were_written(self, tmp_path):
        path = write(tmp_path / "deep" / "f.csv", *RUNS)
        table = read(path)
        assert read_table(path).origin == ORIGIN
        assert all(same(table.runs[run.case, run.seed], run) for run in RUNS)
        assert table.seeds() == [0, 1]

    def test_a_seed_of_which_a_case_is_missing_is_not_counted(self, tmp_path):
        assert read(write(tmp_path / "f.csv", *RUNS[:3])).seeds() == [0]

    @pytest.mark.parametrize("name", ["figure", "scenario", "every_s", "version"])
    def test_a_file_of_another_measurement_is_refused_and_left_alone(self, tmp_path, name):
        path = write(tmp_path / "f.csv", *RUNS)
        before = path.read_bytes()
        other = {name: 2.5 if name == "every_s" else "bti-other"}
        why = "not a CSV of bti-other" if name == "figure" else f"another {name}"
        with pytest.raises(UsageError, match=why), opened(path, **other):
            pass
        assert path.read_bytes() == before

    @pytest.mark.parametrize(
        "old, new",
        [
            (b"# phalanx bti-fig8", b"# another bti-fig8"),
            (b"case,t_s", b"t_s,case"),
            (b"honest seed 0,5,2,", b"honest seed 0,5,3,"),
            (b"honest seed 0,5,2,", b"honest seed 1,5,2,"),
            (b"honest seed 0,5,2,0,", b"honest seed 0,5,2,9,"),
            (b"honest seed 0,5,2,0,200,", b"honest seed 0,5,2,0,nan,"),
            (b"# end honest seed 0 {", b"# end honest seed 0 {{"),
            (b'"robots": 4', b'"robots": "four"'),
            (b"honest seed 0,5,2,", b"honest seed 0,5,2\xff,"),
            (b"honest seed 0,5,2,", b"2,"),
        ],
    )
    def test_a_file_that_is_not_ours_is_told_apart(self, tmp_path, old, new):
        path = write(tmp_path / "f.csv", *RUNS)
        assert old in path.read_bytes()
        path.write_bytes(path.read_bytes().replace(old, new, 1))
        with pytest.raises(UsageError):
            read(path)
        with pytest.raises(UsageError), opened(path):
            pass


class TestCounting:
    def test_the_liar_counts_in_neither_case(self):
        table = table_of(flock_run("honest", 0, [100.0, 50.0]), flock_run("attacked", 0, [100.0, 80.0], liar=7))
        odd = table.runs["honest", 0]
        odd.positions_m[:, 6] += 900
        assert mean_distances_m(table, "attacked", GOAL_M).tolist() == [[100.0, 80.0]]
        assert mean_distances_m(table, "honest", GOAL_M).tolist() == [[100.0, 50.0]]
        with_all = mean_distances_m(table, "honest", GOAL_M, of_the_honest_in_both=False)[0, 0]
        assert with_all == pytest.approx((24 * 100 + np.hypot(900 - 100, 900)) / 25)

    def test_the_band_is_over_the_seeds(self):
        middle, low, high = band(np.arange(21.0)[:, None] * [[1.0, 10.0]])
        assert (middle.tolist(), low.tolist(), high.tolist()) == ([10, 100], [1, 10], [19, 190])

    def test_the_reference_is_condensed_from_the_whole_one(self):
        whole = {}
        with (Path(__file__).parent / "data" / "flock_reference.csv").open() as file:
            for row in csv.DictReader(line for line in file if not line.startswith("#")):
                if row["is_attacker"] == "0":
                    whole.setdefault((row["series"], float(row["t_s"])), []).append(float(row["distance_m"]))
        names = {
            "honest": "base_linear_d20",
            "attacked": "attack_random1_broadcast_d20",
            "stopped_at_25s": "attack_random1_broadcast_stop25_d20",
        }
        reference = read_reference()
        assert set(reference) == set(names)
        for name, series in names.items():
            assert len(reference[name]) == 31
            for t_s, mean_m, least_m, most_m in reference[name]:
                there = whole[series, t_s]
                assert (least_m, most_m) == (min(there), max(there))
                assert mean_m == pytest.approx(statistics.fmean(there), abs=6e-4)


def as_reference(series, extra_m=0.0):
    return read_reference()[series][:, 1] + extra_m


class TestComparison:
    """On tables made by hand, so that each statement is seen to agree and to disagree."""

    def fig8(self, honest=1.0, attacked=1.0, safe_s=None, contacts=0):
        return liars.compare_unstopped(
            table_of(
                *(flock_run("honest", seed, as_reference("honest") * honest, contacts=contacts) for seed in range(3)),
                *(
                    flock_run("attacked", seed, as_reference("attacked") * attacked, liar=9, safe_s=safe_s, contacts=9)
                    for seed in range(3)
                ),
            )
        )

    def fig9(self, apart_m=0.0, safe_s=24.0, wronged=(), alone=()):
        more = {"correct_in_safe_mode": list(wronged), "without_quorum": list(alone)}
        honest = as_reference("stopped_at_25s")
        return liars.compare_stopped(
            table_of(
                *(flock_run("honest", seed, honest) for seed in range(3)),
                *(
                    flock_run("attacked", seed, honest + apart_m, liar=9, safe_s=safe_s, **more if seed == 1 else {})
                    for seed in range(3)
                ),
            )
        )

    def test_the_reference_itself_agrees(self):
        for statements in (self.fig8(), self.fig9()):
            assert all(each.agrees for each in statements)
            assert last_line(statements).endswith("nothing differs")

    @pytest.mark.parametrize(
        "options, wrong",
        [
            ({"honest": 1.04}, {0, 1, 2}),
            ({"honest": 0.96}, {0, 1, 2}),
            ({"attacked": 0.9}, {3}),
            ({"attacked": 1.06}, {3}),
            ({"safe_s": 40.0}, {4}),
            ({"contacts": 1}, {5}),
        ],
    )
    def test_fig8_sees_what_is_wrong(self, options, wrong):
        statements = self.fig8(**options)
        assert {k for k, each in enumerate(statements) if not each.agrees} == wrong
        assert all(statements[k].what in last_line(statements).split("differs")[1] for k in wrong)

    @pytest.mark.parametrize(
        "options, wrong",
        [
            ({"safe_s": 15.0 + 10.102}, {0}),
            ({"safe_s": None}, {0}),
            ({"wronged": (3,)}, {1}),
            ({"alone": (3,)}, {1}),
            ({"apart_m": 4.1}, {2, 4, 5}),
        ],
    )
    def test_fig9_sees_what_is_wrong(self, options, wrong):
        statements = self.fig9(**options)
        assert {k for k, each in enumerate(statements) if not each.agrees} == wrong


class TestMeasuring:
    def test_a_measurement_that_was_stopped_goes_on_to_the_same_file(self, tmp_path):
        told = []
        whole = measure(tmp_path / "whole", SMALL_FIGURE, 2, lambda done, of: told.append(done / of)).read_bytes()
        assert told == sorted(told)
        assert told[-1] == 1.0

        class Enough(Exception):
            pass

        def stop(done, of):
            if done / of > 0.6:
                raise Enough

        with pytest.raises(Enough):
            measure(tmp_path / "parts", SMALL_FIGURE, 2, stop)
        part = read(SMALL_FIGURE.csv(tmp_path / "parts"))
        assert sorted(part.runs) == [("attacked", 0), ("honest", 0)]
        assert measure(tmp_path / "parts", SMALL_FIGURE, 2).read_bytes() == whole

        def fail(done, of):
            assert done in range(1, of + 1), "nothing is run again"

        assert measure(tmp_path / "parts", SMALL_FIGURE, 2, fail).read_bytes() == whole

    def test_rows_are_the_run_s(self, tmp_path):
        table = read(measure(tmp_path, SMALL_FIGURE, 2))
        run = table.runs["attacked", 1]
        (told,) = run.summary["compromised"]
        again = bti_flock.Run(SMALL_FIGURE.body.scenario("attacked", 1))
        for k, t_s in enumerate(run.times_s):
            again.advance(t_s)
            assert np.abs(again.positions_m - run.positions_m[k]).max() <= 0.0006
        assert again.summary()["digest"] == run.summary["digest"]
        assert (run.states[0] == HONEST).all()
        assert run.states[1, told["robot"] - 1] == LIAR
        assert run.liars.sum() == 1
        assert not table.runs["honest", 1].liars.any()
        assert not (table.runs["honest", 1].states == LIAR).any()

    def test_no_seeds(self, tmp_path):
        with pytest.raises(UsageError, match="seeds 0 is out of range"):
            measure(tmp_path, FIGURES["bti-fig8"], 0)
        assert not list(tmp_path.iterdir())


class TestPicture:
    def test_it_is_drawn_from_the_csv_alone(self, tmp_path, monkeypatch):
        pytest.importorskip("matplotlib")
        monkeypatch.setitem(DRAWN_BY, "bti-fig9", partial(draw_flock, SMALL_FIGURE.body))
        csv_path = measure(tmp_path / "a", SMALL_FIGURE, 2)
        (tmp_path / "b").mkdir()
        moved = Path(shutil.copy(csv_path, tmp_path / "b"))
        png, svg = draw(moved, SMALL_FIGURE)
        assert sorted(path.name for path in moved.parent.iterdir()) == [
            f"bti-fig9.{of}" for of in ("csv", "png", "svg")
        ]
        text = svg.read_text()
        for words in (
            "distance to the goal (m), all honest",
            "distance to the goal (m), with a liar",
            "it lies",
            "goal",
        ):
            assert f"<!-- {words}" in text, words
        looks_like_a_figure(png)


class TestTrial:
    def test_the_bound_is_the_promise_of_the_specification(self):
        assert stop_bound_s(Scenario(), output_missing=False) == 10.101
        assert stop_bound_s(Scenario(), output_missing=True) == 10.251
        assert stop_bound_s(Scenario(defence="none"), output_missing=True) is None

    def test_spoofing_bites_undefended_and_is_stopped_in_time(self):
        scenario = replace(SMALL, duration_s=40.0, goal_m=(160.0, 160.0))
        seen = []
        bare = try_attack(replace(scenario, defence="none"), lambda which, run: seen.append((which, run.now_s)))
        assert {which for which, _ in seen} == {"attacked", "honest"}
        assert seen[-1] == ("honest", 40.0)
        guarded = try_attack(scenario)
        assert bare.stopped_in_time is None
        assert bare.stops[0].safe_mode_s is None
        assert bare.harm >= bare.harm_bites_from
        assert guarded.harm < bare.harm / 2
        assert guarded.stopped_in_time is True
        assert guarded.stops[0].after_s <= 10.101
        assert guarded.honest["compromised"] == []
        assert guarded.attacked["correct_in_safe_mode"] == guarded.attacked["without_quorum"] == []

    @pytest.mark.parametrize(
        "stop, in_time",
        [
            (Stop(1, 15.0, 25.0), True),
            (Stop(1, 15.0, 25.2510001), False),
            (Stop(1, 15.0, None), False),
            (Stop(1, 55.0, None), True),
            (Stop(1, None, None), True),
        ],
    )
    def test_late_is_late(self, stop, in_time):
        told = {"duration_s": 60.0}
        came_to = {"harm": 0.0, "attacked": told, "honest": told, "honest_distance_m": 0.0}
        trial = FlockTrial(**trial_fields(ATTACKS["spoof"], "hardened"), **came_to, bound_s=10.251, stops=(stop,))
        assert trial.stopped_in_time is in_time


def test_the_reference_says_where_it_comes_from():
    head = (Path(phalanx.__file__).parent / "data" / "flock_reference.csv").read_text().splitlines()[:3]
    assert all(line.startswith("#") for line in head)
    assert "BSD-3-Clause" in head[2]


@pytest.mark.long
def test_the_independent_script_computes_the_reference_to_the_byte():
    script = Path(__file__).parents[1] / "scripts" / "flock_reference.py"
    told = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True, timeout=300)
    assert (told.returncode, told.stderr) == (0, "")
    assert "phalanx" not in re.findall(r"(?m)^(?:from|import) (\w+)", script.read_text())
