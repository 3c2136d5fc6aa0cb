"""Controllers that see dataclasses: what reaches them, what they remember, and what they get wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import pytest
from trials import scenario

from phalanx.bti.refusal import Refusal
from phalanx.cli.main import run_command
from phalanx.errors import PeerError
from phalanx.robot import F32, U16, Act, Command, Controller, Reading, Send, State
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.wire.table import ACCELERATION, SENSOR, STATE
from phalanx.world.scenarios.run import Run


@dataclass(frozen=True)
class Memory:
    id: U16 = 0
    x_m: F32 = 0.0


class Noting(Controller):
    """Broadcasts where it is, and remembers who was heard last."""

    memory = Memory()

    def on_state(self, t_ms, state):
        self.memory = Memory(state.id, state.x_m)

    def on_reading(self, step, t_ms, reading):
        state = State(reading.x_m, reading.y_m, reading.vx_mps, reading.vy_mps)
        return [Command(0.5, -0.5), state] if step % 6 == 0 else [Command(0.5, -0.5)]


READING = Reading(1.0, 2.0, 3.0, 4.0, id=7, t=1000)
OTHER = State(5.0, 6.0, 7.0, 8.0, id=9, t=900)


def test_what_it_returns_becomes_bytes_in_its_own_name():
    act, send = Noting(7).on_input(0, 1000, READING.encode())
    assert act == Act(ACCELERATION.encode(id=7, t=1000, ax_mps2=0.5, ay_mps2=-0.5))
    assert send == Send(STATE.encode(id=7, t=1000, x_m=1.0, y_m=2.0, vx_mps=3.0, vy_mps=4.0))


def test_bytes_may_stand_beside_dataclasses_and_another_name_beside_its_own():
    class Mixed(Noting):
        def on_reading(self, step, t_ms, reading):
            return [Act(b"act"), State(0.0, 0.0, 0.0, 0.0, id=8, t=5), Send(b"send")]

    act, state, send = Mixed(7).on_input(0, 1000, READING.encode())
    assert (act, send) == (Act(b"act"), Send(b"send"))
    assert State.decode(state.payload) == State(0.0, 0.0, 0.0, 0.0, id=8, t=5)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 3e38])
def test_a_broken_sensor_and_a_liar_reach_no_method(number):
    class Never(Noting):
        def on_state(self, t_ms, state):
            raise AssertionError(state)

        on_reading = on_state

    values = {"x_m": 0.0, "y_m": number, "vx_mps": 0.0, "vy_mps": 0.0}
    coasts = [Act(ACCELERATION.encode(id=7, t=1000, ax_mps2=0.0, ay_mps2=0.0))]
    assert Never(7).on_input(0, 1000, SENSOR.form.pack(SENSOR.tag, 7, 0, *values.values())) == coasts
    Never(7).on_recv(1000, STATE.form.pack(STATE.tag, 9, 0, *values.values()))
    for packet in (b"", b"\1", OTHER.encode()[:-1], OTHER.encode() + b"\0", b"\2" + OTHER.encode()[1:]):
        Never(7).on_recv(1000, packet)


def test_what_stands_behind_a_reading_is_beside_it():
    class Sees(Controller):
        def on_reading(self, step, t_ms, reading):
            return [Send(reading.beside)]

    assert Sees(1).on_input(0, 0, READING.encode() + b"more") == [Send(b"more")]


def test_a_memory_is_its_checkpoint():
    one, other = Noting(7), Noting(7)
    assert one.encode() == bytes(6)
    one.on_recv(0, OTHER.encode())
    assert one.encode() == b"\x09\x00" + b"\x00\x00\xa0\x40"
    other.decode(one.encode())
    assert other.memory == one.memory == Memory(9, 5.0)
    for wrong in (b"", bytes(5), bytes(7)):
        with pytest.raises(PeerError):
            other.decode(wrong)
    assert Noting.memory == Memory(), "others boot as before"


def test_a_controller_without_a_memory_has_an_empty_checkpoint():
    class Still(Controller):
        def on_reading(self, step, t_ms, reading):
            return [Command(0.0, 0.0)]

    still = Still(1)
    assert still.encode() == b""
    still.decode(b"")
    with pytest.raises(PeerError):
        still.decode(b"x")


def test_a_fixed_memory_makes_room_for_itself():
    @dataclass(frozen=True)
    class Long:
        places: tuple[(F32,) * 375] = (0.0,) * 375

    class Remembers(Noting):
        memory = Long()
        on_state = Controller.on_state

    assert Remembers.state_bytes == 1500
    assert refusals(Remembers) == {Refusal.NONE}


def refusals(made):
    ended = Run(scenario("hardened", robots=6, end_s=12), made)
    ended.advance(12.0)
    return {why for *_, why in ended.new_verdicts()}


def test_a_number_that_is_rounded_in_its_checkpoint_is_rounded_at_once():
    """Else an auditor would go on from another number than the robot, and convict it."""

    @dataclass(frozen=True)
    class Sum:
        x: F32 = 0.0

    class Adds(Controller):
        memory = Sum()

        def on_reading(self, step, t_ms, reading):
            self.memory = Sum(self.memory.x + 0.1)
            return [Command(self.memory.x * 1e-3, 0.0)]

    assert refusals(Adds) == {Refusal.NONE}


def test_attributes_are_set_until_it_boots():
    class Counts(Noting):
        def __init__(self, rob_id):
            super().__init__(rob_id)
            self.side = 1 if rob_id % 2 else -1

        def on_reading(self, step, t_ms, reading):
            self.seen = step
            return []

    counts = Counts(1)
    counts.encode()
    with pytest.raises(OwnMistake, match="Counts sets seen, which no checkpoint holds"):
        counts.on_input(0, 0, READING.encode())


FILE = """from dataclasses import dataclass
from phalanx.robot import Act, Command, Controller, Reading, Send, State, F32, U16

@dataclass(frozen=True)
class Memory:
    id: U16 = 0
    x_m: F32 = 0.0

class Mine(Controller):
    memory = Memory()

    def on_state(self, t_ms, state):
        self.memory = Memory(state.id)

    def on_reading(self, step, t_ms, reading):
        command = Command(1.0, 0.0)
        state = State(0.0, 0.0, 0.0, 0.0)
        return [command, state]
"""
RAW = """
    def on_input(self, step, t_ms, reading):
        if not reading:
            return []
        return [Send(b"hello"), Act(b"act")]
"""


@pytest.mark.parametrize(
    "change, complaint",
    [
        ({"[command, state]": "[state, command]"}, "mine.py:18: on_reading sends before it acts"),
        ({"return [command, state]": "yield state; yield command"}, "mine.py:18: on_reading sends before it acts"),
        ({"[command, state]": "[command, state, command]"}, "mine.py:18: on_reading sends before it acts"),
        ({"[command, state]\n": f"[]\n{RAW}"}, "mine.py:20: on_input sends before it acts"),
        ({"[command, state]": "command"}, "mine.py:18: on_reading returned Command"),
        ({"[command, state]": "[command, reading]"}, "mine.py:18: on_reading put out Reading"),
        ({"return [command, state]": "pass"}, "mine.py:18: on_reading returned None"),
        (
            {"Command(1.0": "Command(float('nan')"},
            "mine.py:18: on_reading put out a Command: acceleration: ax_mps2 is nan",
        ),
        ({"State(0.0": "State(2e6"}, "mine.py:18: on_reading put out a State: state: x_m is 2000000.0"),
        ({"Memory(state.id)": "Memory(-state.id)"}, "mine.py:13: memory.id is -"),
        ({"Memory(state.id)": "state.id"}, "mine.py:13: memory is a int, not a Memory"),
        ({"self.memory = ": "self.heard = "}, "mine.py:13: Mine sets heard, which no checkpoint holds"),
        ({"x_m: F32 = 0.0": "x_m: list = None"}, "mine.py:9: memory.x_m is a list, which has no encoding"),
        ({"(frozen=True)": ""}, "mine.py:9: memory is a Memory that is not frozen"),
        ({"memory = Memory()": "memory = {}"}, "mine.py:9: memory is a dict, not a dataclass"),
        ({"memory = Memory()": "memory = Memory(id=70_000)"}, "mine.py:9: memory.id is 70000: does not fit into U16"),
        ({"def on_reading": "def on_readings"}, "mine.py:9: Mine has no on_reading"),
    ],
)
@pytest.mark.parametrize("defence", ["none", "hardened"])
def test_a_mistake_is_one_line_with_file_and_line(tmp_path, monkeypatch, capsys, change, complaint, defence):
    text = FILE
    for was, becomes in change.items():
        assert was in text
        text = text.replace(was, becomes)
    (tmp_path / "mine.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    words = ("sim", "run", "flock-12", "--duration", "3", "--robots", "6", "--defence", defence)
    assert run_command([*words, "--controller", "mine.py"]) == 1
    out, err = capsys.readouterr()
    error, hint = err.splitlines()[-2:]
    assert (out, "Traceback" in err) == ("", False)
    assert error.startswith(f"phalanx: error: {complaint}")
    assert hint.startswith("phalanx: hint: ")


@pytest.mark.parametrize("named", ["./mine.py", "{}/mine.py:Mine", "../{}/mine.py"])
def test_the_file_is_called_as_the_user_called_it(tmp_path, monkeypatch, capsys, named):
    (tmp_path / "mine.py").write_text(FILE.replace("[command, state]", "[state, command]"))
    monkeypatch.chdir(tmp_path)
    named = named.format(tmp_path if named[0] == "{" else tmp_path.name)
    assert run_command(["sim", "run", "flock-12", "--duration", "1", "--controller", named]) == 1
    assert f"phalanx: error: {named.removesuffix(':Mine')}:18: on_reading sends" in capsys.readouterr().err


def test_sim_check_names_the_line_of_an_action_out_of_order(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(FILE.replace("[command, state]", "[state, command]"))
    monkeypatch.chdir(tmp_path)
    assert run_command(["sim", "check", "mine.py"]) == 1
    assert "phalanx: error: mine.py:18: on_reading sends before it acts" in capsys.readouterr().err


def test_fields_are_those_of_the_byte_table():
    for kind, record in ((Reading, SENSOR), (Command, ACCELERATION), (State, STATE)):
        names = [field.name for field in fields(kind)]
        assert [each for each in names if each != "beside"] == [field.name for field in record.fields]
