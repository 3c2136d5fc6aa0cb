"""`--trace robot=5`: the events and actions of one robot, in a run that is the same as without."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.bti import request
from phalanx.config import BtiConfig
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.flock_law import flock_params
from phalanx.wire.fields import row
from phalanx.world import AttackSpec, Scenario
from phalanx.world.audited.pybot import described
from phalanx.world.scenarios.run import Run

TRACED = 5
# Lost packets make robots repeat fragments.
SWARM = Scenario(
    robots=9, grid_step_m=16.0, duration_s=14.0, bti=BtiConfig(f_max=1), radio=RadioConfig(loss=0.3), seed=2
)
FLOOD = replace(SWARM, attacks=(AttackSpec(name="frame-flood", robot=TRACED, at_s=6.0),))
EVENT = re.compile(r" *(\d+\.\d{6}) s  robot 5  (on_[a-z]+) *(.*)")
ACTION = re.compile(r" {13}    -> (transmit|actuate|retry at|round at|verdict) +(.+)")


def flock(rob_id):
    """The bundled flock, run as a controller in Python."""
    return compiled(dispatch.NUMBERS["flock"], flock_params(SWARM.flock))(rob_id)


CASES = {"bundled": (SWARM, None), "compromised": (FLOOD, None), "in Python": (replace(SWARM, duration_s=9.0), flock)}


def lived(scenario, controller, *, is_traced):
    run, lines = Run(scenario, controller), []
    if is_traced:
        run.trace(TRACED, lines.append)
    run.advance(scenario.duration_s)
    return {name: value for name, value in run.summary().items() if name != "real_time_factor"}, lines


@pytest.fixture(scope="module", params=CASES)
def case(request):
    scenario, controller = CASES[request.param]
    return request.param, lived(scenario, controller, is_traced=False)[0], *lived(scenario, controller, is_traced=True)


def test_a_traced_run_is_the_run_that_it_is_untraced(case):
    _, untraced, traced, _ = case
    assert traced == untraced
    assert traced["digest"] == untraced["digest"]


def test_each_line_is_an_event_at_its_time_or_an_action_that_it_led_to(case):
    name, _, _, lines = case
    events, actions, shown = [], set(), []
    assert EVENT.fullmatch(lines[0])
    for line in lines:
        if event := EVENT.fullmatch(line):
            events.append((float(event[1]), event[2]))
            shown.append(event[3])
        else:
            action = ACTION.fullmatch(line)
            assert action, line
            actions.add((events[-1][1], action[1]))
            shown.append(action[2])
    assert [at for at, _ in events] == sorted(at for at, _ in events)
    kinds = {"on_reading", "on_packet", "on_round", "on_retry", "on_sent"}
    assert {kind for _, kind in events} == (kinds | {"on_wake"} if name == "compromised" else kinds)
    assert {action for _, action in actions} == {"transmit", "actuate", "retry at", "round at", "verdict"}
    assert actions >= {
        ("on_reading", "actuate"), ("on_reading", "transmit"), ("on_packet", "verdict"), ("on_packet", "transmit"),
        ("on_round", "round at"), ("on_round", "transmit"), ("on_sent", "retry at"),
    }  # fmt: skip
    whole = "\n".join(shown)
    for pattern in (
        r"^sensor \(27 bytes\)$",
        r"^acceleration \(19 bytes\)$",
        r"^state \(27 bytes\), to everybody$",
        r"^HELLO of robot 5 \(6 bytes\), to everybody$",
        r"^fragment of robot 5 for robot \d, 1 of \d \(\d+ bytes\), to robot \d$",
        r"^token of robot 5 for robot \d \(\d+ bytes\), to robot \d$",
        r"^token of robot \d for robot 5 \(\d+ bytes\)$",
        r"^on robot \d: a token is due$",
        r"^\d+ ms of its clock$",
        r"^delivered$",
    ):
        assert re.search(pattern, whole, re.MULTILINE), pattern


def test_a_traced_auditor_names_what_is_wrong_with_a_liar():
    liar = AttackSpec(name="hijack", robot=2, at_s=4.0)
    _, lines = lived(replace(SWARM, attacks=(liar,), radio=RadioConfig()), None, is_traced=True)
    assert any("-> verdict     on robot 2: refused, output wrong" in line for line in lines)


def test_a_robot_that_listens_or_whose_radio_is_busy_is_traced_the_same():
    """A slow radio, which often is not done with a fragment when a round or a retry is due."""
    lossy = replace(SWARM, seed=1, d_m=16.0, radio=RadioConfig(loss=0.8, mcs=0), bti=BtiConfig(f_max=3))
    untraced, _ = lived(lossy, None, is_traced=False)
    traced, lines = lived(lossy, None, is_traced=True)
    assert traced == untraced
    assert any(re.search(r"-> round at +\d+ ms of its clock, silent until then$", line) for line in lines)
    assert any(line.endswith("on_round    after listening") for line in lines)
    assert any(line.endswith("on_sent     not delivered") for line in lines)


@pytest.mark.parametrize("rob_id", [0, 10, -1])
def test_a_robot_that_is_not_there_cannot_be_traced(rob_id):
    with pytest.raises(UsageError, match=f"no robot {rob_id} to trace"):
        Run(SWARM).trace(rob_id, print)


@given(st.binary(max_size=40), st.booleans())
def test_any_packet_has_a_description_with_its_length(raw, audits):
    raw = bytes([0x80]) + raw if audits else raw
    assert described(raw).endswith(f"({len(raw)} bytes)")


def test_what_is_no_packet_of_ours_is_a_number():
    assert described(b"") == "empty (0 bytes)"
    assert described(b"\x7f") == "kind 127 (1 bytes)"
    frame = row(bytes(request.AUDIT_HEAD_BYTES))
    request.audit_head(frame, 3, 0, 9)
    assert described(frame.tobytes()) == "audit packet 9 of robot 3 (6 bytes)"


class TestCommand:
    QUICK = ("sim", "run", "flock-12", "--duration", "3", "--robots", "6")

    def test_lines_go_to_stdout_before_the_summary(self, phalanx):
        code, out, err = phalanx(*self.QUICK, "--trace", "robot=5")
        assert (code, err) == (0, "")
        lines = out.splitlines()
        end = next(k for k, line in enumerate(lines) if line.startswith("scenario "))
        assert end > 20
        assert all(EVENT.fullmatch(line) or ACTION.fullmatch(line) for line in lines[:end])
        code, plain, _ = phalanx(*self.QUICK)
        digest = re.compile(r"^digest .*$", re.MULTILINE)
        assert digest.search(out)[0] == digest.search(plain)[0]

    def test_with_json_stdout_is_the_json_alone(self, phalanx):
        code, out, err = phalanx(*self.QUICK, "--trace", "robot=5", "--json")
        assert code == 0
        assert json.loads(out)["robots"] == 6
        assert all(EVENT.fullmatch(line) or ACTION.fullmatch(line) for line in err.splitlines())

    @pytest.mark.parametrize(
        ("words", "error", "hint"),
        [
            ("robot=99", "there is no robot 99 to trace", "robots are 1 to 6"),
            ("x", "--trace x", "give the number of one robot, such as --trace robot=5"),
            ("robot=", "--trace robot=", "give the number of one robot, such as --trace robot=5"),
            ("", "--trace ", "give the number of one robot, such as --trace robot=5"),
        ],
    )
    def test_a_mistake_is_one_line(self, phalanx, words, error, hint):
        code, out, err = phalanx(*self.QUICK, "--trace", words)
        assert (code, out) == (2, "")
        assert err.splitlines() == [f"phalanx: error: {error}", f"phalanx: hint: {hint}"]

    def test_a_second_robot_is_refused(self, phalanx):
        code, out, err = phalanx(*self.QUICK, "--trace", "robot=5", "--trace", "robot=6")
        assert (code, out) == (2, "")
        error, hint = err.splitlines()
        assert error == "phalanx: error: --trace robot=5 --trace robot=6"
        assert hint == "phalanx: hint: trace one robot per run"
