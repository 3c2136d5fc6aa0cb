"""Robots as processes, with trusted processes, sockets, clocks and kills."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest

import boards
from commands import run
from phalanx.attacks import IN_FLOCKS
from phalanx.bti.nodes import limits_of
from phalanx.cli.main import run_command
from phalanx.config import BtiConfig, RadioConfig
from phalanx.daemon.evidence import read_robot_log
from phalanx.daemon.proofs import check_proofs, unsealed
from phalanx.daemon.settings import read_robot
from phalanx.daemon.state import read_state
from phalanx.daemon.trusted import connect_nodes, provision_keys, start
from phalanx.net.keyring import create, open_keyring
from phalanx.net.mission_key import encode_mission_key_file, read_board, read_mission_key
from phalanx.wire import guarded
from phalanx.wire.table import ACCELERATION, ENTRY_ACMD
from robot_folder import write_robot

pytestmark = [pytest.mark.waits, pytest.mark.timeout(600)]
PHALANX = (sys.executable, "-m", "phalanx")
# Readings may be late by a quarter of a second: the machine has other things to do.
MISSION = """robots: 4
grid_step_m: 10
d_m: 10
goal_m: [100, 60]
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 600, steps_per_state: 1, delta_ms: 290, skew_ms: 200}
"""
WISHED = guarded.WISH.form.pack(guarded.KIND_WISH, 0.0, 1.0)
T_VAL_S, P_CHECK_S, SCHEDULING_S = 2.5, 0.1, 1.0
STILL = """
from phalanx.daemon.driver import Driver
from phalanx.robot import Act, Controller, Liar, Planner
from phalanx.wire.table import ACCELERATION

class Follow(Controller):
    heard = 0

    def on_recv(self, t_ms, packet):
        self.heard = (self.heard + 1) % 256

    def on_input(self, step, t_ms, reading):
        return [Act(ACCELERATION.encode(id=self.rob_id, t=t_ms, ax_mps2=1.0 + self.heard, ay_mps2=0.0))]

    def encode(self):
        return bytes((self.heard,))

    def decode(self, encoding):
        self.heard = encoding[0]

class Shove(Liar):

    def send_output(self, now_ms, output):
        if self.lies(now_ms) and isinstance(output, Act):
            output = Act(ACCELERATION.encode(id=self.id, t=now_ms, ax_mps2=-1.0, ay_mps2=0.0))
        return super().send_output(now_ms, output)

class Broken(Liar):
    def send_output(self, now_ms, output):
        return [][1] if self.lies(now_ms) else super().send_output(now_ms, output)

class North(Planner):
    def advise(self, t_s, position_m, velocity_mps):
        return 0.0, 1.0

class Still(Driver):
    def sense(self):
        return {"x_m": 1.0, "y_m": 2.0, "vx_mps": 0.0, "vy_mps": 0.0}
"""


def arena(tmp_path, *words, mission=MISSION, fails=""):
    path = tmp_path / "mission.yaml"
    path.write_text(mission)
    ended = run("--log-level", "error", "robot", "arena", str(path), "--json", *words, timeout_s=300)
    assert ended.returncode == int(bool(fails)), ended.stderr
    assert fails in ended.stderr
    return json.loads(ended.stdout)


def test_a_hijacked_robot_is_stopped_in_time_and_nobody_else(tmp_path, capsys):
    kept = tmp_path / "kept"
    lossy = ("--loss", "0.2", "--repeats", "0.2", "--delay-ms", "30", "--sealed", "--on-air", "past:robot=4,at=1")
    summary = arena(tmp_path, "--duration", "7", "--attack", "hijack:robot=3,at=2", "--keep", str(kept), *lossy)
    (liar,) = summary["compromised"]
    assert summary["duration_s"] == 7, "the time in which robots end does not count"
    assert (liar["robot"], liar["attack"]) == (3, "hijack")
    assert liar["first_deviation_s"] >= 2
    assert liar["safe_mode_s"] - liar["first_deviation_s"] < T_VAL_S + P_CHECK_S + SCHEDULING_S
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == [], summary["processes"]
    refusals = {(each["auditee"], each["reason"]) for told in summary["processes"] for each in told["refused"]}
    assert refusals == {(3, "output wrong")}
    assert all(told["tokens_got"] > 0 for told in summary["processes"])
    heard = [told["frames_refused"] for told in summary["processes"] if told["robot"] != 4]
    assert all(told.get("bad_mac") and told.get("repeated") for told in heard), heard
    assert 0.7 < summary["broadcast_delivery"] < 0.9
    # What they logged says the same, from the mission key on: over many checkpoints, and as a recording too.
    assert read_robot_log(kept / "robot-1.log").first_dishonest_entry() is None
    assert len(read_robot_log(kept / "robot-1.log").raw) > summary["log_bytes_max"], "nothing was ever covered"
    # And it is what their trusted nodes saw: with the key that only these have.
    for rob_id in (1, 3):
        log = read_robot_log(kept / f"robot-{rob_id}.log")
        sealed = read_mission_key(kept / "key.json", rob_id)
        key = unsealed(read_board(kept / f"board-{rob_id}.bin", rob_id), sealed)
        assert check_proofs(log, key).holds
        assert check_proofs(log, key).entries > len(log.entries()) // 2
        # A command that another stands for, as a robot would write it that wants to have been honest.
        other = next(each for each in log.entries() if each.kind == ENTRY_ACMD)
        raw = bytearray(log.raw)
        raw[other.end - 1] ^= 1
        assert check_proofs(replace(log, raw=bytes(raw)), key).entries == 0
        assert not check_proofs(log, bytes(20)).holds
    recording = tmp_path / "3.mcap"
    assert run_command(["robot", "log", str(kept / "robot-3.yaml"), "--out", str(recording)]) == 0
    capsys.readouterr()
    assert run_command(["robot", "verify", str(recording), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["reason"] == "output wrong"
    assert 2 <= found["at_s"] <= liar["first_deviation_s"] + 1
    assert run_command(["robot", "status", str(kept / "robot-3.yaml")]) == 0
    assert "not running" in capsys.readouterr().out


def test_of_a_field_that_is_cut_in_two_the_part_with_enough_tokens_goes_on_whatever_clocks_do(tmp_path):
    summary = arena(tmp_path, "--robots", "5", "--duration", "6.5", "--cut", "3", "--cut-at", "2", "--clock-ppm", "200")
    assert summary["without_quorum"] == [4, 5]
    assert summary["correct_in_safe_mode"] == []
    assert not any(told["refused"] for told in summary["processes"])


def test_robots_of_a_protocol_are_processes_whose_sensors_see_what_the_arena_shows(tmp_path, capsys):
    kept = tmp_path / "kept"
    tracking = MISSION.replace("goal_m: [100, 60]", "controller: tracking")
    words = ("--duration", "7", "--attack", "point-elsewhere:robot=3,at=2", "--keep", str(kept))
    summary = arena(tmp_path, *words, mission=tracking)
    (liar,) = summary["compromised"]
    assert liar["safe_mode_s"] - liar["first_deviation_s"] < T_VAL_S + P_CHECK_S + SCHEDULING_S
    assert summary["correct_in_safe_mode"] == []
    assert summary["task"]["% tracked"] > 0, "nobody saw anything"
    refused = {(each["auditee"], each["reason"]) for told in summary["processes"] for each in told["refused"]}
    assert {auditee for auditee, _ in refused} == {3}
    assert run_command(["robot", "verify", str(kept / "robot-1.log")]) == 0
    assert run_command(["robot", "verify", str(kept / "robot-3.log")]) == 1
    assert "FAULT" in capsys.readouterr().out


@pytest.mark.long
def test_an_arena_may_be_slower_than_real_time_and_all_clocks_are(tmp_path):
    began_s = time.monotonic()
    words = ("--speed", "0.5", "--clock-ppm", "200", "--sealed", "--on-air", "hold:robot=4,at=2")
    summary = arena(tmp_path, "--duration", "8", "--attack", "hijack:robot=3,at=2", "--robots", "5", *words)
    assert time.monotonic() - began_s > 16
    (liar,) = summary["compromised"]
    assert 2 <= liar["first_deviation_s"] <= 3
    assert liar["safe_mode_s"] - liar["first_deviation_s"] < T_VAL_S + P_CHECK_S + SCHEDULING_S
    assert summary["correct_in_safe_mode"] == []
    assert 7 < summary["processes"][0]["lived_s"] < 9
    assert all(told["frames_refused"].get("late") for told in summary["processes"] if told["robot"] not in (3, 4))


@pytest.mark.long
def test_controllers_of_one_s_own_audit_each_other_in_an_arena(tmp_path, capsys):
    (tmp_path / "still.py").write_text(STILL)
    own, kept = f"{tmp_path / 'still.py'}:Follow", tmp_path / "kept"
    words = ("--robots", "3", "--duration", "4.5", "--controller", own, "--keep", str(kept))
    summary = arena(tmp_path, *words, "--attack", f"{tmp_path / 'still.py'}:Shove:robot=3,at=1.5")
    assert [(liar["robot"], liar["attack"]) for liar in summary["compromised"]] == [(3, "shove")]
    assert summary["correct_in_safe_mode"] == []
    refused = [(each["auditee"], each["reason"]) for told in summary["processes"] for each in told["refused"]]
    assert set(refused) == {(3, "output wrong")}
    assert all(told["tokens_got"] > 0 for told in summary["processes"][:2])
    verify = ["robot", "verify", str(kept / "robot-1.log")]
    assert run_command([*verify, "--controller", own]) == 0
    assert run_command(verify) == 1, "the mission's own is another"
    capsys.readouterr()
    assert (
        run_command(["robot", "arena", str(tmp_path / "mission.yaml"), "--planner", own.replace("Follow", "North")])
        == 2
    )
    assert "nobody that it could advise" in capsys.readouterr().err


def test_an_attack_that_raises_is_told_from_one_that_was_stopped(tmp_path):
    (tmp_path / "still.py").write_text(STILL)
    words = ("--robots", "2", "--duration", "1.5", "--attack", f"{tmp_path / 'still.py'}:Broken:robot=2,at=0.1")
    summary = arena(tmp_path, *words, fails="phalanx: error: robot 2 ended with an error, see above, within ")
    assert [told["failed_s"] is None for told in summary["processes"]] == [True, False]
    told = summary["processes"][0]
    assert 0 < told["memory_began_kb"] <= told["memory_kb"]


DRIVEN = """controller: wheels
robots: 4
grid_step_m: 0.6
area_m: [2, 2]
gateway_key: ""
operator_key: ""
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 600, steps_per_state: 1, delta_ms: 290, skew_ms: 200}
"""


@pytest.mark.parametrize("as_json", [True, False])
def test_a_daemon_that_is_killed_is_named_and_is_none_of_the_correct(tmp_path, as_json):
    path, keep = tmp_path / "mission.yaml", tmp_path / "kept"
    path.write_text(DRIVEN.replace('""', json.dumps("ab" * 32)))
    words = ("robot", "arena", str(path), "--duration", "7", "--keep", str(keep), *(["--json"] if as_json else []))
    with subprocess.Popen(
        (*PHALANX, "--log-level", "error", *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        until_s = time.monotonic() + 60
        while not (keep / "robot-4.json").exists():
            assert time.monotonic() < until_s
            time.sleep(0.05)
        time.sleep(1)
        os.kill(read_state(keep / "robot-4.json")["pid"], signal.SIGKILL)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "phalanx: error: robot 4 was killed by SIGKILL, within " in err
    if not as_json:
        assert "contacts" not in out
        assert "distance" not in out
        return
    summary = json.loads(out)
    assert summary["contacts"] is summary["mean_distance_to_goal_m"] is None
    assert (summary["correct_in_safe_mode"], summary["without_quorum"]) == ([], [])
    assert [told["failed"] for told in summary["processes"]] == [None, None, None, "was killed by SIGKILL"]


@pytest.mark.long
@pytest.mark.parametrize(
    "attack, refused", [("past", "bad_mac"), ("replay", "repeated"), ("hold", "late"), ("foreign-key", "bad_mac")]
)
def test_what_a_taken_over_radio_does_no_protected_robot_hears(tmp_path, attack, refused):
    clocks = ("--clock-ppm", "200", "--delay-ms", "30")
    summary = arena(tmp_path, "--duration", "9", "--sealed", "--on-air", f"{attack}:robot=4,at=3", *clocks)
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []
    assert not any(told["refused"] for told in summary["processes"])
    assert all(told["frames_refused"].get(refused) for told in summary["processes"] if told["robot"] != 4)
    (hostile,) = summary["on_air"]
    assert (hostile["safe_mode_s"] is not None) == (attack in ("hold", "foreign-key"))


STOPPED = [name for name, attack in IN_FLOCKS.items() if attack.verdicts["hardened"] == "stopped"]


@pytest.mark.long
@pytest.mark.parametrize("names", [STOPPED[at : at + 3] for at in range(0, len(STOPPED), 3)], ids="+".join)
def test_each_attack_that_bound_stops_is_stopped_among_processes(tmp_path, names):
    words = [word for k, name in enumerate(names) for word in ("--attack", f"{name}:robot={2 + 3 * k},at=3")]
    summary = arena(tmp_path, "--robots", "9", "--f-max", "3", "--duration", "9", *words)
    assert [liar["attack"] for liar in summary["compromised"]] == names
    for liar in summary["compromised"]:
        assert liar["safe_mode_s"] is not None, liar
        assert liar["safe_mode_s"] - liar["first_deviation_s"] < T_VAL_S + P_CHECK_S + SCHEDULING_S, liar
    assert summary["correct_in_safe_mode"] == []


def test_a_robots_nodes_are_given_their_master_key_over_their_line_and_once(tmp_path, capsys):
    ring, words, path = tmp_path / "lab.keys", tmp_path / "words", tmp_path / "robot.yaml"
    words.write_text("some words that nobody guesses\n")
    create(ring, "lab", "some words that nobody guesses")
    (tmp_path / "mission.yaml").write_text(MISSION)
    radio = {"here": "127.0.0.1:4410", "peers": ["127.0.0.1:4411"]}
    said = {"robot": 2, "mission": "mission.yaml", "key": "key.json", "driver": "python:still.py", "radio": radio}
    path.write_text(json.dumps(said))
    command = ["robot", "provision", str(path), str(ring), "--passphrase-file", str(words)]
    assert run_command(command) == 0
    assert run_command(command) == 2
    assert "already belong to robot 2" in capsys.readouterr().err
    path.write_text(json.dumps(said | {"trusted": "process:other.flash"}))
    assert run_command(command) == 2
    assert "got its master key" in capsys.readouterr().err
    path.write_text(json.dumps(said))
    with open_keyring(ring, "some words that nobody guesses") as keys:
        number, sealed = keys.issue()
    (tmp_path / "key.json").write_bytes(encode_mission_key_file(number, sealed, {}))
    settings = read_robot(path)
    node = connect_nodes(settings)
    try:
        start(node, provision_keys(node, settings, limits_of(BtiConfig(), RadioConfig())))
    finally:
        node.close()


class Body:
    """Where a robot's trusted process finds its motors: this test."""

    def __init__(self, path):
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listening.bind(str(path))
        self._listening.listen()
        self._listening.settimeout(120)

    def begin(self):
        self._link, _ = self._listening.accept()
        self._link.settimeout(120)

    def told(self):
        return self._link.recv(100)

    def commanded(self):
        """Waits for a command, past words to stand still."""
        while (said := self.told()) == b"\0":
            pass
        return ACCELERATION.decode(said)

    def close(self):
        self._listening.close()


@contextlib.contextmanager
def a_board(tmp_path, kind):
    """Trusted nodes at a line of that kind, for who opens it first; what a robot's file calls it."""
    if kind == "serial":
        ours, theirs = os.openpty()
        program = subprocess.Popen(_program(tmp_path), stdin=ours)
        try:
            yield f"serial:{os.ttyname(theirs)}"
        finally:
            program.kill()
            program.wait()
            os.close(ours)
            os.close(theirs)
        return
    with socket.socket(socket.AF_UNIX if kind == "unix" else socket.AF_INET) as listening:
        listening.bind(str(tmp_path / "line") if kind == "unix" else ("127.0.0.1", 0))
        listening.listen()
        serving = threading.Thread(target=_serve, args=(listening, tmp_path), daemon=True)
        serving.start()
        yield "unix:line" if kind == "unix" else f"tcp:127.0.0.1:{listening.getsockname()[1]}"
    serving.join()


def _program(tmp_path):
    return (boards.built("node"), tmp_path / "trusted.flash", tmp_path / "wheels")


def _serve(listening, tmp_path):
    with listening.accept()[0] as line:
        subprocess.run(_program(tmp_path), stdin=line, check=False)


@contextlib.contextmanager
def running(path):
    process = subprocess.Popen((*PHALANX, "--log-level", "error", "robot", "run", str(path)), stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("lines", [("serial",), pytest.param(("unix", "tcp"), marks=pytest.mark.long)], ids="+".join)
def test_a_robot_that_is_killed_stands_and_lives_again_with_a_new_mission_key_only(tmp_path, lines):
    boards.built("node")  # before a robot waits for it to answer
    own = {"driver": "python:still.py", "planner": "still.py:North", "wheels": "wheels"}
    mission = MISSION.replace("grid_step_m: 10", "grid_step_m: 16\ncontroller: guard")
    keys, said = write_robot(tmp_path, 2, mission, **own)
    (tmp_path / "still.py").write_text(STILL)
    path = tmp_path / "robot.yaml"
    body = Body(tmp_path / "wheels")
    try:
        with running(path) as robot:
            body.begin()
            assert body.commanded()["id"] == body.commanded()["id"] == 2  # at the second, the first is on disk
            state = tmp_path / "robot-2.json"
            assert state.stat().st_mode & 0o777 == 0o600
            assert read_state(state)["pid"] == robot.pid
            os.kill(robot.pid, signal.SIGKILL)
            until_s = time.monotonic() + 60
            while body.told():  # to its motors' socket's end
                assert time.monotonic() < until_s
        advice = {
            kept.raw[each.at : each.end]
            for kept in [read_robot_log(tmp_path / "robot-2.log")]
            for each in kept.entries()
        }
        assert guarded.ADVICE.encode(bytes=WISHED) in advice, "its planner was not asked, or it is not on disk"
        again = subprocess.run((*PHALANX, "robot", "run", str(path)), capture_output=True, text=True, check=False)
        assert again.returncode == 1
        assert "already had the key of mission 1: the robot stands still" in again.stderr
        assert "phalanx keys issue" in again.stderr
        assert "Traceback" not in again.stderr
        body.begin()
        assert set(iter(body.told, b"")) <= {b"\0"}, "it moved"
        # Now over a line, as to a board, and with a controller of its own.
        del said["planner"], said["wheels"]
        for kind in lines:
            (tmp_path / "key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))
            with a_board(tmp_path, kind) as trusted:
                path.write_text(json.dumps(said | {"controller": "still.py:Follow", "trusted": trusted}))
                with running(path):
                    body.begin()
                    assert body.commanded()["ax_mps2"] == 1.0
                    # Nobody is there who could vouch for it.
                    while body.told() != b"\0":
                        pass
    finally:
        body.close()
