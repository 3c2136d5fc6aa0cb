"""`phalanx.world.simulate`: a scenario as arrays, tables and files, under many seeds and on several processors."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from commands import ROOT
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.config.builtin import built_in
from phalanx.errors import Unavailable, UsageError
from phalanx.lab.tables import to_pandas, to_parquet
from phalanx.scenarios.file import find_scenario
from phalanx.world import AttackSpec, Result, Scenario, simulate
from phalanx.world.scenarios.cautions import audit_warnings, neighbours_at_start
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run

simulate_module = sys.modules[simulate.__module__]


SMALL = Scenario(robots=9, duration_s=3.0, attacks=(AttackSpec(name="hijack", at_s=1.0),))
OWN = f"{ROOT / 'examples' / 'own_controller.py'}:GoThere"


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(SMALL, seeds=(3, 4), every_s=0.5)


class TestArrays:
    def test_shapes_are_seeds_times_robots(self, result):
        assert result.seeds.tolist() == [3, 4]
        assert result.times_s.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
        assert result.ids.tolist() == list(range(1, 10))
        assert result.positions_m.shape == result.velocities_mps.shape == (2, 7, 9, 2)
        assert result.in_safe_mode.shape == (2, 7, 9)
        assert result.compromised.shape == (2, 9)
        assert "2 runs, 7 times, 9 robots" in repr(result)

    def test_each_run_is_the_one_of_its_seed(self, result):
        for k, seed in enumerate((3, 4)):
            run = Run(replace(SMALL, seed=seed))
            for t, t_s in enumerate(result.times_s):
                run.advance(float(t_s))
                np.testing.assert_array_equal(result.positions_m[k, t], run.positions_m)
                np.testing.assert_array_equal(result.velocities_mps[k, t], run.velocities_mps)
                np.testing.assert_array_equal(result.in_safe_mode[k, t], run.in_safe_mode)
            assert result.ids[result.compromised[k]].tolist() == list(run.compromised)
            assert result.summaries[k]["digest"] == run.summary()["digest"]
            mine = result.verdicts[result.verdicts["seed"] == seed]
            assert [tuple(row)[1:] for row in mine.tolist()] == run.new_verdicts()
            assert len(mine) > 0

    def test_robots_have_moved_between_two_looks(self, result):
        assert (result.positions_m[:, 1:] != result.positions_m[:, :-1]).any(axis=(2, 3)).all()

    @pytest.mark.parametrize("every_s, looks", [(0.1, 31), (0.7, 5), (3.0, 2), (1.3, 3)])
    def test_how_often_it_is_looked_at_changes_nothing_else(self, result, every_s, looks):
        other = simulate(replace(SMALL, seed=3), every_s=every_s)
        np.testing.assert_allclose(other.times_s, np.arange(looks) * every_s)
        assert other.summaries[0]["digest"] == result.summaries[0]["digest"]
        assert len(other.positions_m[0]) == looks

    def test_seeds_and_attacks_are_the_scenarios_unless_said(self):
        scenario = replace(SMALL, seed=7, duration_s=1.0)
        assert simulate(scenario).seeds.tolist() == [7]
        assert simulate(scenario, seeds=2).seeds.tolist() == [2]
        for nobody in ((), "none"):
            assert not simulate(scenario, attacks=nobody).compromised.any()
        said = simulate(scenario, attacks=["spoof:robot=2", AttackSpec(name="crash", robot=5)])
        assert said.ids[said.compromised[0]].tolist() == [2, 5]

    def test_a_name_and_a_file_are_scenarios_too(self, tmp_path):
        path = tmp_path / "mine.yaml"
        path.write_text("robots: 5\nduration_s: 1\ndefence: none\n")
        assert simulate(path).positions_m.shape == simulate(str(path)).positions_m.shape == (1, 2, 5, 2)
        assert simulate("flock-12", attacks="none", every_s=30).scenario.name == "flock-12"

    @pytest.mark.parametrize(
        "more, complaint",
        [
            ({"seeds": []}, "no seeds"),
            ({"seeds": [1, 1]}, r"seeds is \[1, 1\]"),
            ({"every_s": 0}, "every_s is 0"),
            ({"every_s": 4}, "every_s is 4"),
            ({"every_s": float("nan")}, "every_s is nan"),
            ({"workers": 0}, "0 workers"),
            ({"seeds": (1, 2), "record": "x.mcap"}, "one file x.mcap for 2 runs"),
            ({"seeds": (-1,)}, "seed is -1"),
            ({"attacks": ["none", "spoof"]}, "an attack together with none"),
            ({"seeds": "abc"}, "seeds is 'abc'"),
            ({"seeds": 1.5}, "seeds is 1.5"),
            ({"seeds": [1.5, 2.9]}, r"seeds is \[1.5, 2.9\]"),
            ({"every_s": "1"}, "every_s is '1'"),
            ({"workers": "all"}, "workers is 'all'"),
            ({"controller": 3}, "controller is 3"),
            ({"attacks": 3}, "3 is not an attack"),
            ({"controller": "flok"}, "no controller 'flok'"),
            ({"controller": "nowhere.py:Own"}, "no file nowhere.py"),
        ],
    )
    def test_what_cannot_be_is_refused(self, more, complaint):
        with pytest.raises(UsageError, match=complaint):
            simulate(SMALL, **more)

    def test_nor_is_what_is_no_scenario(self):
        with pytest.raises(UsageError, match="scenario is 3"):
            simulate(3)


class TestProcesses:
    def test_they_change_nothing(self, result, tmp_path):
        shares = []
        record = tmp_path / "{seed}.mcap"
        forked = simulate(SMALL, seeds=(3, 4), every_s=0.5, workers=2, record=record, on_progress=shares.append)
        for name in ("positions_m", "velocities_mps", "in_safe_mode", "compromised", "verdicts"):
            np.testing.assert_array_equal(getattr(forked, name), getattr(result, name))
        assert [told["digest"] for told in forked.summaries] == [told["digest"] for told in result.summaries]
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
        for seed in (3, 4):
            with (tmp_path / f"{seed}.mcap").open("rb") as file:
                assert make_reader(file).get_summary().statistics.message_count > 3 * 13

    def test_a_class_that_no_module_has_runs_in_them(self):
        class Broken(RuntimeError):
            pass

        def make(rob_id):
            raise Broken(rob_id)

        with pytest.raises(Broken):
            simulate(SMALL, controller=make, seeds=range(2), workers=2)

    def test_what_one_raises_ends_all(self, tmp_path):
        folder = tmp_path / "{seed}"
        (tmp_path / "0").mkdir()
        with pytest.raises(UsageError, match="no folder"):
            simulate(replace(SMALL, duration_s=600.0), seeds=(0, 1), workers=2, record=folder / "x.mcap")

    @pytest.mark.parametrize("workers", [1, 2])
    def test_ctrl_c_ends_all_and_leaves_recordings_whole(self, tmp_path, workers):
        script = tmp_path / "script.py"
        script.write_text(
            "from phalanx.world import Scenario, simulate\n"
            "told = lambda share: share and print('going', flush=True)\n"
            "simulate(Scenario(robots=9, duration_s=6e5), seeds=(0, 1), record='{seed}.mcap',"
            f" workers={workers}, on_progress=told)\n"
        )
        child = subprocess.Popen(
            [sys.executable, script], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            assert child.stdout.readline() == "going\n"
            time.sleep(0.5)
            child.send_signal(signal.SIGINT)
            threading.Thread(target=child.stdout.read, daemon=True).start()
            assert child.stderr.read().splitlines()[-1] == "KeyboardInterrupt"
            assert child.wait(20) != 0
        finally:
            child.kill()
        with pytest.raises(ProcessLookupError):
            os.killpg(child.pid, 0)
        for seed in range(workers):
            with (tmp_path / f"{seed}.mcap").open("rb") as file:
                assert make_reader(file).get_summary().statistics.message_count > 10


class TestTables:
    def test_robots_are_a_row_a_robot_a_moment(self, result):
        frame = to_pandas(result)
        assert len(frame) == 2 * 7 * 9
        row = frame[(frame.seed == 4) & (frame.time_s == 1.5) & (frame.robot == 8)].iloc[0]
        assert (row.x_m, row.y_m) == tuple(result.positions_m[1, 3, 7])
        assert (row.vx_mps, row.vy_mps) == tuple(result.velocities_mps[1, 3, 7])
        assert row.in_safe_mode == result.in_safe_mode[1, 3, 7]
        assert frame.groupby(["seed", "robot"]).compromised.first().to_numpy().reshape(2, 9).tolist() == (
            result.compromised.tolist()
        )

    def test_verdicts_and_runs_are_tables_too(self, result):
        verdicts = to_pandas(result, "verdicts")
        assert len(verdicts) == len(result.verdicts)
        assert set(verdicts.refusal) <= set(Refusal.__members__)
        runs = to_pandas(result, "runs")
        assert runs.digest.tolist() == [told["digest"] for told in result.summaries]
        assert runs.seed.tolist() == [3, 4]
        with pytest.raises(UsageError, match="no table 'wheels'"):
            to_pandas(result, "wheels")

    def test_a_table_is_a_copy(self, result):
        frame = to_pandas(result)
        before = result.positions_m.copy()
        frame["x_m"] += 1
        np.testing.assert_array_equal(result.positions_m, before)

    @pytest.mark.parametrize("table", ["robots", "verdicts", "runs"])
    def test_parquet_holds_the_same(self, result, tmp_path, table):
        import pandas as pd

        path = to_parquet(result, tmp_path / "x.parquet", table)
        pd.testing.assert_frame_equal(pd.read_parquet(path), to_pandas(result, table))
        with pytest.raises(Unavailable, match="cannot write"):
            to_parquet(result, tmp_path / "none" / "x.parquet", table)

    @pytest.mark.parametrize("missing", ["pandas", "pyarrow"])
    def test_what_is_missing_is_one_line(self, result, tmp_path, missing, monkeypatch):
        for name in [missing, *(name for name in sys.modules if name.startswith(f"{missing}."))]:
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(Unavailable, match=f"{missing} is not installed") as caught:
            to_parquet(result, tmp_path / "x.parquet")
        assert caught.value.hint == "pip install '.[research]' in a clone"

    def test_a_folder_that_is_not_there_is_said(self, result, tmp_path):
        with pytest.raises(Unavailable, match="non-existent directory") as refused:
            to_parquet(result, tmp_path / "none" / "a")
        assert refused.value.hint


class TestOwnController:
    def test_a_file_and_its_class_are_the_same(self, monkeypatch):
        monkeypatch.syspath_prepend(str(ROOT / "examples"))
        from own_controller import GOAL_M, GoThere

        scenario = replace(SMALL, goal_m=GOAL_M, bti=BtiConfig(f_max=2))
        by_class, by_file = (simulate(scenario, controller=own) for own in (GoThere, OWN))
        np.testing.assert_array_equal(by_class.positions_m, by_file.positions_m)
        assert by_class.summaries[0]["digest"] == by_file.summaries[0]["digest"]
        assert by_class.summaries[0]["digest"] != simulate(scenario).summaries[0]["digest"]

    def test_flock_is_a_name(self, result):
        assert simulate(SMALL, controller="flock", seeds=3).summaries[0]["digest"] == result.summaries[0]["digest"]


def test_the_example_runs_and_tells_what_became_of_the_liar():
    done = subprocess.run([sys.executable, OWN.partition(":")[0]], capture_output=True, text=True, check=True)
    lied, stopped = done.stdout.splitlines()
    assert re.fullmatch(r"robot 5 lied from 10\.\d* s on, Safe Mode at 1\d\.\d+ s", lied)
    assert stopped == "honest robots stopped: [], for want of a quorum: []"


class TestCautions:
    def test_three_robots_have_no_quorum(self):
        (words,) = audit_warnings(Scenario(robots=3))
        assert words.startswith(
            "none of the robots has a quorum at the start, 5 correct others (f_max + 2) within 116 m"
        )
        assert "with fewer than 4 a robot is stopped after 10 s" in words
        assert audit_warnings(Scenario(robots=3, defence="none")) == []

    def test_nor_have_robots_with_just_as_many_others_as_tokens_are_needed(self):
        (words,) = audit_warnings(Scenario(robots=3, bti=BtiConfig(f_max=1)))
        assert words.startswith(
            "none of the robots has a quorum at the start, 3 correct others (f_max + 2) within 116 m"
        )
        assert "compromised robots can cause them to be stopped" in words
        assert audit_warnings(Scenario(robots=4, bti=BtiConfig(f_max=1))) == []

    def test_nor_has_a_wide_grid(self):
        assert audit_warnings(Scenario(robots=25, grid_step_m=117.0))[0].startswith("none of the robots has")
        wide = Scenario(robots=25, grid_step_m=100.0, bti=BtiConfig(f_max=2))
        assert audit_warnings(wide)[0].startswith("16 of 25 robots do not have")
        assert audit_warnings(Scenario(robots=25)) == []

    @pytest.mark.parametrize(
        "t_audit_ms, t_val_ms, told",
        [(4000, 10_000, 0), (4001, 10_000, 1), (2000, 5000, 0), (2001, 5000, 1), (1000, 3000, 0), (1000, 2999, 1)],
    )
    def test_that_one_round_that_fails_is_one_too_many(self, t_audit_ms, t_val_ms, told):
        """P2 asks for a round in each T_val less a round; where rounds are short, a first one that is late counts."""
        bti = BtiConfig(t_audit_ms=t_audit_ms, t_val_ms=t_val_ms)
        assert len(audit_warnings(Scenario(robots=25, bti=bti))) == told

    def test_that_liars_may_fill_the_channel_with_the_audits_of_others(self):
        hub = Scenario(robots=33, hub=26, grid_step_m=6, bti=BtiConfig(f_max=12, t_audit_ms=2000))
        words, _, _ = audit_warnings(hub)
        assert "if f_max compromised robots fill their logs, audits need 79% of the channel" in words
        assert (
            audit_warnings(replace(hub, robots=19, hub=12, n_max=None, bti=BtiConfig(f_max=5, t_audit_ms=2000))) == []
        )
        crowd = Scenario(robots=60, grid_step_m=4, bti=BtiConfig(f_max=3))
        assert audit_warnings(crowd) == []

    def test_that_compromised_robots_are_no_auditors(self):
        square = Scenario(robots=5, bti=BtiConfig(f_max=1), attacks=(AttackSpec(name="crash"),))
        assert audit_warnings(square) == []
        (words,) = audit_warnings(replace(square, robots=4))
        assert words.startswith("none of the correct robots has a quorum at the start, 3 correct others")
        star = replace(find_scenario("star-25"), attacks=(AttackSpec(name="crash", robot=2),))
        (words,) = audit_warnings(star)
        assert words.startswith("22 of 24 correct robots do not have")
        assert audit_warnings(replace(star, hub=5)) == []
        tight = replace(star, hub=5, bti=BtiConfig(f_max=3))
        assert len(audit_warnings(tight)) == 1
        assert audit_warnings(replace(tight, attacks=(AttackSpec(name="crash", robot=25),))) == [], (
            "in an aisle of its own"
        )

    def test_that_more_are_compromised_than_f_max(self):
        liars = (AttackSpec(name="crash"),) * 3
        assert audit_warnings(Scenario(robots=25, bti=BtiConfig(f_max=3), attacks=liars)) == []
        (words,) = audit_warnings(Scenario(robots=25, bti=BtiConfig(f_max=2), attacks=liars))
        assert words == "3 compromised robots, f_max is 2: nothing is promised; use f_max 3 or fewer attacks"

    @pytest.mark.parametrize("f_max, warnings", [(8, 0), (9, 1)])
    def test_that_f_max_is_above_the_largest_for_which_no_correct_robot_was_stopped(self, f_max, warnings):
        found = audit_warnings(Scenario(robots=25, bti=BtiConfig(f_max=f_max)))
        assert sum(words.startswith("f_max is 9: above 8 compromised robots") for words in found) == warnings

    def test_that_more_are_in_range_than_n_max(self):
        assert audit_warnings(Scenario(robots=25, n_max=24)) == []
        (words,) = audit_warnings(Scenario(robots=25, n_max=23))
        assert "has 24 others in range at the start, n_max is 23" in words

    def test_that_the_buckets_of_liars_let_out_a_quarter_of_the_channel(self):
        wide = Scenario(robots=25, n_max=50, bti=BtiConfig(f_max=8))
        (words,) = audit_warnings(wide)
        assert words.startswith("with n_max 50 the a-nodes of f_max compromised robots allow audit packets for 38%")
        assert audit_warnings(replace(wide, defence="paper")) == audit_warnings(replace(wide, n_max=24)) == []

    @pytest.mark.parametrize("name", built_in("scenarios"))
    def test_none_of_ours_is_warned_of_but_for_the_four_corners_of_a_wide_grid(self, name):
        told = audit_warnings(find_scenario(name))
        assert [words[:27] for words in told] == ["4 of 324 robots do not have"] * (name == "grid-324")

    @pytest.mark.parametrize("robots", [1, 2, 7, 25, 60, 324])
    @pytest.mark.parametrize("grid_step_m", [1.0, 30.0, 64.0, 110.0, 200.0])
    @pytest.mark.parametrize("formation", ["grid", "line", "ring", "islands"])
    def test_neighbours_are_those_of_all_pairs(self, robots, grid_step_m, formation):
        scenario = Scenario(robots=robots, grid_step_m=grid_step_m, formation=formation)
        starts_m = np.array(scenario.starts_m)
        apart = np.linalg.norm(starts_m[:, None] - starts_m[None], axis=2)
        near = (apart <= scenario.radio.range_m).sum(axis=1) - 1
        np.testing.assert_array_equal(neighbours_at_start(scenario), near)

    def test_neighbours_of_a_large_swarm_are_counted_too(self):
        counts = neighbours_at_start(Scenario(robots=1600, grid_step_m=100.0))
        assert np.bincount(counts).tolist() == [0, 0, 4, 4 * 38, 38 * 38]

    def test_simulate_warns(self):
        with pytest.warns(UserWarning, match="quorum") as caught:
            simulate(Scenario(robots=3, duration_s=1.0))
        assert Path(caught[0].filename).name == "test_simulate.py"
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            simulate(replace(SMALL, duration_s=1.0))

    def test_and_it_is_right(self):
        stopped = run_scenario(Scenario(robots=3, duration_s=12.0)).summary()
        assert stopped["without_quorum"] == [1, 2, 3]
