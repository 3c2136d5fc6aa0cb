"""A researcher's own classes on the command line: run from their file, and their mistakes told with file and line."""

from __future__ import annotations

import json
import subprocess

import pytest

from commands import PHALANX, ROOT
from phalanx.lab.determinism import check
from phalanx.scenarios.attack_spec import parse_attack
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks, mistakes_in
from phalanx.world import Scenario, simulate

OWN = f"{ROOT / 'examples' / 'own_controller.py'}:GoThere"
QUICK = ("--duration", "2", "--robots", "6")
WHOLE = """
from phalanx.robot.controllers.python_controller import Controller

class Mine(Controller):
    def encode(self):
        return b""
    def decode(self, encoding):
        pass
    def on_recv(self, t_ms, frame):
        pass
    def on_input(self, step, t_ms, reading):
        return []
"""
SEND = 'return [__import__("phalanx.robot.controllers.python_controller", fromlist="Send").Send(b"hello")]'


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A file mine.py in the working folder."""
    monkeypatch.chdir(tmp_path)

    def write(text: str, name: str = "mine.py") -> str:
        (tmp_path / name).write_text(text)
        return f"{name}:Mine"

    return write


class TestController:
    def test_sim_run_runs_it(self, phalanx):
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", OWN, "--json")
        assert code == 0, err
        scenario = find_scenario("flock-12").with_options(robots=6, duration_s=2.0)
        assert json.loads(out)["digest"] == simulate(scenario, controller=OWN).summaries[0]["digest"]

    def test_attack_run_runs_it_and_runs_it_where_nobody_lies(self, phalanx):
        words = ("--robots", "6", "--duration", "3", "--defence", "none", "--controller", OWN, "--json")
        code, out, err = phalanx("attack", "run", "hijack:robot=2,at=1", *words)
        assert code == 0, err
        told = json.loads(out)
        liar, nobody = (parse_attack("hijack:robot=2,at=1"),), ()
        for which, attacks in (("attacked", liar), ("honest", nobody)):
            scenario = Scenario(robots=6, duration_s=3.0, defence="none", attacks=attacks)
            assert told[which]["digest"] == simulate(scenario, controller=OWN).summaries[0]["digest"]
        _, out, _ = phalanx("attack", "run", "hijack:robot=2,at=1", *words[:-1])
        assert "6 robots, 3 s, seed 0\n" in out
        assert "distance to the goal" not in out, "that of the scenario, not of this controller"

    def test_where_it_goes_is_not_told_as_only_it_knows(self, phalanx):
        _, out, _ = phalanx("sim", "run", "flock-12", *QUICK, "--controller", OWN)
        assert "distance to the goal" not in out
        _, out, _ = phalanx("sim", "run", "flock-12", *QUICK)
        assert "distance to the goal" in out

    def test_what_it_prints_is_talk_and_no_data(self, phalanx, mine, monkeypatch):
        monkeypatch.setattr(check, "OTHERS", 1)
        words = mine("print('at first')\n" + WHOLE.replace("return []", "print('at work'); return []"))
        checked = ("sim", "check", words, "--json")
        attacked = ("attack", "run", "hijack:robot=2,at=1", *QUICK, "--controller", words, "--json")
        for called in (("sim", "run", "flock-12", *QUICK, "--controller", words, "--json"), attacked, checked):
            _, out, err = phalanx(*called)
            assert json.loads(out)
            assert "at first\n" in err
            assert "at work\n" in err

    def test_a_class_may_go_unnamed_where_there_is_one(self, phalanx, mine):
        mine(WHOLE)
        code, _, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", "mine.py")
        assert code == 0, err

    def test_it_may_import_what_lies_beside_it(self, phalanx, mine):
        mine("GOAL_M = 3", "beside_mine.py")
        words = mine("from beside_mine import GOAL_M\n" + WHOLE)
        code, _, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", words)
        assert code == 0, err

    @pytest.mark.parametrize(
        "change, complaint",
        [
            ({"return []": "return [] +"}, "mine.py:12: SyntaxError: invalid syntax"),
            ({"return []": "return steps"}, "mine.py:12: NameError: name 'steps' is not defined"),
            ({"return []": "raise SystemExit"}, "mine.py:12: SystemExit"),
            ({'return b""': "return bytes([300])"}, "mine.py:6: ValueError: bytes must be in range(0, 256)"),
            ({"pass\n    def on_input": "frame[99]\n    def on_input"}, "mine.py:10: IndexError: index out of range"),
            ({"import Controller": "import Controler"}, "mine.py:2: ImportError: cannot import name 'Controler'"),
            ({"class Mine": "1 / 0\nclass Mine"}, "mine.py:4: ZeroDivisionError: division by zero"),
            ({"def on_input": "def on_inputs"}, "mine.py:4: Mine has no on_reading"),
            ({"(Controller)": ""}, "Mine in mine.py is not a Controller"),
            ({"class Mine": "class Miner"}, "mine.py has no Mine"),
            ({"return []": "return None"}, "mine.py:12: on_input returned None"),
            ({'return b""': "return None"}, "mine.py:6: encode returned None"),
            ({"def encode(self)": "def encode(self, far)"}, "mine.py: TypeError: Mine.encode() missing 1 required"),
            ({"(self, t_ms, frame)": "(self)", "return []": SEND}, "mine.py: TypeError: Mine.on_recv() takes 1 pos"),
            ({"(self, step, t_ms, reading)": "(self, reading)"}, "mine.py: TypeError: Mine.on_input() takes 2 pos"),
            ({"    def encode": "    def __init__(self): pass\n    def encode"}, "mine.py: TypeError: Mine.__init__()"),
            (
                {"    def encode": "    state_bytes = 'many'\n    def encode"},
                "state_bytes of Mine in mine.py is 'many'",
            ),
            ({"return []": "return []\0"}, "mine.py: SyntaxError: source code"),
            ({"from phal": "import bad_beside\nfrom phal"}, "bad_beside.py:1: ZeroDivisionError: division by zero"),
        ],
    )
    def test_a_mistake_is_one_line_with_file_and_line(self, phalanx, mine, change, complaint):
        text = WHOLE
        mine("1 / 0", "bad_beside.py")
        for was, becomes in change.items():
            assert was in text
            text = text.replace(was, becomes)
        if "frame[99]" in text:
            text = text.replace("return []", "from struct import pack\n        " + SEND)
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", mine(text))
        # 1 for a controller that breaks a rule, 2 for a file that does not run.
        assert code == (1 if " returned " in complaint or " has no on_" in complaint else 2)
        assert out == ""
        assert "Traceback" not in err
        error, hint = err.splitlines()[-2:]
        assert error.startswith(f"phalanx: error: {complaint}")
        assert hint.startswith("phalanx: hint: ")

    def test_a_file_of_another_kind_is_not_what_was_meant(self, phalanx, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "mine.mcap").touch()
        words = ("sim", "run", "flock-12", *QUICK, "--planner", "mine.py:Mine")
        assert phalanx(*words)[2].splitlines()[-1] == "phalanx: hint: FILE.py:CLASS"
        (tmp_path / "min.py").touch()
        assert phalanx(*words)[2].splitlines()[-1] == "phalanx: hint: did you mean min.py? FILE.py:CLASS"

    def test_who_stops_honest_robots_is_told_how_to_find_out(self, phalanx, mine):
        text = WHOLE.replace('return b""', "return __import__('random').randbytes(4)")
        words = ("--robots", "9", "--f-max", "2", "--controller", mine(text))
        code, _, err = phalanx("sim", "run", "flock-12", "--duration", "13", *words)
        assert code == 1
        stopped, hint = err.splitlines()[-2:]
        assert stopped.startswith("phalanx: correct robots with a quorum were stopped: ")
        assert hint == "phalanx: hint: phalanx sim check mine.py:Mine"
        assert "sim check" not in phalanx("sim", "run", "flock-12", "--duration", "2", *words)[2]

    def test_the_traceback_is_there_for_who_wants_it(self, phalanx, mine):
        words = mine(WHOLE.replace("return []", "return steps"))
        code, _, err = phalanx("sim", "run", "flock-12", *QUICK, "--controller", words)
        assert code == 2
        assert err.splitlines()[-1] == "phalanx: hint: phalanx --log-level debug shows the whole traceback"
        command = [*PHALANX, "--log-level", "debug", "sim", "run", "flock-12", *QUICK, "--controller", words]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 2
        assert "in on_input\n    return steps" in done.stderr

    @pytest.mark.parametrize(
        "words, complaint",
        [
            ("nowhere.py:Mine", "no file nowhere.py"),
            ("flok", "no controller 'flok'\nphalanx: hint: did you mean flock? use flock, guard, "),
            (f"{ROOT / 'examples' / 'own_controller.py'}:GOAL_M", "GOAL_M in"),
        ],
    )
    def test_what_is_no_controller_is_refused(self, phalanx, words, complaint):
        code, _, err = phalanx("sim", "run", "flock-12", "--controller", words)
        assert code == 2
        assert complaint in err

    def test_an_attack_on_a_mission_takes_none(self, phalanx):
        code, _, err = phalanx("attack", "run", "dead-wheel", "--controller", OWN)
        assert code == 2
        assert "--controller" in err


LIES = """
from phalanx.attacks import Attack
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers.python_controller import Act

class Brake(Liar):
    'Throws its commands away.'
    def send_output(self, now_ms, output):
        if self.lies(now_ms) and isinstance(output, Act):
            return []
        return super().send_output(now_ms, output)

STOP = Attack("stop", Brake, bites_from=2.0, does="stops", stopped_by="replay")
"""


class TestAttack:
    def test_both_commands_run_it(self, phalanx, mine):
        mine(LIES, "lies.py")
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, "--attack", "lies.py:Brake:robot=2,at=1", "--json")
        assert code == 0, err
        (liar,) = json.loads(out)["compromised"]
        assert (liar["robot"], liar["attack"]) == (2, "brake")
        assert 1.0 <= liar["first_deviation_s"] <= 1.25
        words = ("--robots", "6", "--duration", "14", "--json")
        code, out, err = phalanx("attack", "run", "lies.py:Brake:robot=2,at=1", *words)
        assert code == 0, err
        told = json.loads(out)
        assert (told["attack"], told["stopped_in_time"]) == ("brake", True)

    @pytest.mark.parametrize(
        "words, robot, name",
        [
            ("lies.py:robot=3,at=0", 3, "brake"),
            ("lies.py:STOP:robot=4", 4, "stop"),
            ("lies.py:Brake", None, "brake"),
            ("lies.py", None, "brake"),
        ],
    )
    def test_it_may_be_a_record_or_the_only_class(self, mine, words, robot, name):
        mine(LIES, "lies.py")
        (spec,) = find_attacks([words])
        assert (spec.name, spec.robot, spec.attack.name) == (name, robot, name)

    def test_simulate_takes_the_class_as_well(self, mine, monkeypatch, tmp_path):
        mine(LIES, "lies.py")
        monkeypatch.syspath_prepend(str(tmp_path))
        from lies import STOP, Brake

        scenario = Scenario(robots=6, duration_s=16.0, defence="none")
        by_class, by_record, by_file = (
            simulate(scenario, attacks=attack).summaries[0] for attack in (Brake, [STOP], "lies.py:Brake")
        )
        assert by_class["digest"] == by_record["digest"] == by_file["digest"]
        assert by_class["digest"] != simulate(scenario).summaries[0]["digest"]

    def test_it_lies_to_robots_with_a_controller_from_a_file(self, phalanx, mine):
        mine(LIES, "lies.py")
        words = ("--attack", "lies.py:Brake:robot=2,at=1", "--controller", mine(WHOLE), "--json")
        code, out, err = phalanx("sim", "run", "flock-12", *QUICK, *words)
        assert code == 0, err
        assert json.loads(out)["compromised"][0]["attack"] == "brake"

    @pytest.mark.parametrize(
        "change, words, complaint",
        [
            ({"return []": "return {}[7]"}, "lies.py:Brake:robot=2,at=1", "lies.py:10: KeyError: 7"),
            (
                {"return []": "from phalanx.robot import State; return State('x', 0.0, 0.0, 0.0).encode()"},
                "lies.py:Brake:robot=2,at=1",
                "lies.py:10: state: x_m is 'x'",
            ),
            ({"return []": "return None"}, "lies.py:Brake:robot=2,at=1", "lies.py:8: send_output returned None"),
            ({"return []": "return ['x']"}, "lies.py:Brake:robot=2,at=1", "lies.py:8: send_output returned str"),
            (
                {
                    "def send_output(self, now_ms, output)": "def heard(self, now_ms, frame)",
                    "super().send_output(now_ms, output)": "None",
                    "isinstance(output, Act)": "not frame",
                },
                "lies.py:Brake:robot=2,at=0.1",
                "lies.py:6: on_packet returned None",
            ),
            (
                {"def send_output(self, ": "def send_output(self, far, "},
                "lies.py:Brake:robot=2,at=1",
                "lies.py: TypeError: Brake.send_output()",
            ),
            (
                {"    def send_output": "    period_ms = 'x'\n    def send_output"},
                "lies.py:Brake",
                "period_ms of Brake in lies.py is 'x'",
            ),
            ({"import Act": "import Acts"}, "lies.py:Brake", "lies.py:4: ImportError: cannot import name 'Acts'"),
            ({}, "lies.py:Brakes", "lies.py has no Brakes"),
            ({"(Liar)": ""}, "lies.py:Brake", "Brake in lies.py is not a Liar"),
            ({}, "lies.py:Brake:robot=x", "'brake:robot=x': robot of brake is 'x'"),
            ({}, "lies.py:Brake:far=3", "'brake:far=3': attack brake has no option 'far'"),
            ({}, "lies.py:Brake:", "'brake:' is not an attack"),
        ],
    )
    @pytest.mark.parametrize("command", [("sim", "run", "flock-12", "--attack"), ("attack", "run")])
    def test_a_mistake_is_one_line(self, phalanx, mine, change, words, complaint, command):
        text = LIES
        for was, becomes in change.items():
            assert was in text
            text = text.replace(was, becomes)
        mine(text, "lies.py")
        code, out, err = phalanx(*command, words, *QUICK)
        assert (code, out) == (1 if " returned " in complaint else 2, "")
        error, hint = err.splitlines()[-2:]
        assert error.startswith(f"phalanx: error: {complaint}")
        assert hint.startswith("phalanx: hint: ")
        assert "Traceback" not in err


class TestNobodyLies:
    def test_a_scenario_runs_without_its_attacks(self, phalanx):
        code, out, _ = phalanx("sim", "run", "bti-fig9", "--attack", "none", "--duration", "1", "--json")
        assert code == 0
        assert json.loads(out)["compromised"] == []

    def test_none_and_an_attack_is_refused(self, phalanx):
        code, _, err = phalanx("sim", "run", "bti-fig9", "--attack", "none", "--attack", "spoof")
        assert code == 2
        assert "an attack together with none" in err


class TestQuorum:
    @pytest.mark.parametrize("command", [("sim", "run", "flock-12"), ("attack", "run", "hijack:at=0.5")])
    def test_what_cannot_have_one_is_warned_of_once_before_it_runs(self, phalanx, command):
        code, _, err = phalanx(*command, "--robots", "3", "--duration", "1")
        assert code == 0
        assert err.startswith(
            "phalanx: warning: none of the robots has a quorum at the start, 5 correct others (f_max + 2) within"
            if command[0] == "sim"
            else "phalanx: warning: none of the correct robots has a quorum at the start, 5 correct others (f_max + 2)"
        )
        assert err.count("warning") == 1
        code, _, err = phalanx(*command, "--robots", "5", "--duration", "1", "--f-max", "1")
        assert code == 0
        assert "warning" not in err


class TestOurOwnMistakes:
    @pytest.mark.parametrize("error", [AssertionError, OSError, MemoryError, KeyboardInterrupt])
    def test_stay_what_they_are(self, error):
        with pytest.raises(error), mistakes_in("mine.py:Mine"):
            raise error

    def test_are_nobody_elses_where_no_file_is_named(self):
        with pytest.raises(TypeError), mistakes_in(None, "spoof"):
            raise TypeError
