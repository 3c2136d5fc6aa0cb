"""`phalanx sim`, `phalanx attack`, `phalanx reproduce bti-…`: what they print, refuse and leave behind."""

from __future__ import annotations

import json
import math
import re
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from commands import PHALANX, ROOT
from phalanx.attacks import IN_FLOCKS
from phalanx.attacks.library import ATTACKS
from phalanx.cli import attack as cli_attack
from phalanx.cli.sim import format_robots, show
from phalanx.config.builtin import built_in
from phalanx.scenarios.attack_spec import parse_attack
from phalanx.scenarios.file import find_scenario, scenario_schema
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.play import run_scenario

QUICK = ("--duration", "3", "--robots", "6")
KEYS = set(
    """robots duration_s seed defence digest mean_distance_to_goal_m distance_series compromised correct_in_safe_mode
    without_quorum contacts bytes_per_s_per_robot tried_bytes_per_s_per_robot airtime_pct_per_robot log_bytes_max broadcast_delivery unicast_delivery
    real_time_factor""".split()
)


@pytest.fixture
def said(phalanx):
    """What a command prints as JSON."""

    def call(*words: str, code: int = 0):
        ended, out, err = phalanx(*words, "--json")
        assert ended == code, err
        return json.loads(out)

    return call


class TestRun:
    def test_json_has_everything_that_is_promised(self, said):
        told = said("sim", "run", "bti-fig9", "--duration", "17")
        assert set(told) >= KEYS
        assert (told["robots"], told["duration_s"], told["seed"], told["defence"]) == (25, 17, 0, "hardened")
        assert [t_s for t_s, _ in told["distance_series"]] == list(range(1, 18))
        assert told["distance_series"][-1][1] == told["mean_distance_to_goal_m"]
        (liar,) = told["compromised"]
        assert liar == {
            "robot": find_scenario("bti-fig9").drawn_attacks()[0].robot,
            "attack": "spoof",
            "first_deviation_s": pytest.approx(15, abs=0.3),
            "safe_mode_s": None,
        }
        assert told["correct_in_safe_mode"] == told["without_quorum"] == []
        assert told["bytes_per_s_per_robot"]["audit"] > told["bytes_per_s_per_robot"]["app"] > 0
        assert told["tried_bytes_per_s_per_robot"]["audit"] > told["bytes_per_s_per_robot"]["audit"]
        assert told["tried_bytes_per_s_per_robot"]["app"] == pytest.approx(
            told["bytes_per_s_per_robot"]["app"], rel=0.1
        )
        assert 100 > told["airtime_pct_per_robot"]["audit"] > told["airtime_pct_per_robot"]["app"] > 0
        assert 0.9 < told["broadcast_delivery"] <= 1

    @pytest.mark.parametrize("defence, code", [("paper", 1), ("hardened", 0)])
    def test_it_ends_with_1_if_a_correct_robot_with_a_quorum_was_stopped(self, phalanx, defence, code):
        words = ("--defence", defence, "--attack", "request-flood:at=1", "--duration", "20", "--json")
        ended, out, err = phalanx("sim", "run", "flock-12", *words)
        stopped = json.loads(out)["correct_in_safe_mode"]
        line = f"phalanx: correct robots with a quorum were stopped: {format_robots(stopped)}"
        assert (ended, bool(stopped), line in err.splitlines()) == (code, bool(code), bool(code))

    @pytest.mark.parametrize("name", built_in("scenarios"))
    def test_every_built_in_scenario_runs(self, said, name):
        told = said("sim", "run", name, "--duration", "2")
        assert told["robots"] == find_scenario(name).robots

    @pytest.mark.parametrize("defence", ["none", "paper", "hardened"])
    def test_the_same_seed_gives_the_same_digest_and_another_does_not(self, said, defence):
        first, again, other = (
            said("sim", "run", "flock-12", *QUICK, "--defence", defence, "--seed", seed)["digest"]
            for seed in ("1", "1", "2")
        )
        assert first == again != other

    def test_options_are_the_scenario_s(self, said):
        words = "--robots 16 --spacing 40 --duration 4 --defence paper --f-max 2 --t-audit 3 --t-val 9 --seed 5".split()
        told = said("sim", "run", "bti-fig8", *words, "--attack", "hijack:robot=3,at=1", "--attack", "crash:robot=4")
        scenario = find_scenario("bti-fig8").with_options(
            robots=16,
            spacing_m=40.0,
            duration_s=4.0,
            defence="paper",
            f_max=2,
            t_audit_s=3.0,
            t_val_s=9.0,
            seed=5,
            attacks=(parse_attack("hijack:robot=3,at=1"), parse_attack("crash:robot=4")),
        )
        assert told["digest"] == run_scenario(scenario).summary()["digest"]
        assert [(liar["robot"], liar["attack"]) for liar in told["compromised"]] == [(3, "hijack"), (4, "crash")]

    def test_a_file_runs(self, said, tmp_path):
        path = tmp_path / "mine.yaml"
        path.write_text("robots: 5\nduration_s: 2\ndefence: none\n")
        told = said("sim", "run", str(path))
        assert (told["robots"], told["duration_s"], told["defence"]) == (5, 2, "none")

    def test_for_people_it_is_a_table_and_stdout_has_nothing_else(self, phalanx):
        code, out, err = phalanx("sim", "run", "bti-fig8", *QUICK, "--attack", "spoof:robot=2,at=1")
        assert code == 0
        assert "defence none, seed 0" in out
        assert "robot 2 (spoof) deviated at" in out
        assert "never stopped" in out
        assert "3 of 3 s simulated" in err

    @pytest.mark.parametrize(
        ("factor", "words"),
        [(1723.4, "1 720 times"), (0.01234, "0.0123 times"), (87.25, "87.2 times"), (None, "-")],
    )
    def test_a_speed_is_written_out(self, said, capsys, factor, words):
        summary = said("sim", "run", "flock-12", "--duration", "1") | {"real_time_factor": factor}
        show(find_scenario("flock-12"), summary)
        (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("speed"))
        assert line.removeprefix("speed").strip().removesuffix(" real time") == words

    def test_a_liar_is_told_with_its_end_whether_or_not_its_log_shows_a_lie(self, said, capsys):
        summary = said("sim", "run", "flock-12", "--duration", "1")
        ends = [(None, None), (None, 10.0), (1.5, None), (1.5, 10.25)]
        liars = [
            {"robot": robot, "attack": "drain", "first_deviation_s": began, "safe_mode_s": stopped}
            for robot, (began, stopped) in enumerate(ends, start=1)
        ]
        show(find_scenario("flock-12"), summary | {"compromised": liars})
        (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("compromised"))
        assert line.removeprefix("compromised").strip().split("; ") == [
            "robot 1 (drain) never deviated in its log, never stopped",
            "robot 2 (drain) never deviated in its log, in Safe Mode at 10.00 s",
            "robot 3 (drain) deviated at 1.50 s, never stopped",
            "robot 4 (drain) deviated at 1.50 s, in Safe Mode at 10.25 s",
        ]

    def test_a_crowd_is_warned_of_before_it_runs(self, phalanx):
        crowd = ("sim", "run", "flock-12", "--robots", "144", "--spacing", "4", "--duration", "0.1")
        code, _, err = phalanx(*crowd)
        assert code == 0
        assert err.startswith("phalanx: warning: 144 robots in one radio range: their audits need 82% of the channel")
        for few in ((*crowd, "--defence", "none"), (*crowd[:4], "49", *crowd[5:])):
            code, _, err = phalanx(*few)
            assert code == 0
            assert "warning" not in err

    def test_half_a_second_has_a_distance(self, said):
        told = said("sim", "run", "bti-fig8", "--duration", "0.5")
        assert told["mean_distance_to_goal_m"] == pytest.approx(math.hypot(450, 450), rel=0.02)

    @pytest.mark.parametrize("words", [["sim", "list"], ["sim", "run", "flock-12", "--duration", "0.1", "--json"]])
    def test_a_full_disk_behind_stdout_is_one_line(self, words):
        with Path("/dev/full").open("w") as full:
            done = subprocess.run([*PHALANX, *words], stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        assert done.stderr.splitlines()[-1] == "phalanx: error: cannot write: No space left on device"

    def test_a_swarm_that_memory_does_not_hold_is_one_line(self):
        words = " ".join([*PHALANX, "sim run bti-fig8 --robots 65535 --duration 1"])
        done = subprocess.run(["bash", "-c", f"ulimit -v 4000000; {words}"], capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        assert "phalanx: error: 65535 robots do not fit into memory" in done.stderr

    def test_nobody_honest_is_left(self, said):
        told = said("sim", "run", "flock-12", "--robots", "2", "--duration", "2", *("--attack", "spoof") * 2)
        assert told["mean_distance_to_goal_m"] is None
        assert told["distance_series"] == [[1.0, None], [2.0, None]]

    def test_it_records(self, phalanx, tmp_path):
        path = tmp_path / "x.mcap"
        code, _, err = phalanx("sim", "run", "flock-12", *QUICK, "--record", str(path))
        assert code == 0
        assert f"recorded: {path}" in err
        with path.open("rb") as file:
            assert make_reader(file).get_summary().statistics.message_count > 3 * 13

    @pytest.mark.parametrize(
        "words, complaint, hint",
        [
            (["bti-fig7"], "no scenario 'bti-fig7'", "did you mean bti-fig"),
            (["."], ". is a folder", "phalanx sim list"),
            (["none.yaml"], "no file none.yaml", "phalanx sim list"),
            (["bti-fig8", "--attack", "spoff"], "no attack 'spoff'", "did you mean spoof?"),
            (["bti-fig8", "--attack", "spoof:robot=26"], "spoof in robot 26", "a robot from 1 to 25"),
            (["bti-fig8", "--attack", "spoof:at"], "'at' in 'spoof:at'", "for example"),
            (["bti-fig8", "--robots", "0"], "0 robots", "1 to 65535"),
            (["bti-fig8", "--t-audit", "9"], "t_val is 10 s", "1.5 times"),
            (["bti-fig8", "--t-audit", "inf"], "--t-audit", ""),
            (["bti-fig8", "--t-audit", "1e300"], "--t-audit is 1e+300", "0.5 to 600"),
            (["bti-fig8", "--t-audit", "0.1"], "--t-audit is 0.1", "0.5 to 600"),
            (["bti-fig8", "--t-val", "0"], "--t-val is 0", "1 to 3600"),
            (["bti-fig8", "--t-val", "nan"], "--t-val", ""),
            (["bti-fig8", "--duration", "0"], "--duration is 0", "0.1 to 604800"),
            (["bti-fig8", "--spacing", "0"], "--spacing is 0", "0.01 to 10000"),
            (["bti-fig8", "--f-max", "99"], "--f-max is 99", "1 to 15"),
            (["bti-fig8", "--seed", "-1"], "--seed is -1", "0 to 4294967295"),
            (["bti-fig8", "--attack", "spoof:at=-1"], "'spoof:at=-1': at_s is -1", "0 to 604800"),
            (["bti-fig8", "--record", "none/x.mcap"], "no folder none", "make it first"),
            (["bti-fig8", "--defence", "prayer"], "prayer", "--help"),
        ],
    )
    def test_misuse_is_one_line_and_a_hint(self, phalanx, words, complaint, hint):
        code, out, err = phalanx("sim", "run", *words)
        assert (code, out) == (2, "")
        error, hinted = err.strip().splitlines()[-2:]
        assert error.startswith("phalanx: error: ")
        assert complaint in error
        assert hinted.startswith("phalanx: hint: ")
        assert hint in hinted

    @pytest.mark.parametrize("ids, words", [([], "none"), ([6], "robot 6"), ([3, 6], "robots 3, 6")])
    def test_a_robot_is_named_so_that_nobody_takes_it_for_a_count(self, ids, words, said, capsys):
        summary = said("sim", "run", "flock-12", "--duration", "1") | {"without_quorum": ids}
        show(find_scenario("flock-12"), summary)
        assert re.search(rf"^stopped, no quorum +{words}$", capsys.readouterr().out, re.MULTILINE)

    def test_a_mistake_in_a_file_has_its_line(self, phalanx, tmp_path):
        path = tmp_path / "bad.yaml"
        path.write_text("robots: 9\ndefense: none\n")
        code, _, err = phalanx("sim", "run", str(path))
        assert code == 2
        assert f"{path}:2: scenario has no 'defense'" in err
        assert "did you mean defence?" in err

    @pytest.mark.waits
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_ctrl_c_and_kill_end_it_with_a_whole_recording(self, tmp_path, number):
        path = tmp_path / "x.mcap"
        process = subprocess.Popen(
            [*PHALANX, "sim", "run", "bti-fig9", "--duration", "50000", "--record", str(path)],
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        try:
            deadline = time.monotonic() + 120
            while not (path.exists() and path.stat().st_size > 100_000):
                assert time.monotonic() < deadline
                assert process.poll() is None
                time.sleep(0.1)
            process.send_signal(number)
            _, err = process.communicate(timeout=20)
        finally:
            process.kill()
        assert process.returncode == 1
        assert err.splitlines()[-1] == f"stopped; recorded so far: {path}"
        assert ("stopping after this step; Ctrl-C again ends it at once" in err) == (number == signal.SIGINT)
        with path.open("rb") as file:
            assert make_reader(file).get_summary().statistics.message_count > 0


class TestLists:
    def test_scenarios(self, phalanx, said):
        listed = said("sim", "list")["scenarios"]
        assert [each["name"] for each in listed] == list(built_in("scenarios"))
        _, out, _ = phalanx("sim", "list")
        assert [line.split()[0] for line in out.splitlines()] == list(built_in("scenarios"))

    def test_the_schema(self, phalanx):
        code, out, _ = phalanx("sim", "schema")
        assert code == 0
        assert json.loads(out) == scenario_schema()

    def test_attacks_with_what_each_defence_makes_of_them(self, phalanx, said):
        listed = said("attack", "list")["attacks"]
        assert [each["name"] for each in listed] == sorted(IN_FLOCKS)
        for each in listed:
            assert set(each["verdicts"]) == {"none", "paper", "hardened"}
            assert each["does"]
            assert each["stopped_by"]
            assert each["robots"] == ("f_max" if IN_FLOCKS[each["name"]].crowd else 1)
        _, out, _ = phalanx("attack", "list")
        for name in IN_FLOCKS:
            assert any(line.startswith(f"{name} ") for line in out.splitlines())


class TestAttack:
    def test_bound_stops_it_in_time_and_says_so(self, phalanx, said):
        words = ("attack", "run", "spoof:at=5", "--duration", "18", "--robots", "9")
        told = said(*words)
        (stop,) = told["stops"]
        assert told["stopped_in_time"] is True
        assert stop["safe_mode_s"] - stop["first_deviation_s"] <= told["bound_s"] == 10.101
        assert (told["declared"], told["defence"], told["attack"]) == ("stopped", "hardened", "spoof")
        code, out, _ = phalanx(*words)
        assert code == 0
        assert "10.101 s from deviation to Safe Mode, 0.15 s more for a missing output: kept" in out
        (line,) = (line for line in out.splitlines() if line.startswith(f"robot {stop['robot']} "))
        began, stopped = (f"{stop[name]:.2f} s" for name in ("first_deviation_s", "safe_mode_s"))
        assert f"deviated at {began}, in Safe Mode at {stopped}" in line
        rows = {row[:22].strip(): row[23:] for row in out.splitlines()}
        assert rows["swarm"] == "9 robots, 18 s, seed 0, goal (500, 500)"
        assert "counts" not in rows["harm until stopped"]
        assert rows["stopped by"] == ATTACKS["spoof"].stopped_by

    def test_a_bound_that_the_run_does_not_reach_is_not_called_kept(self, phalanx):
        code, out, _ = phalanx("attack", "run", "spoof:at=1", "--duration", "2", "--robots", "9")
        assert code == 0
        assert "more for a missing output: not tested: the run ended before it" in out
        code, out, _ = phalanx("attack", "run", "omit-sends:at=1.999", "--duration", "2", "--robots", "9")
        assert code == 0
        assert "not tested: no robot deviated" in out

    def test_an_attack_that_begins_after_the_end_is_refused(self, phalanx):
        code, out, err = phalanx("attack", "run", "hijack", "--duration", "12")
        assert (code, out) == (2, "")
        assert "hijack begins at 15 s, when the run of 12 s is over" in err
        assert "a longer --duration, or hijack:at=T" in err

    def test_undefended_nothing_stops_it(self, phalanx):
        _, out, _ = phalanx("attack", "run", "spoof:at=1", "--duration", "2", "--robots", "9", "--defence", "none")
        assert "stopped by" not in out
        assert "(counts from " in out

    def test_who_leaves_something_out_has_its_own_bound(self, said):
        (stop,) = said("attack", "run", "omit-sends:at=5", "--duration", "18", "--robots", "9")["stops"]
        assert stop["output_missing"] is True
        assert stop["bound_s"] == 10.251

    def test_safe_mode_is_told_even_of_a_robot_that_did_nothing_wrong(self, phalanx):
        """Two robots are too few for f_max + 1 tokens."""
        code, out, _ = phalanx("attack", "run", "gps-spoof:at=11,robot=1", "--duration", "12", "--robots", "2")
        assert code == 0
        assert "never deviated, in Safe Mode at 10." in out
        assert "none promised" in out

    def test_a_limited_one_is_held_to_its_bucket_and_not_to_a_time(self, phalanx, said):
        words = ("attack", "run", "covert-talk:at=5", "--duration", "18", "--robots", "9")
        told = said(*words)
        assert told["bound_s"] is told["stopped_in_time"] is told["stops"][0]["safe_mode_s"] is None
        assert told["within_buckets"] is True
        (airtime,) = told["airtime"]
        assert airtime["seconds"] == pytest.approx(13, abs=0.3)
        assert 0.5 * airtime["bucket_s"] < airtime["used_s"] <= airtime["bucket_s"]
        code, out, _ = phalanx(*words)
        assert code == 0
        assert "its bucket allows" in out
        assert "kept" in out

    def test_undefended_it_goes_on(self, said):
        told = said("attack", "run", "spoof:at=5", "--duration", "18", "--robots", "9", "--defence", "none")
        assert told["bound_s"] is told["stopped_in_time"] is None
        assert told["stops"][0]["safe_mode_s"] is None
        assert told["harm"] > 0

    def test_an_attack_takes_as_many_robots_as_it_needs(self, said):
        told = said("attack", "run", "collude:robot=3,at=1", "--duration", "2", "--robots", "9")
        robots = [stop["robot"] for stop in told["stops"]]
        assert 3 in robots
        assert len(robots) == Scenario().bti.f_max > 1

    def test_and_f_max_says_how_many_those_are(self, said):
        words = ("attack", "run", "collude:at=1", "--duration", "2", "--robots", "9", "--f-max", "2")
        assert len(said(*words)["stops"]) == 2

    def test_too_late_ends_with_1(self, phalanx, monkeypatch):
        monkeypatch.setattr("phalanx.lab.scorecard.flock_trial.stop_bound_s", lambda *_, **__: 0.5)
        code, out, _ = phalanx("attack", "run", "spoof:at=5", "--duration", "18", "--robots", "9")
        assert code == 1
        assert "BROKEN" in out

    def test_correct_robots_that_are_stopped_end_it_with_1(self, phalanx, monkeypatch):
        """No attack that is known stops one, so the trial says so. Before, it said "kept" and ended with 0."""
        words = "attack run mask:at=1 --duration 2 --robots 12 --f-max 1".split()
        really = cli_attack.try_attack

        def stops_one(*asked):
            trial = really(*asked)
            told = trial.attacked | {"correct_in_safe_mode": [3]}
            return trial if trial.wronged is None else replace(trial, wronged=(3,), attacked=told)

        monkeypatch.setattr(cli_attack, "try_attack", stops_one)
        code, out, _ = phalanx(*words)
        assert code == 1
        assert f"stopped with a quorum  {format_robots([3])}: promise P2 is BROKEN" in out
        code, out, _ = phalanx(*words, "--defence", "none")
        assert code == 0
        assert "none; no promise applies" in out

    def test_nobody_correct_is_left_to_be_harmed(self, said):
        told = said("attack", "run", "spoof:at=1", "--duration", "2", "--robots", "1")
        assert told["harm"] is told["honest_distance_m"] is None

    def test_an_option_without_effect_is_said_to_be_so(self, phalanx, said):
        words = ("attack", "run", "spoof:at=1,strong=1", "--duration", "2", "--robots", "4")
        assert said(*words)["idle"] == ["strong"]
        assert said(*words, "--defence", "none")["idle"] == []
        _, out, _ = phalanx(*words)
        assert "strong: makes no difference under hardened" in out

    @pytest.mark.parametrize(
        "words, complaint, hint",
        [
            ("spoof:at=1,foo=bar", "no option 'foo'", "strong, every, robot, at, until"),
            ("spoof:stong=1", "no option 'stong'", "did you mean strong?"),
            ("spoof:strong=2", "strong=2", "0 or 1"),
            ("spoof:strong=yes", "option strong of attack spoof is 'yes'", "0 or 1"),
            ("hijack:strong=1", "no option 'strong'", "robot, at, until"),
        ],
    )
    def test_options_are_checked(self, phalanx, words, complaint, hint):
        code, _, err = phalanx("attack", "run", words)
        assert code == 2
        assert complaint in err
        assert hint in err

    def test_an_unknown_one_is_refused(self, phalanx):
        code, _, err = phalanx("attack", "run", "spoff")
        assert code == 2
        assert "did you mean spoof?" in err


class TestFigures:
    @pytest.mark.slow
    def test_fig9_of_one_seed_from_the_command(self, phalanx, tmp_path):
        pytest.importorskip("matplotlib")
        words = ("reproduce", "bti-fig9", "--seeds", "1", "--out", str(tmp_path))
        code, out, err = phalanx(*words)
        assert code == 0
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bti-fig9.csv", "bti-fig9.png", "bti-fig9.svg"]
        assert out.splitlines()[-1] == "no verdict with fewer than ten seeds: 1"
        assert "2 of 2 runs" in err
        before = (tmp_path / "bti-fig9.csv").read_bytes()
        began = time.monotonic()
        code, out, _ = phalanx(*words, "--json")
        assert code == 0
        assert time.monotonic() - began < 60
        assert (tmp_path / "bti-fig9.csv").read_bytes() == before, "nothing is run again"
        rows = json.loads(out)["rows"]
        assert len(rows) == 6
        assert all(math.isfinite(float(row["ours"].split()[0].rstrip(","))) for row in rows)

    def test_no_seeds(self, phalanx, tmp_path):
        code, _, err = phalanx("reproduce", "bti-fig8", "--seeds", "0", "--out", str(tmp_path))
        assert code == 2
        assert "seeds 0" in err
