"""Planners in processes of their own: what comes of advice that is signed, forged, old, rubbish, too much, or late."""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from typing import ClassVar

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from phalanx.cli.main import run_command
from phalanx.config.guard import GuardConfig
from phalanx.daemon.evidence import read_robot_log
from phalanx.daemon.far_planner import MOST_AT_ONCE, MOST_LOOKS, FarPlanner
from phalanx.daemon.proofs import count_signed_messages
from phalanx.daemon.settings import read_robot
from phalanx.errors import UsageError
from phalanx.net import serial_line
from phalanx.net.keyring import pem
from phalanx.robot.planner import AHEAD_MS, FARTHEST, Adviser, Planner
from phalanx.robot.signer import AdviceSigner
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import guarded
from phalanx.wire.table import ACCELERATION, ENTRY_ACMD, SENSOR, STATE

KEY, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes((k,)) * 32) for k in (1, 2))
PUBLIC = KEY.public_key().public_bytes_raw().hex()
WISH = guarded.WISH.encode(vx_mps=0.0, vy_mps=1.0)
PHALANX = (sys.executable, "-m", "phalanx")
NORTH = """
from phalanx.robot import Planner

class North(Planner):
    def advise(self, t_s, position_m, velocity_mps):
        return 0.0, 1.0

class Wrong(Planner):
    def advise(self, t_s, position_m, velocity_mps):
        return 1 / 0

class Hung(Planner):
    def advise(self, t_s, position_m, velocity_mps):
        open(__file__ + ".hangs", "w").close()
        while True:
            pass
"""


def reading(robot=1, t_ms=1000, at=(1.0, 2.0)):
    return SENSOR.form.pack(SENSOR.tag, robot, t_ms, *at, 0.0, 0.0)


class Notes(Planner):
    """Wishes north, and notes what it hears."""

    heard: ClassVar[list] = []

    def advise(self, _t_s, _position_m, _velocity_mps):
        return 0.0, 1.0

    def hear(self, t_s, rob_id, position_m, _velocity_mps):
        self.heard.append((self.rob_id, t_s, rob_id, position_m))


def adviser(signer=None, clock=lambda: 0.0, robots=3):
    return Adviser(Notes, (5.0, 5.0), robots, signer, clock)


# --- the planner's side ---------------------------------------------------------------------------------------------


def test_a_reading_is_answered_with_advice_and_broadcasts_are_overheard_by_the_robot_that_sent_them():
    Notes.heard.clear()
    this = adviser()
    said = STATE.encode(id=9, t=5, x_m=3.0, y_m=4.0, vx_mps=0.0, vy_mps=0.0)
    assert this.answer("a", "", said) == b""  # of nobody yet
    assert this.answer("a", "", reading(2, 7000)) == WISH
    assert this.answer("a", "", said) == b""
    assert Notes.heard == [(2, 7.0, 9, (3.0, 4.0))]
    assert this.answer("b", "", reading(4)) == b"", "the mission has three"


@given(st.one_of(st.binary(max_size=60), st.binary(min_size=26, max_size=26).map(lambda raw: b"\x02" + raw)))
def test_whatever_a_robot_sends_is_survived(said):
    this = adviser(AdviceSigner(KEY, 1))
    this.answer("a", "", reading())
    assert len(this.answer("a", "", said)) in (0, guarded.SIGNED_BYTES)


@pytest.mark.parametrize("at", [(math.nan, 0.0), (0.0, math.inf), (2 * FARTHEST, 0.0)])
def test_a_reading_that_makes_no_sense_reaches_no_planner(at):
    assert adviser().answer("a", "", reading(at=at)) == b""


def test_a_reading_that_is_dated_ahead_is_not_signed_whoever_sends_it_from_there():
    now = [5000.0]
    this = adviser(AdviceSigner(KEY, 1), lambda: now[0])
    assert this.answer("a", "h", reading(t_ms=60_000))
    now[0] += 10_000
    assert this.answer("a", "h", reading(t_ms=70_000 + AHEAD_MS))
    assert this.answer("a", "h", reading(t_ms=70_006 + AHEAD_MS)) == b""  # 500 ppm are 5 ms
    assert this.answer("it came again", "h", reading(t_ms=90_000)) == b""
    assert this.answer("a", "elsewhere", reading(t_ms=70_000)) == b"", "a robot stays where it was first"
    assert this.answer("a", "h", reading(t_ms=60_500)), "one that is late is old, and no harm"


def test_who_speaks_first_from_elsewhere_keeps_no_robot_whose_address_is_known_from_its_advice():
    this = Adviser(Notes, (5.0, 5.0), 3, AdviceSigner(KEY, 1), lambda: 0.0, {1: "10.0.0.1"})
    assert this.answer("a", "10.0.0.9", reading(1, 7000)) == b""
    assert this.answer("b", "10.0.0.1", reading(1, 7000))
    assert this.answer("a", "10.0.0.9", reading(2, 7000)), "the others are where they speak first"


@pytest.mark.parametrize(
    "words, told",
    [
        (("udp:127.0.0.1:1", "--robot", "1"), "--robot 1"),
        (("udp:127.0.0.1:1", "--robot", "1=host"), "--robot 1=host"),
        (("udp:127.0.0.1:1", "--robot", "4=127.0.0.1"), "use a robot from 1 to 3"),
        (("unix:advice", "--robot", "1=127.0.0.1"), "--robot with unix:advice"),
    ],
)
def test_a_robots_address_that_is_none_is_told(tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mission.yaml").write_text("robots: 3\ncontroller: guard\nbti: {f_max: 1}\n")
    (tmp_path / "p.py").write_text(
        "from phalanx.robot import Planner\nclass P(Planner):\n    def advise(self, *_):\n        return 0.0, 0.0\n"
    )
    assert run_command(["robot", "advise", "mission.yaml", "p.py:P", *words]) == 2
    assert told in capsys.readouterr().err


# --- the robot's side -----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def planned(tmp_path, key="", mission=7):
    """A robot's side and a socket that it connects to."""
    scenario = Scenario(robots=3, controller="guard", guard=GuardConfig(adviser_key=key))
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listens:
        listens.bind(str(tmp_path / "advice"))
        listens.listen()
        listens.settimeout(10)
        far = FarPlanner("unix:advice", tmp_path, scenario, 1, mission)
        try:
            yield far, listens
        finally:
            far.close()


def test_advice_is_taken_when_it_has_come_and_the_newest_counts(tmp_path):
    with planned(tmp_path) as (far, listens):
        assert far.advice(reading()) == b""
        peer, _ = listens.accept()
        with peer:
            assert peer.recv(100) == reading()
            far.forward_state(b"\x81 an audit")
            far.forward_state(STATE.encode(id=9, t=5, x_m=3.0, y_m=4.0, vx_mps=0.0, vy_mps=0.0))
            assert len(peer.recv(100)) == STATE.size
            newest = guarded.WISH.encode(vx_mps=1.0, vy_mps=0.0)
            for packet in (
                WISH,
                b"",
                newest,
                b"rubbish",
                WISH + b"\0",
                guarded.SIGNED_WISH.encode(mission=7, id=1, t=1, vx_mps=0, vy_mps=0) + bytes(64),
            ):
                if packet:
                    peer.send(packet)
            assert far.advice(reading()) == newest
            assert (far.taken, far.rubbish) == (2, 3)
            assert far.advice(reading()) == b"", "it is taken once"


def test_one_that_hangs_or_floods_costs_no_more_than_some_packets_a_reading(tmp_path):
    with planned(tmp_path) as (far, listens):
        for _ in range(5000):  # more than any buffer holds, and nobody accepts
            assert far.advice(reading()) == b""
        peer, _ = listens.accept()
        with peer:
            peer.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    peer.send(b"x" * 200)
            far.advice(reading())
            assert 0 < far.rubbish <= MOST_AT_ONCE


def test_one_that_ends_and_comes_again_is_found_again(tmp_path, caplog):
    with planned(tmp_path) as (far, listens):
        far.advice(reading())
        listens.accept()[0].close()
        assert far.advice(reading()) == b""  # sees the end
        far.advice(reading())
        peer, _ = listens.accept()
        with peer:
            peer.send(WISH)
            assert far.advice(reading()) == WISH
        listens.close()
        for _ in range(5):
            assert far.advice(reading()) == b""
    assert len([words for words in caplog.messages if "no planner at" in words]) == 1


def test_of_signed_advice_only_what_counts_is_even_logged(tmp_path):
    with planned(tmp_path, PUBLIC) as (far, listens):
        far.advice(reading())
        peer, _ = listens.accept()
        good = AdviceSigner(KEY, 7).sign(1, 1000, WISH)
        others = [AdviceSigner(OTHER, 7).sign(1, 1000, WISH), AdviceSigner(KEY, 8).sign(1, 1000, WISH)]
        others += [AdviceSigner(KEY, 7).sign(2, 1000, WISH), WISH, good[:-1] + bytes((good[-1] ^ 1,))]
        with peer:
            for packet in (*others, good, good, AdviceSigner(KEY, 7).sign(1, 999, WISH)):
                peer.send(packet)
            assert far.advice(reading()) == good
            assert (far.taken, far.rubbish) == (1, len(others) + 2)


def test_a_socket_that_another_user_made_is_told_nothing(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("os.geteuid", lambda: os.getuid() + 1)
    monkeypatch.setattr(serial_line, "ROOT", -1)
    with planned(tmp_path) as (far, listens):
        far.advice(reading())
        with listens.accept()[0] as peer:
            assert peer.recv(100) == b""
    assert "neither you nor root" in caplog.text


def test_over_udp_nobody_but_the_planner_is_heard_and_who_is_elsewhere_should_sign(tmp_path, caplog):
    scenario = Scenario(robots=3, controller="guard")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        peer.bind(("127.0.0.1", 0))
        far = FarPlanner(f"udp:127.0.0.1:{peer.getsockname()[1]}", tmp_path, scenario, 1, 7)
        assert "may advise it" not in caplog.text
        far.advice(reading())
        _, robot = peer.recvfrom(100)
        stranger.sendto(WISH, robot)
        assert far.advice(reading()) == b""
        peer.sendto(WISH, robot)
        select.select([far._socket], [], [], 10)
        assert far.advice(reading()) == WISH
        far.close()
    FarPlanner("udp:192.0.2.1:4500", tmp_path, scenario, 1, 7)
    assert "anybody at udp:192.0.2.1:4500 may advise it" in caplog.text


@contextlib.contextmanager
def signed_over_udp(tmp_path):
    """A robot's side whose advice is signed, and what says something to it in the planner's name."""
    scenario = Scenario(robots=3, controller="guard", guard=GuardConfig(adviser_key=PUBLIC))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        far = FarPlanner(f"udp:127.0.0.1:{peer.getsockname()[1]}", tmp_path, scenario, 1, 7)
        far.advice(reading())
        _, robot = peer.recvfrom(100)
        try:
            yield far, lambda packet: peer.sendto(packet, robot)
        finally:
            far.close()


@pytest.mark.parametrize(
    "forged",
    [b"", WISH, AdviceSigner(OTHER, 7).sign(1, 1 << 60, WISH), AdviceSigner(OTHER, 8).sign(1, 1000, WISH)],
    ids=["empty", "unsigned", "of the future", "of another mission"],
)
def test_what_is_forged_in_the_planners_name_leaves_true_advice_its_place(tmp_path, forged):
    good = AdviceSigner(KEY, 7).sign(1, 1000, WISH)
    with signed_over_udp(tmp_path) as (far, say):
        for _ in range(60):
            say(forged)
        say(good)
        assert far.advice(reading(t_ms=1200)) == good


def test_no_more_signatures_are_looked_at_than_there_is_time_for(tmp_path, monkeypatch):
    looks = []
    with signed_over_udp(tmp_path) as (far, say):
        monkeypatch.setattr("phalanx.bti.trusted.order_check", lambda *_: looks.append(1) or -1)
        for _ in range(2 * MOST_LOOKS):
            say(AdviceSigner(OTHER, 7).sign(1, 1000, WISH))
        far.advice(reading(t_ms=1200))
        assert (len(looks), far.rubbish) == (MOST_LOOKS, 2 * MOST_LOOKS)


@pytest.mark.parametrize("words", ["planner", "udp:host:1", "unix:", "tcp:127.0.0.1:1", "unxi:advice"])
def test_what_is_no_planner_is_told_with_its_line(tmp_path, words):
    said = {"robot": 1, "mission": "m.yaml", "key": "k.json", "driver": "arena:.", "planner": words}
    path = tmp_path / "robot.yaml"
    path.write_text(json.dumps(said | {"radio": {"here": "127.0.0.1:1", "peers": ["127.0.0.1:2"]}}))
    with pytest.raises(UsageError, match=r"robot\.yaml:1: "):
        read_robot(path)


# --- processes ------------------------------------------------------------------------------------------------------

MISSION = """controller: guard
robots: 4
grid_step_m: 16
guard: {forget_ms: 1500, promise_ms: 1000, advice_ms: 1500, adviser_key: "PUBLIC"}
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 600, steps_per_state: 1, delta_ms: 290, skew_ms: 200}
""".replace("PUBLIC", PUBLIC)


def files(tmp_path):
    (tmp_path / "mission.yaml").write_text(MISSION)
    (tmp_path / "north.py").write_text(NORTH)
    (tmp_path / "advice.pem").write_bytes(pem(KEY))
    (tmp_path / "other.pem").write_bytes(pem(OTHER))
    (tmp_path / "key.json").write_text('{"mission": 1}')


def words_of(tmp_path, where, planner="North", sign="advice.pem"):
    signed = ("--sign", str(tmp_path / sign), "--key", str(tmp_path / "key.json")) if sign else ()
    mission, planner = str(tmp_path / "mission.yaml"), f"{tmp_path / 'north.py'}:{planner}"
    return ("robot", "advise", mission, planner, where, *signed)


class Between:
    """Hostile, without the key, between robots and their planner: only robot 1's advice goes on as it is."""

    def __init__(self, path, true):
        self._true = str(true)
        self._listens = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listens.bind(str(path))
        self._listens.listen()
        self.over = threading.Event()
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def _accept(self):
        self._listens.settimeout(0.1)
        while not self.over.is_set():
            with contextlib.suppress(TimeoutError):
                robot, _ = self._listens.accept()
                self._threads.append(threading.Thread(target=self._serve, args=(robot,), daemon=True))
                self._threads[-1].start()

    def _serve(self, robot):
        with robot, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as planner:
            planner.connect(self._true)
            robot.settimeout(0.1)
            planner.settimeout(5)
            first = b""
            while not self.over.is_set():
                try:
                    said = robot.recv(100)
                except TimeoutError:
                    continue
                except ConnectionResetError:
                    return
                if not said:
                    return
                planner.send(said)
                if said[0] != SENSOR.tag:
                    continue
                advice = planner.recv(200)
                first = first or advice
                number = SENSOR.decode(said)["id"]
                robot.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    if number == 1:
                        robot.send(advice)
                    elif number == 2:  # the same for ever
                        robot.send(first)
                    elif number == 3:  # forged, for another, and nonsense
                        robot.send(AdviceSigner(OTHER, 1).sign(3, SENSOR.decode(said)["t"], WISH))
                        robot.send(advice[:20] + b"\x01" + advice[21:])
                        robot.send(WISH)
                        robot.send(guarded.WISH.form.pack(guarded.KIND_WISH, math.nan, 0.0))
                    else:
                        while True:
                            robot.send(os.urandom(60))
                robot.settimeout(0.1)

    def close(self):
        self.over.set()
        for each in self._threads:
            each.join(10)
        self._listens.close()


def pushes(kept, rob_id):
    """What a robot commanded, and how much advice it took."""
    log = read_robot_log(kept / f"robot-{rob_id}.log")
    assert log.first_dishonest_entry() is None
    commands = [
        ACCELERATION.decode(log.raw[each.end - ACCELERATION.size : each.end])
        for each in log.entries()
        if each.kind == ENTRY_ACMD
    ]
    advice = [each for each in log.entries() if each.kind == guarded.MARK_ADVICE]
    return sum(each["ay_mps2"] > 0 for each in commands), len(advice)


@pytest.mark.waits
@pytest.mark.timeout(300)
def test_who_stands_between_robots_and_their_planner_moves_none_and_stops_none(tmp_path, capsys):
    files(tmp_path)
    true, kept = tmp_path / "true", tmp_path / "kept"
    advises = subprocess.Popen((*PHALANX, *words_of(tmp_path, f"unix:{true}")), stderr=subprocess.PIPE, text=True)
    try:
        assert "advises robots of mission" in advises.stderr.readline()
        assert true.stat().st_mode & 0o777 == 0o600
        between = Between(tmp_path / "between", true)
        try:
            arena = ("robot", "arena", str(tmp_path / "mission.yaml"), "--duration", "9", "--keep", str(kept), "--json")
            ended = subprocess.run(
                (*PHALANX, "--log-level", "error", *arena, "--planner", f"unix:{tmp_path / 'between'}"),
                capture_output=True,
                text=True,
                timeout=200,
                check=False,
            )
        finally:
            between.close()
    finally:
        advises.terminate()
        assert advises.wait(10) == 0
    assert not true.exists()
    assert ended.returncode == 0, ended.stderr
    summary = json.loads(ended.stdout)
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == [], summary["processes"]
    assert not any(told["refused"] for told in summary["processes"])
    moved = {rob_id: pushes(kept, rob_id) for rob_id in (1, 2, 3, 4)}
    assert moved[1][0] > 1, moved
    assert moved[1][1] > 6
    assert moved[2] == (0, 1), "its first was for the time in which robots listen"
    assert moved[3] == moved[4] == (0, 0)
    (by,) = count_signed_messages(read_robot_log(kept / "robot-1.log"))
    assert (by.signer, by.key, by.count) == ("adviser", PUBLIC, moved[1][1])
    assert run_command(["robot", "verify", str(kept / "robot-1.log")]) == 0
    assert f"by adviser ({PUBLIC})" in capsys.readouterr().out
    assert count_signed_messages(read_robot_log(kept / "robot-3.log")) == []
    rubbish = {told["robot"]: told["advice"]["rubbish"] for told in summary["processes"]}
    assert rubbish[1] == 0
    assert min(rubbish[2], rubbish[3], rubbish[4]) > 5
    assert run_command(["robot", "status", str(kept / "robot-3.yaml")]) == 0
    assert "rubbish" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("sign", "where", "told"),
    [
        ("", "unix:x", "names an adviser_key"),
        ("other.pem", "unix:x", "names another adviser_key"),
        ("advice.pem", "tcp:127.0.0.1:1", "invalid address"),
        ("advice.pem", "udp:127.0.0.1", "is not an address"),
        ("advice.pem", "udp:192.0.2.1:4500", "cannot listen at 192.0.2.1:4500"),
        ("advice.pem", "unix:nowhere/x", "cannot listen at nowhere/x"),
    ],
)
def test_what_an_operator_mistakes_is_a_line(tmp_path, capsys, sign, where, told):
    files(tmp_path)
    assert run_command([*words_of(tmp_path, where, sign=sign)]) in (1, 2)
    assert told in capsys.readouterr().err.splitlines()[0]


def test_a_planner_that_raises_ends_it_with_its_line_and_a_socket_that_was_left_is_taken(tmp_path):
    files(tmp_path)
    path = tmp_path / "advice"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as left:
        left.bind(str(path))
    process = subprocess.Popen(
        (*PHALANX, *words_of(tmp_path, f"unix:{path}", "Wrong")), stderr=subprocess.PIPE, text=True
    )
    try:
        assert "advises" in process.stderr.readline()
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as robot:
            robot.connect(str(path))
            robot.send(reading())
            assert process.wait(30) == 2
        assert "north.py:10: ZeroDivisionError" in process.stderr.read()
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_planner_that_hangs_does_not_keep_the_process(tmp_path, number):
    files(tmp_path)
    path, hangs = tmp_path / "advice", tmp_path / "north.py.hangs"
    words = (*PHALANX, *words_of(tmp_path, f"unix:{path}", "Hung"))
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    try:
        assert "advises" in process.stderr.readline()
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as robot:
            robot.connect(str(path))
            robot.send(reading())
            until_s = time.monotonic() + 10
            while not hangs.exists():
                assert time.monotonic() < until_s
            process.send_signal(number)
            assert process.wait(3) == 1
        assert "a call did not return" in process.stderr.read()
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_SEQPACKET])
def test_a_socket_at_which_somebody_listens_stays_his(tmp_path, capsys, kind):
    """Of another kind, or with no room for one more, it answers nobody who asks."""
    files(tmp_path)
    path = tmp_path / "theirs"
    with socket.socket(socket.AF_UNIX, kind) as theirs, socket.socket(socket.AF_UNIX, kind) as waits:
        theirs.bind(str(path))
        if kind != socket.SOCK_DGRAM:
            theirs.listen(0)
            waits.connect(str(path))
        assert run_command(words_of(tmp_path, f"unix:{path}")) == 1
        assert path.is_socket()
    assert "Address already in use" in capsys.readouterr().err


def test_a_mission_that_names_an_adviser_wants_him(tmp_path, capsys):
    files(tmp_path)
    assert run_command(["robot", "arena", str(tmp_path / "mission.yaml"), "--duration", "1"]) == 2
    assert "the mission has an adviser_key" in capsys.readouterr().err
