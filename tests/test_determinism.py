"""`phalanx sim check`: controllers that no audit could trust are found, each by what is wrong with it."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess

import pytest

from commands import PHALANX, ROOT
from phalanx.cli.main import run_command
from phalanx.errors import UsageError
from phalanx.lab.determinism import calls, check
from phalanx.lab.determinism.calls import ADVICE, ROBOT, calls_of, controller_factory
from phalanx.lab.determinism.check import Report, check_controller
from phalanx.lab.determinism.trace import LIVES, live
from phalanx.robot.controllers.python_controller import OwnMistake

OWN = f"{ROOT / 'examples' / 'own_controller.py'}:GoThere"
# It remembers a number, and where it is not told otherwise adds one to it and commands it.
WHOLE = """
import random, struct, time
from phalanx.robot.controllers.python_controller import Act, Controller, Send

EVERYBODY = []

class Mine(Controller):
    heard = 0
    hidden = 0

    def encode(self):
        return struct.pack("<d", self.heard)

    def decode(self, encoding):
        (self.heard,) = struct.unpack("<d", encoding)

    def on_recv(self, t_ms, packet):
        self.heard = self.heard + 1

    def on_input(self, step, t_ms, reading):
        return self.act(t_ms, self.heard, 0.0)

    def act(self, t_ms, ax_mps2, ay_mps2):
        motion = struct.pack("<ff", ax_mps2, ay_mps2)
        say = struct.pack("<BHQffff", 0x01, self.rob_id, t_ms, 0.0, 0.0, 0.0, 0.0)
        act = Act(struct.pack("<BHQ", 0x03, self.rob_id, t_ms) + motion)
        return [act, Send(say)] if t_ms % 6 == 0 else [act]
"""
COUNTED = "self.heard = self.heard + 1"
ACTED = "return self.act(t_ms, self.heard, 0.0)"
PROCESSES, COMPILED, BESIDE, FROM, OVER, RAISES, REFUSED = (
    "same in all processes", "same when not compiled", "same beside another", "same from checkpoints",
    "same over checkpoints", "raises nothing", "only what robots take",
)  # fmt: skip


@contextlib.contextmanager
def here(_folder, k, words, calls):
    """What a process would live through, lived in this one."""
    make = controller_factory(words)  # once: what its module keeps, all lives share
    lived = {name: LIVES[name](make, ROBOT, calls) for name in (("live",) if k else LIVES)}
    yield lambda: json.loads(json.dumps(lived))


def first_here(folder, k, *asked, _elsewhere=check._process):
    """The others are processes."""
    return (_elsewhere if k else here)(folder, k, *asked)


@pytest.fixture
def checked(tmp_path, monkeypatch):
    def checked(change: dict[str, str], process=check._process) -> Report:
        # One other process tells, but for the order of a set, which is the same in some.
        monkeypatch.setattr(check, "OTHERS", 3 if "list({" in str(change) else 1)
        monkeypatch.setattr(check, "_process", process)
        text = WHOLE
        for was, becomes in change.items():
            assert was in text
            text = text.replace(was, becomes)
        path = tmp_path / "mine.py"
        path.write_text(text)
        return check_controller(f"{path}:Mine")

    return checked


def failed(report: Report) -> dict[str, str]:
    return {check.name: str(check.finding) for check in report.checks if check.finding}


@pytest.mark.parametrize(
    "words", ["flock", *(pytest.param(each, marks=pytest.mark.long) for each in ("guard", "wheels"))]
)
def test_ours_are_the_same_everywhere(words, monkeypatch):
    monkeypatch.setattr(check, "OTHERS", 1)
    report = check_controller(words, seed=3)
    assert failed(report) == {}
    assert report.agrees
    assert report.calls > 300


def test_a_controller_that_is_advised_hears_of_it_and_nobody_else():
    def advised(words):
        return [call.odd for call in calls_of(controller_factory(words), words, 0) if call.step == ADVICE]

    assert advised("flock") == []
    told = advised("guard")
    assert {"", "again", "cut to 0 bytes", "zeros"} <= set(told)
    assert any("0000c07f" in odd for odd in told), "not a number"


def test_what_is_done_with_advice_is_compared(checked):
    heeds = "def on_advice(self, advice):\n        self.heard = random.random()\n\n    def on_recv"
    assert PROCESSES in failed(checked({"def on_recv": heeds}, here))
    whole = "def on_advice(self, advice):\n        self.heard = len(advice)\n\n    def on_recv"
    assert failed(checked({"def on_recv": whole}, first_here)) == {}
    refuses = "def on_advice(self, advice):\n        advice[8]\n\n    def on_recv"
    assert "on_advice raises" in failed(checked({"def on_recv": refuses}, here))[RAISES]


def test_so_is_the_one_that_the_others_are_made_from(checked):
    assert failed(checked({}, here)) == {}


@pytest.mark.parametrize(
    "change, where, place",
    [
        pytest.param(
            {ACTED: "return self.act(t_ms, 0.0, time.time() % 1)"},
            {PROCESSES, COMPILED, BESIDE, FROM, OVER},
            r"output 1, Act at byte 1[5-8] \(acceleration.ay_mps2\): ",
            id="a clock",
        ),
        pytest.param(
            {COUNTED: "self.heard += random.random()"},
            {PROCESSES, COMPILED, BESIDE, FROM, OVER},
            r"encode at byte [0-7]: ",
            id="chance",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, list({'north', 'south', 'east', 'west'}).index('west'), 0.0)"},
            {PROCESSES},
            r"output 1, Act at byte 1[1-4] \(acceleration.ax_mps2\): ",
            id="the order of a set of strings",
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, id(self) >> 4 & 0xFFFF, 0.0)"},
            {PROCESSES, FROM},
            r"call \d+ \(reading \d+, \d+ ms\): output 1, Act at byte 1[1-4]",
            id="where an object lies in memory",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {COUNTED: "EVERYBODY[:] = [t_ms]", ACTED: "return self.act(t_ms, (EVERYBODY or [0])[0] % 1000, 0.0)"},
            {BESIDE},
            r"output 1, Act at byte ",
            id="what was heard last, by whomever",
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, time.gmtime().tm_min, 0.0)"},
            {PROCESSES},
            r"output 1, Act at byte ",
            id="the minute of the hour",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, __import__('datetime').datetime.now().hour, 0.0)"},
            {PROCESSES},
            r"output 1, Act at byte ",
            id="the hour of the day",
        ),
        pytest.param(
            {COUNTED: "self.hidden += 1", "self.heard, 0.0": "self.hidden, 0.0"},
            {FROM, OVER},
            r"output 1, Act at byte 1[1-4] \(acceleration.ax_mps2\): ",
            id="something that is remembered and not encoded",
        ),
        pytest.param(
            {COUNTED: "self.heard += 1 / 3", '"<d", self.heard': '"<d", float(f"{self.heard:.3f}")'},
            {FROM, OVER},
            r"output 1, Act at byte 1[1-4] \(acceleration.ax_mps2\): [0-9a-f]{8} in process 1; [0-9a-f]{8} in gone on",
            id="a float that is rounded as text",
        ),
        pytest.param(
            {COUNTED: "EVERYBODY.append(packet); self.heard = len(EVERYBODY)"},
            {BESIDE, FROM, OVER},
            r"encode at byte [0-7]: ",
            id="something that all controllers of a process share",
        ),
        pytest.param(
            {COUNTED: "self.hidden += 1", "(self.heard,) =": "self.heard = max(self.heard, self.hidden);_ ="},
            {OVER},
            r"decode, then encode: other bytes",
            id="a checkpoint that is put on top of what was there",
        ),
        pytest.param(
            {COUNTED: "self.heard += int(__import__('phalanx.kernel').kernel.PURE) + 1"},
            {COMPILED},
            r"encode at byte [0-7]: .* in not compiled",
            id="compiled code that rounds otherwise",
        ),
        pytest.param(
            {COUNTED: "self.heard += packet[20]"},
            {RAISES},
            r"on_recv raises: IndexError in mine.py:\d+: index out of range",
            id="a packet that was cut short",
        ),
        pytest.param(
            {COUNTED: "self.heard += int(struct.unpack_from('<f', packet.ljust(27, b'.'), 11)[0])"},
            {RAISES},
            r"packet, \d+ ms, .*\): on_recv raises: ValueError in mine.py:\d+: cannot convert float NaN to integer",
            id="NaN in a frame",
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, 2.0 * struct.unpack_from('<f', reading, 15)[0], 0.0)"},
            {RAISES},
            r"reading \d+, \d+ ms, .* at byte 15\): on_input raises: OverflowError",
            id="a reading that is huge",
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, struct.unpack_from('<f', reading, 15)[0], 0.0)"},
            {REFUSED},
            r"at byte 15\): refused: on_input returned an invalid Act: acceleration: ax_mps2 is nan",
            id="NaN that goes on into a command",
        ),
        pytest.param(
            {ACTED: "return self.act(t_ms, 0.0, 0.0) if struct.unpack_from('<f', reading, 15)[0] < 1e9 else None"},
            {REFUSED},
            r"at byte 15\): refused: on_input returned None",
            id="no outputs at an odd reading",
        ),
        pytest.param(
            {COUNTED: "self.heard += len(packet) // 400", '"<d", self.heard)': '"<d", self.heard) + bytes(int(self.heard) * 5000)',
             '"<d", encoding)': '"<d", encoding[:8])'},
            {REFUSED},
            r"refused: encode returned \d+ bytes",
            id="an encoding that grows with what is heard",
        ),
    ],
)  # fmt: skip
def test_it_is_found_where_it_differs(checked, change, where, place):
    # What one process of several lives shows needs no other.
    alone = BESIDE in where or not where & {PROCESSES, COMPILED}
    by_place = "{'" in str(change) or "id(self)" in str(change)  # in memory, or in a set by a hash: of processes alike
    report = checked(change, here if alone else check._process if by_place else first_here)
    found = failed(report)
    assert where <= set(found)
    if where in ({PROCESSES}, {COMPILED}, {OVER}, {RAISES}, {REFUSED}):
        assert set(found) - ({REFUSED} - where) == where, "and nothing else is said of it"
    for name in where:
        assert re.search(place, found[name]), found[name]
    assert not report.agrees


@pytest.mark.long
def test_it_says_in_which_of_the_two_what_is(checked):
    found = failed(checked({COUNTED: "self.heard += time.monotonic() // 86400 + 1"}))
    assert re.search(r"in process 1; [0-9a-f]+ in process 2 \(hash seed 1, UTC-9, 1.4 days later\)$", found[PROCESSES])
    assert set(found) == {PROCESSES}


def test_what_fails_without_liars_is_told_with_its_line(checked):
    with pytest.raises(UsageError, match=r"mine.py:\d+: KeyError: 3"):
        checked({ACTED: "return {}[3]"})
    with pytest.raises(UsageError, match=r"mine.py:\d+: on_input returned None"):
        checked({ACTED: "return None"})


def test_what_does_not_return_is_told(checked, monkeypatch):
    monkeypatch.setattr(calls, "LONGEST_CALL_S", 0.3)
    with pytest.raises(UsageError, match=r"mine.py:\d+: on_input has not returned for 0.3 s \(reading 0, "):
        checked({ACTED: "while True: pass"})
    with pytest.raises(UsageError, match=r"mine.py:\d+: on_input has not returned for 0.3 s \(reading 0, "):
        checked({ACTED: "__import__('select').select([], [], [])"})


@pytest.mark.parametrize(
    "does, told",
    [
        ("open(__file__)", "opens a file"),
        ("time.sleep(1000)", "sleeps"),
        ("__import__('threading').Thread(target=time.sleep, args=(1000,)).start()", "starts a thread"),
        ("__import__('socket').socket()", "opens a socket"),
        ("__import__('os').system('true')", "starts a program"),
    ],
)
def test_what_looks_beyond_its_inputs_is_told_even_if_it_catches_that(checked, does, told):
    act = f"""
        try:
            {does}
        except Exception:
            pass
        {ACTED}"""
    with pytest.raises(UsageError, match=rf"mine.py:\d+: on_input {told} \(reading 0, "):
        checked({ACTED: act})


def test_nor_is_that_noted_as_something_raised(monkeypatch):
    class Endless:
        def on_recv(self, t_ms, packet):
            while True:
                pass

    monkeypatch.setattr(calls, "LONGEST_CALL_S", 0.3)
    with pytest.raises(OwnMistake, match="on_recv has not returned"):
        live(lambda _: Endless(), 1, [calls.Call(-1, 0, b"hello")])


class TestCommand:
    def test_0_is_the_same_everywhere(self):
        done = subprocess.run([*PHALANX, "sim", "check", OWN], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        assert [line.split()[-1] for line in done.stdout.splitlines()[1:]] == ["yes"] * 7

    def test_1_is_a_difference_and_json_has_its_place(self, tmp_path, monkeypatch, capsys):
        monkeypatch.setattr(check, "_process", here)
        path = tmp_path / "mine.py"
        path.write_text(WHOLE.replace(COUNTED, "self.heard += packet[20]"))
        assert run_command(["sim", "check", f"{path}:Mine", "--json", "--seed", "4"]) == 1
        told = json.loads(capsys.readouterr().out)
        assert (told["agrees"], told["seed"]) == (False, 4)
        (finding,) = [check["finding"] for check in told["checks"] if check["finding"]]
        assert finding["what"] == "on_recv raises"

    @pytest.mark.parametrize("words", ["flok", "nowhere.py:Mine", f"{ROOT / 'setup.py'}:Mine"])
    def test_2_is_no_controller(self, words, capsys):
        assert run_command(["sim", "check", words]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 2
        assert ("did you mean flock? use flock, guard, wheels, " in said[1]) == (words == "flok")


def test_what_ends_a_process_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(check, "OTHERS", 1)
    path = tmp_path / "mine.py"
    path.write_text(WHOLE + "\nimport os\nif os.environ.get('PYTHONHASHSEED') == '1': 1 / 0\n")
    assert run_command(["sim", "check", f"{path}:Mine"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("phalanx: error: a process of the check ended early: ")
    assert "ZeroDivisionError" in told
    assert "Traceback" not in told
