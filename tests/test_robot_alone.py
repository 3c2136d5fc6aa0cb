"""A robot's file, its keys, its radio, and what it does before a mission begins: none of it needs another process."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import ipaddress
import json
import math
import os
import re
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ordered import MISSION, PUBLIC, order, wheels_order
from phalanx.bti.fleet import HARDENED, make_fleet
from phalanx.bti.nodes import seal_mission_key
from phalanx.cli.reproduce import _write
from phalanx.cli.robot import _state, status
from phalanx.config import BtiConfig
from phalanx.daemon import kept_log, proofs
from phalanx.daemon import life as life_module
from phalanx.daemon import run as daemon_run
from phalanx.daemon.driver import Driver, NoReading, OwnDriver, make_driver, no_reading
from phalanx.daemon.driver_thread import DriverThread
from phalanx.daemon.evidence import RobotLog
from phalanx.daemon.kept_log import KeptLog
from phalanx.daemon.lateness import Lateness, why_stopped
from phalanx.daemon.life import Life
from phalanx.daemon.proofs import NOBODY, count_signed_messages
from phalanx.daemon.run import mission_of, provision
from phalanx.daemon.settings import RobotFile, read_robot, robot_schema
from phalanx.daemon.state import read_state as fuse_matches
from phalanx.daemon.trusted import check_may_have_key, connect_nodes, provision_keys
from phalanx.errors import Unavailable, UsageError
from phalanx.lab.scorecard.card import write_csv
from phalanx.net import serial_line, udp_radio
from phalanx.net.mission_key import encode_mission_key_file, read_board, read_mission_key
from phalanx.net.serial_line import open_line
from phalanx.net.udp_radio import LEAST_WAITING, PeerLimits, UdpRadio, parse_address
from phalanx.papers.table import Table, TableFile
from phalanx.recording.recorder import Recorder
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.behaviour import params_of
from phalanx.scenarios.file import parse_scenario, written_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.driven import GATEWAY, OPERATOR, TELL_STOP
from phalanx.wire.table import ACCELERATION, BOARD, ENTRY, ENTRY_RECV, PACKET_MAX, SENSOR
from ports import free_udp_port

ROBOT = """robot: 3
mission: flock-12
key: key.json
driver: python:wheels.py
radio:
  here: 127.0.0.1:4403
  peers: [127.0.0.1:4401, "[::1]:4402"]
"""


def robot(tmp_path, text=ROBOT):
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    return read_robot(path)


def test_a_robots_file_is_read_and_its_paths_are_beside_it(tmp_path):
    settings = robot(tmp_path)
    assert settings.said.robot == 3
    assert settings.said.radio.peers == ("127.0.0.1:4401", "[::1]:4402")
    assert settings.path(settings.said.key) == tmp_path / "key.json"
    assert mission_of(settings).robots == 12


@pytest.mark.parametrize(
    ("was", "said", "line", "what"),
    [
        ("robot: 3", "robot: 0", 1, "robot is 0"),
        ("robot: 3", "robot: three", 1, "robot is 'three'"),
        ("robot: 3\n", "", 1, "robot file has no robot"),
        ("driver: python:wheels.py", "driver: wheels.py", 4, "driver is 'wheels.py'"),
        ("key: key.json", "keys: key.json", 3, "robot file has no 'keys'"),
        ('  peers: [127.0.0.1:4401, "[::1]:4402"]', "  peers: []", 7, "peers is empty"),
        ("  here: 127.0.0.1:4403\n", "", 6, "radio has no here"),
    ],
)
def test_a_mistake_in_it_is_told_with_its_line(tmp_path, was, said, line, what):
    assert was in ROBOT
    with pytest.raises(UsageError) as told:
        robot(tmp_path, ROBOT.replace(was, said))
    assert str(told.value).startswith(f"{tmp_path}/robot.yaml:{line}: {what}")


def test_its_schema_knows_all_that_a_file_may_say():
    schema = robot_schema()
    assert set(schema["properties"]) == set(RobotFile.__dataclass_fields__)
    assert schema["properties"]["radio"]["required"] == ["here", "peers"]
    assert "default" not in schema["properties"]["robot"]


def test_what_is_written_of_a_scenario_is_read_as_the_same():
    scenario = Scenario(
        name="x",
        robots=5,
        bti=BtiConfig(f_max=1, t_audit_ms=1000),
        attacks=(AttackSpec(name="hijack", robot=2, at_s=1.0),),
    )
    assert parse_scenario(json.dumps(written_scenario(scenario)).encode(), "x.yaml") == scenario


def test_a_mission_key_is_read_for_the_robot_that_it_is_sealed_for(tmp_path):
    path, sealed = tmp_path / "key.json", seal_mission_key(bytes(20), bytes(range(20)), bytes(20), 7)
    path.write_bytes(encode_mission_key_file(7, {3: sealed}, {}))
    assert read_mission_key(path, 3) == sealed
    with pytest.raises(UsageError, match="no key for robot 4"):
        read_mission_key(path, 4)
    path.write_text('{"mission": 7, "robots": {"3": {"k": "00", "r": "00", "mac": "00"}}}')
    with pytest.raises(UsageError, match="is not a mission key file"):
        read_mission_key(path, 3)
    path.write_text("[" * 100_000)
    with pytest.raises(UsageError, match="is not a mission key file"):
        read_mission_key(path, 3)


def test_a_board_file_is_for_one_robot(tmp_path):
    path = tmp_path / "board.bin"
    path.write_bytes(BOARD.encode(id=3, master=bytes(range(20))))
    assert read_board(path, 3) == bytes(range(20))
    with pytest.raises(UsageError, match="is for robot 3"):
        read_board(path, 2)
    path.write_bytes(b"short")
    with pytest.raises(UsageError, match="not a board file"):
        read_board(path, 3)


def test_nodes_at_a_socket_that_another_user_made_are_told_nothing(tmp_path, monkeypatch):
    path = tmp_path / "nodes"
    with socket.socket(socket.AF_UNIX) as listens:
        listens.bind(str(path))
        listens.listen()
        open_line(f"unix:{path}").close()
        monkeypatch.setattr("os.geteuid", lambda: os.getuid() + 1)
        monkeypatch.setattr(serial_line, "ROOT", -1)
        with pytest.raises(Unavailable, match="neither you nor root"):
            open_line(f"unix:{path}")


def test_a_flash_that_others_may_read_gets_no_keys(tmp_path):
    settings = robot(tmp_path)
    flash = tmp_path / "trusted.flash"
    flash.touch(0o600)
    connect_nodes(settings).close()
    flash.chmod(0o640)
    with pytest.raises(UsageError, match=r"trusted\.flash is another user's, or open to others"):
        connect_nodes(settings)


def with_nodes(tmp_path, where):
    return robot(tmp_path, ROBOT + f'trusted: "{where}"\n')


@pytest.mark.parametrize("where", ["192.168.1.7:4400", "board.local:4400", "[fd00::7]:4400", "0.0.0.0:4400"])
def test_a_master_key_goes_to_nobody_over_a_network(tmp_path, where):
    settings = with_nodes(tmp_path, f"tcp:{where}")
    with pytest.raises(UsageError, match="cannot send a master key to"):
        provision(settings, tmp_path / "no.keys", "", "2026-01-01")
    node = SimpleNamespace(about=SimpleNamespace(robot_id=0))
    (tmp_path / "key.json").write_bytes(
        encode_mission_key_file(1, {3: seal_mission_key(bytes(20), bytes(20), bytes(20), 1)}, {})
    )
    with pytest.raises(UsageError, match="cannot send a master key to"):
        provision_keys(node, settings, None)


def test_each_start_with_nodes_on_a_network_warns(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("phalanx.daemon.trusted.open_line", lambda _: pytest.fail("opened"))
    with pytest.raises(pytest.fail.Exception):
        connect_nodes(with_nodes(tmp_path, "tcp:192.0.2.1:4400"))
    assert "are not authenticated" in caplog.text


@pytest.mark.parametrize("here", ["tcp:127.0.0.1:9", "tcp:localhost:9", "tcp:[::1]:9", "unix:x", "serial:/dev/x"])
def test_where_it_stays_on_this_machine_it_may(tmp_path, here):
    check_may_have_key(with_nodes(tmp_path, here))


def test_a_folder_that_cannot_be_written_is_found_before_the_missions_key_is_used_up(tmp_path, monkeypatch):
    (tmp_path / "key.json").write_bytes(
        encode_mission_key_file(7, {3: seal_mission_key(bytes(20), bytes(20), bytes(20), 7)}, {})
    )
    (tmp_path / "board.bin").write_bytes(BOARD.encode(id=3, master=bytes(20)))
    settings = robot(tmp_path, ROBOT + "board: board.bin\nfolder: nowhere\n")
    monkeypatch.setattr(daemon_run, "start", None)
    with pytest.raises(Unavailable, match=r"cannot write .*nowhere/robot-3\.log"):
        asyncio.run(daemon_run.run_robot(settings))


def test_a_mission_that_never_began_leaves_the_log_of_the_one_before(tmp_path):
    path = tmp_path / "robot-3.log"
    path.write_text("evidence")
    with KeptLog(path):
        assert path.read_text() == "evidence"
    assert list(tmp_path.iterdir()) == [path]
    with KeptLog(path) as kept:
        kept.begin({})
    assert (path.read_text(), path.with_suffix(".before.log").read_text()) == ("{}\n", "evidence")


def logged(length):
    robot = SimpleNamespace(log_len=length, requests_sent=0)
    rest = np.zeros((1, 0), np.uint8)
    return SimpleNamespace(robot=[robot], log=np.zeros((1, 1 << 20), np.uint8), log_rest=rest)


def test_a_disk_that_takes_nothing_for_a_while_holds_up_nobody(tmp_path, monkeypatch):
    reading, writing = os.pipe()
    monkeypatch.setattr(kept_log, "LAST_S", 30.0)
    with KeptLog(tmp_path / "robot-3.log") as kept:
        kept._file = os.fdopen(writing, "wb", 0)
        for length in range(1 << 16, (1 << 20) + 1, 1 << 16):  # more than a pipe holds
            kept.keep(logged(length))
        with os.fdopen(reading, "rb") as disk:
            assert len(disk.read(1 << 20)) == 1 << 20


def test_a_full_disk_ends_the_kept_log_and_not_the_robot(tmp_path, monkeypatch, caplog):
    class Alive:
        async def live(self, kept):
            for length in (1, 2):
                kept.keep(logged(length))
            await asyncio.sleep(0)
            raise Unavailable("its nodes are gone")

    monkeypatch.setattr(daemon_run, "state_of", lambda *_: {})
    with Path("/dev/full").open("wb", 0) as full, KeptLog(tmp_path / "robot-3.log") as kept:
        kept._file = full
        with pytest.raises(Unavailable, match="its nodes are gone"):
            asyncio.run(daemon_run._live(Alive(), kept, tmp_path / "nowhere" / "robot-3.json", None, ()))
    kept_no_further, cannot_write = sorted(caplog.messages, key=lambda words: "cannot write" in words)
    assert "robot-3.log: the log is no longer written: No space left" in kept_no_further
    assert "cannot write" in cannot_write


def a_log(*packets):
    """A driven robot's, to whom these were said, a second apart."""
    told = [ENTRY.encode(type=ENTRY_RECV, t=1000 * n, payload=each) for n, each in enumerate(packets, 1)]
    scenario = Scenario(
        robots=2,
        controller="wheels",
        grid_step_m=0.6,
        gateway_key=PUBLIC[GATEWAY].hex(),
        operator_key=PUBLIC[OPERATOR].hex(),
    )
    return RobotLog(1, MISSION, 500, scenario, b"".join(told))


def test_who_said_what_a_robot_was_told_is_named_and_what_nobody_signed_as_well(monkeypatch):
    stop = order(0, 0, TELL_STOP, who=OPERATOR)
    forged = wheels_order(1, 3, 1, 1, key=OPERATOR)  # in the gateway's name
    strange = order(1, 1, 0, who=9, key=GATEWAY)
    packets = [
        wheels_order(1, 1, 50, 50),
        stop,
        stop,
        wheels_order(1, 2, 60, 60),
        forged,
        strange,
        b"",
        b"\x04",
        stop[:80],
    ]
    found = {each.signer: each for each in count_signed_messages(a_log(*packets))}
    assert set(found) == {"gateway", "operator", NOBODY}
    gateway = found["gateway"]
    assert (gateway.count, gateway.first_s, gateway.last_s) == (2, 0.5, 3.5)
    assert gateway.key == PUBLIC[GATEWAY].hex()
    assert (found["operator"].count, found[NOBODY].count, found[NOBODY].key) == (1, 2, "")
    monkeypatch.setattr(proofs, "MOST_LOOKS", 2)
    assert [(each.signer, each.count) for each in count_signed_messages(a_log(*packets))][2:] == [(proofs.UNKNOWN, 3)]


def test_a_state_that_somebody_wrote_commands_no_terminal_and_makes_no_traceback(tmp_path, capsys):
    robot(tmp_path)
    state = {"pid": os.getpid(), "told_s": 0, "robot": 3, "mission": 7, "scenario": "x\x1b]0;y\x07", "lived_s": 1.0}
    state |= {
        "why_late": "",
        "advice": {},
        "tokens": [{"auditor": 2, "age_s": 1.5, "left_s": 3.5}],
        "safe_mode": False,
        "why_stopped": "",
        "why_ended": "",
        "no_reading": None,
        "refused": [{"auditee": 1, "reason": "output wrong", "times": 1, "last_s_ago": 9.0}],
        "longest_ms": {},
        "tokens_needed": 2,
        "given": [{"auditee": 2, "times": 5, "last_s_ago": 1.25}],
        "frames_refused": {},
    }
    told, state["cpu_share"] = tmp_path / "robot-3.json", 0.1
    state |= {"memory_kb": 109_500, "memory_began_kb": 108_500}
    told.write_text(json.dumps(state | {"log_bytes": 1, "log_bytes_max": 2}))
    assert status(tmp_path / "robot.yaml", as_json=False) == 0
    shown = capsys.readouterr().out
    for words in (
        "x?]0;y?",
        "s ago; the rest is of that time",
        "2 (1.5 s old, for 3.5 s more)",
        "2: 5 times, 1.2 s ago",
        "output wrong, 1 times, 9.0 s ago",
        "109.5 MB of memory, 1.0 MB more than at the start",
    ):
        assert words in shown
    for more in ({}, {"pid": 1.5}, {"pid": 1 << 40}):
        told.write_text(json.dumps(state | more))
        with pytest.raises(UsageError, match=r"not that of a robot|not the state file of a robot"):
            status(tmp_path / "robot.yaml", as_json=False)


def test_status_names_why_a_robot_stands_or_has_ended():
    missing = {"for_s": 1.24, "why": "odometry lost"}
    state = {"safe_mode": False, "why_stopped": "", "why_ended": "", "no_reading": missing}
    assert _state(state, running=True) == "running, but standing still: no reading for 1.2 s: odometry lost"
    assert _state(state, running=False) == "not running: the process was killed, or its machine was switched off"
    assert _state(state | {"why_ended": "its nodes are gone"}, running=False) == "not running: its nodes are gone"
    stopped = state | {"safe_mode": True, "why_stopped": "nobody vouches", "why_ended": "it was told to end"}
    assert _state(stopped, running=True) == "in Safe Mode: nobody vouches"
    assert _state(stopped, running=False) == "not running: it was told to end; it was in Safe Mode: nobody vouches"


def test_numbers_that_nobody_can_show_make_no_traceback(tmp_path):
    told = robot(tmp_path).state_file
    state = {"told_s": 1e300, "pid": 1, "robot": 3, "mission": 1, "scenario": "", "lived_s": 10**400}
    told.write_text(
        json.dumps(state | {"tokens": [], "tokens_needed": 2, "given": [], "refused": [], "longest_ms": {}})
    )
    with pytest.raises(UsageError, match=r"not that of a robot|not the state file of a robot"):
        status(tmp_path / "robot.yaml", as_json=False)


def stopped(heard_ago_ms=(), asked_ago_ms=(), late_ms=0.0, log_full=False):
    """Why a robot says that it is stopped, 60 s after the beginning, that heard and asked others so long ago."""
    now_ms, bti = 60_000, BtiConfig(f_max=1, t_audit_ms=2000, t_val_ms=5000)
    nodes = np.zeros((1, 8), np.uint8)
    fleet = make_fleet(1, bti, np.zeros(1), profile=HARDENED, controller=0, mission_seed=1, snode=nodes, anode=nodes)
    fleet.robot["peers"], fleet.robot["log_full"] = len(heard_ago_ms), log_full
    for k, (heard, asked) in enumerate(zip(heard_ago_ms, asked_ago_ms, strict=True)):
        fleet.peer[0, k]["heard"], fleet.peer[0, k]["asked_ms"] = now_ms - heard, now_ms - asked
    return why_stopped(fleet, now_ms, late_ms)


def test_a_robot_in_safe_mode_says_why_as_far_as_it_knows():
    assert "0 of 2 needed robots vouch for it; it heard 1 robots in the last 5 s" in stopped((100, 6000), (100, 100))
    told = stopped((100, 4900, 9000), (4900, 5100, 1))
    assert "heard 2 robots in the last 5 s and asked 1 of them: the others" in told
    assert "one of its readings was 101 ms late, and its auditors allow 100" in stopped((9, 9), (9, 9), late_ms=101.0)
    assert "its log was full" in stopped(log_full=True)


@pytest.mark.parametrize("write", [lambda path: write_csv(path, []), lambda path: _write(path, "new")])
def test_a_link_that_somebody_laid_is_not_followed(tmp_path, write):
    (tmp_path / "theirs").write_text("old")
    for name in ("table.csv", "table.tmp", f"table.{os.getpid()}.tmp"):
        (tmp_path / name).symlink_to("theirs")
    write(tmp_path / "table.csv")
    assert (tmp_path / "theirs").read_text() == "old"
    assert not (tmp_path / "table.csv").is_symlink()


def test_a_recording_over_a_link_that_somebody_laid_is_refused(tmp_path):
    (tmp_path / "theirs").write_text("old")
    (tmp_path / "run.mcap").symlink_to("theirs")
    for grows in (
        Recorder(tmp_path / "run.mcap"),
        TableFile(tmp_path / "run.mcap", Table(figure="fig", columns=("a",), origin={})),
    ):
        with pytest.raises(Unavailable, match=r"cannot write .*run\.mcap"):
            grows.__enter__()
    assert (tmp_path / "theirs").read_text() == "old"


@pytest.mark.parametrize("words", ["", "1.2.3.4", "host:5", "1.2.3.4:0", "1.2.3.4:65536", "[::1", "1.2.3.4:٣", ":5"])
def test_what_is_no_address_is_said(words):
    with pytest.raises(UsageError, match="is not an address"):
        parse_address(words)


def a_global_address() -> str:
    """An IPv6 address of this machine's that a group can be reached from; "" for none."""
    text = udp_radio.ADDRESSES.read_text() if udp_radio.ADDRESSES.exists() else ""
    known = [line.split()[::3] for line in text.splitlines()]
    return next((str(ipaddress.IPv6Address(bytes.fromhex(each))) for each, scope in known if scope == "00"), "")


@pytest.mark.skipif(not a_global_address(), reason="no IPv6 here but loopback's")
def test_an_ipv6_group_is_heard_and_spoken_to_from_the_robots_own_address():
    ours = a_global_address()
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe, pytest.raises(Unavailable):
        probe.bind((ours, 0))
        port = probe.getsockname()[1]
        UdpRadio(f"[fd00:dead::1]:{port}", [f"[{ours}]:{port}"], f"[ff15::4410]:{port}")
    group = f"[ff15::4410]:{port}"
    radio = UdpRadio(f"[{ours}]:{port}", [f"[{ours}]:{port}"], group)
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"stranger", ("ff15::4410", port))
            radio.send(b"ours")  # it is its own peer here, for want of a second address
            time.sleep(0.1)
            heard = heard_by(radio)
            refused = radio.refused
    finally:
        radio.close()
    assert (heard, refused["foreign"]) == ([b"ours"], 1)


def heard_by(radio: UdpRadio) -> list[bytes]:
    """All that waits; a look that finds nothing may have dropped something."""
    heard = []
    while select.select([radio], [], [], 0.05)[0]:
        if packet := radio.take():
            heard.append(packet)
    return heard


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_radio_hears_its_peers_alone_and_nothing_too_long(host):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    shown = f"[{host}]" if ":" in host else host
    with socket.socket(family, socket.SOCK_DGRAM) as peer, socket.socket(family, socket.SOCK_DGRAM) as stranger:
        for each in (peer, stranger):
            each.bind((host, 0))
        port = free_udp_port(host)
        radio = UdpRadio(f"{shown}:{port}", [f"{shown}:{peer.getsockname()[1]}"])
        try:
            stranger.sendto(b"\x01", (host, port))
            for packet in (bytes(PACKET_MAX + 1), b"", b"\x02" * PACKET_MAX, b"\x03"):
                peer.sendto(packet, (host, port))
            heard = heard_by(radio)
            assert heard == [b"\x02" * PACKET_MAX, b"\x03"]
            assert radio.refused == {"foreign": 1, "too_large": 1, "empty": 1, "too_many": 0, "waiting": 0}
            radio.send(b"\x04")
            peer.settimeout(10)
            assert peer.recvfrom(10)[0] == b"\x04"
        finally:
            radio.close()


@contextlib.contextmanager
def a_radio_and_its_peers(silent: int, may: PeerLimits) -> Iterator[tuple[UdpRadio, Callable[..., None], list[Any]]]:
    """A radio, what says something to it so often, and two of its peers' sockets, and a stranger's."""
    with contextlib.ExitStack() as stack:
        made = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(4)]
        for each in made:
            each.bind(("127.0.0.1", 0))
        here = made[3].getsockname()
        made.pop().close()
        peers = [f"127.0.0.1:{each.getsockname()[1]}" for each in made[:2]]
        peers += [f"127.0.0.2:{4410 + k}" for k in range(silent)]
        radio = stack.enter_context(contextlib.closing(UdpRadio(f"127.0.0.1:{here[1]}", peers, may=may)))

        def say(who: socket.socket, words: bytes, times: int = 1) -> None:
            for _ in range(times):
                who.sendto(words, here)

        yield radio, say, made


@pytest.mark.parametrize("silent", [0, 62])
def test_who_floods_a_radio_waits_for_itself_and_holds_up_another_by_one_frame(silent):
    with a_radio_and_its_peers(silent, PeerLimits()) as (radio, say, (flood, it, stranger)):
        say(flood, b"flood", 3000)
        say(stranger, b"stranger", 700)
        for word in (b"one", b"two"):
            say(it, word)
        assert [radio.take() for _ in range(4)] == [b"flood", b"one", b"flood", b"two"]
        waited = 2 + len(heard_by(radio))
        assert LEAST_WAITING <= waited < 3000
        assert radio.refused["waiting"] == 3000 - waited
        assert radio.refused["foreign"] == 700


def test_of_each_peer_as_many_frames_are_read_as_its_a_node_lets_through(monkeypatch):
    now_s = [1000.0]
    monkeypatch.setattr(udp_radio.time, "monotonic", lambda: now_s[0])
    state, audit = b"\x01" + bytes(26), b"\x80" + bytes(26)
    may = PeerLimits(packets_per_s=40, send_us_per_s=300, send_capacity_us=400, fixed_us=73, ns_per_byte=1000)
    with a_radio_and_its_peers(0, may) as (radio, say, (flood, it, _)):
        say(flood, state, 20)
        assert heard_by(radio) == [state] * 4, "each takes 100 us"
        assert radio.refused["too_many"] == 16
        say(flood, audit, 100)
        say(it, state)
        assert sorted(heard_by(radio)) == [state, *[audit] * 20], "of 40 a second"
        now_s[0] += 0.5
        assert heard_by(radio) == [], "who has had its allowance wakes nobody"
        assert radio.take() == audit
        assert heard_by(radio) == [audit] * 19
        now_s[0] += 60
        assert radio.take() == audit
        assert len(heard_by(radio)) == 39


def test_a_second_radio_at_the_same_address_is_refused():
    with a_radio_and_its_peers(0, PeerLimits()) as (radio, _, (peer, *_)):
        with pytest.raises(Unavailable, match="in use") as taken:
            UdpRadio("{}:{}".format(*radio._here), ["{}:{}".format(*peer.getsockname())])
        assert taken.value.hint.startswith("use another port")


def test_radios_of_a_multicast_group_hear_each_other_and_not_themselves_nor_strangers():
    port = free_udp_port()
    group = f"239.77.1.2:{port}"
    here = [f"127.0.0.{k}:{port}" for k in (2, 3, 4)]
    one, two = UdpRadio(here[0], [here[1]], group), UdpRadio(here[1], [here[0]], group)
    stranger = UdpRadio(here[2], [here[0]], group)
    try:
        for radio, packet in ((one, b"one"), (two, b"two"), (stranger, b"stranger")):
            radio.send(packet)
        assert (heard_by(one), heard_by(two)) == ([b"two"], [b"one"])
        assert one.refused["foreign"] == two.refused["foreign"] == 2
    finally:
        for radio in (one, two, stranger):
            radio.close()
    with pytest.raises(UsageError, match="is not a multicast group"):
        UdpRadio(here[0], [here[1]], f"127.0.0.9:{port}")
    with pytest.raises(UsageError, match="not all robots use port"):
        UdpRadio(here[0], ["127.0.0.3:1"], group)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"x_m": 1.0, "y_m": 2.0, "vx_mps": 0.0, "vy_mps": 0.0}, SENSOR.size),
        (b"\x40 a lidar of one's own", 22),
        (b"", "sense returned b''"),
        (bytes(PACKET_MAX + 1), "sense returned b'"),
        ({"x_m": 1.0}, "sense returned {'x_m': 1.0}"),
        (None, "sense returned None"),
        ({"x_m": 10**400}, "sense returned {'x_m': 1000"),
        ({"x_m": Decimal("NaN")}, "sense returned {'x_m': Decimal('NaN')}"),
        ({"x_m": math.nan, "y_m": 2.0, "vx_mps": 0.0, "vy_mps": 0.0}, NoReading("x_m is nan")),
        ({"x_m": 1.0, "y_m": 2e6, "vx_mps": 0.0, "vy_mps": 0.0}, NoReading("y_m is 2e+06")),
        (OSError(5, "no answer"), NoReading("[Errno 5] no answer")),
    ],
)
async def test_a_driver_says_a_readings_fields_or_its_bytes(said, told):
    class Base(Driver):
        def sense(self):
            if isinstance(said, OSError):
                raise said
            return said

    with contextlib.closing(OwnDriver(Base(1), dispatch.BUNDLED["flock"])) as driver:
        if isinstance(told, int):
            assert len(await driver.sense(7, 1.0)) == told
            return
        with pytest.raises(OwnMistake if isinstance(told, str) else NoReading) as error:
            await driver.sense(7, 1.0)
        assert str(error.value).startswith(str(told))
        assert len(str(error.value)) < 100


@pytest.mark.parametrize("kind", [StopIteration, GeneratorExit, asyncio.CancelledError])
async def test_what_ends_a_task_is_a_mistake_where_a_driver_raises_it(kind):
    class Base(Driver):
        def sense(self):
            raise kind

        def drive(self, command):
            raise kind

    with contextlib.closing(OwnDriver(Base(1), dispatch.BUNDLED["flock"])) as driver:
        with pytest.raises(RuntimeError, match=kind.__name__) as error:
            await driver.sense(7, 1.0)
        assert any(packet.name == "sense" and packet.path == Path(__file__) for packet in error.traceback)
        driver.drive(ACCELERATION.encode(id=1, t=7, ax_mps2=0.0, ay_mps2=0.0))
        with pytest.raises(RuntimeError, match=kind.__name__):
            while True:
                await driver.sense(7, 1.0) if driver._thread._failed else await asyncio.sleep(0.01)


async def test_a_call_that_has_answered_does_not_hang_for_whoever_asks_again_at_once():
    thread, running = DriverThread(lambda: None), []
    with contextlib.closing(SimpleNamespace(close=lambda: thread.close(lambda: None))):
        answer = thread._submit("sense", lambda: time.sleep(0.05))
        answer.add_done_callback(lambda _: running.append(thread._running))
        await asyncio.wrap_future(answer)
    assert running == [""]


@pytest.mark.parametrize(
    ("base", "method", "error", "hint"),
    [
        ("", "sense", "Base in wheels.py is not a Driver", "derive it from phalanx.daemon.driver.Driver"),
        (
            "(Driver)",
            "drive",
            "Base in wheels.py has a method drive, but no method stop",
            "add stop: nothing else stops its motors",
        ),
    ],
)
def test_a_driver_that_is_none_or_cannot_stop_its_motors_is_refused(tmp_path, monkeypatch, base, method, error, hint):
    monkeypatch.chdir(tmp_path)
    text = f"from phalanx.daemon.driver import Driver\nclass Base{base}:\n    def sense(self): ...\n"
    Path("wheels.py").write_text(text + f"    def {method}(self, command=None): ...\n")
    settings = robot(Path(), ROBOT.replace("python:wheels.py", "python:wheels.py:Base"))
    with pytest.raises(UsageError) as refused:
        make_driver(settings, dispatch.BUNDLED["flock"])
    assert (str(refused.value), refused.value.hint) == (error, hint)


def test_a_radio_of_mixed_addresses_or_of_no_address_of_ours_is_said():
    with pytest.raises(UsageError, match="not all IPv4 or all IPv6"):
        UdpRadio("127.0.0.1:4410", ["[::1]:4411"])
    with pytest.raises(Unavailable, match=r"cannot listen on 192\.0\.2\.1:4410") as nowhere:
        UdpRadio("192.0.2.1:4410", ["127.0.0.1:4411"])
    assert nowhere.value.hint == "use an address of this machine"


@contextlib.contextmanager
def lived(monkeypatch, *, waits):
    """A robot of which a reading is due at 1250 and then each 250 ms, its clock, and when it read."""
    life = Life.__new__(Life)
    clock, read_ms = SimpleNamespace(ms=1000, asked_ms=0.0), []
    clock.now_ms = lambda: clock.ms
    life.id, life.scenario = 1, SimpleNamespace(bti=BtiConfig(f_max=1))
    life.clock, life._lateness, life.why_late = clock, Lateness(), ""
    life._packet_or_advice, life._advised, life.waits_for_advice = asyncio.Event(), False, waits
    life.radio = SimpleNamespace(take=bytes)
    life.longest_ms = dict.fromkeys(("late", "reading"), 0.0)
    life.runtime = SimpleNamespace(input_ms=1250, check_ms=9999, wake_ms=9999, audit_ms=9999, due_ms=1250)

    async def read(runtime, now_ms):
        read_ms.append(now_ms)
        runtime.input_ms = runtime.due_ms = runtime.input_ms + 250
        return []

    monkeypatch.setattr(life, "_read", read)
    try:
        yield life, clock, read_ms
    finally:
        life._lateness.close()


async def test_new_advice_is_acted_on_as_early_as_auditors_allow_and_once(monkeypatch):
    with lived(monkeypatch, waits=True) as (life, clock, read_ms):
        assert await life._turn() == 250  # nothing is new
        life.advised()
        assert life._packet_or_advice.is_set()
        assert await life._turn() == 160
        clock.ms = 1160
        assert await life._turn() == 0
        assert await life._turn() == 1500 - 1160  # what is not new waits for the grid
        assert read_ms == [1160]
        assert life.longest_ms["late"] == 0


async def test_who_waits_for_nobody_reads_early_so_that_it_may_be_late_by_more(monkeypatch):
    with lived(monkeypatch, waits=False) as (life, clock, read_ms):
        assert await life._turn() == 180
        clock.ms = 1180
        assert await life._turn() == 0
        clock.ms = 1500 + 60
        await life._turn()
        assert read_ms == [1180, 1560]
        assert life.longest_ms["late"] == 60


async def test_a_late_reading_says_what_took_the_time_and_the_latest_is_told(monkeypatch, caplog):
    with lived(monkeypatch, waits=False) as (life, clock, _):
        await life._turn()  # and would sleep for 180 ms
        clock.ms, clock.asked_ms = 1250 + 51, 40.0
        await life._turn()
        assert life.why_late.startswith("a reading was 51 ms late: waiting took ")
        assert "180 sleeping as planned" in life.why_late
        assert "40 waiting for trusted nodes" in life.why_late
        clock.ms = 1500 + 101
        await life._turn()
        assert life.why_late.startswith("a reading was 101 ms late, and its auditors allow 100 ms: a reading took ")
        clock.ms = 1750 + 101
        await life._turn()  # no later than the last
        assert len(caplog.messages) == 2


async def test_in_safe_mode_a_robot_reads_no_frame_any_more(monkeypatch):
    with lived(monkeypatch, waits=False) as (life, _, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        calls = []
        hardware = SimpleNamespace(stop=lambda: calls.append("stop"), alive=lambda: calls.append("alive"))
        life.radio, life._hardware, life.id = radio, hardware, 1
        life.fleet, life.runtime.in_safe_mode = None, False
        monkeypatch.setattr(life_module, "why_stopped", lambda *_: "so")
        loop = asyncio.get_running_loop()

        async def until_stopped(_: object) -> None:
            assert loop.remove_reader(radio), "it listens"
            loop.add_reader(radio, life._packet_or_advice.set)

        monkeypatch.setattr(life, "_until_stopped", until_stopped)
        await life.live(None)
        assert (life.why_stopped, loop.remove_reader(radio)) == ("so", False)
        assert "stop" in calls


def numbers_of(lateness) -> dict[str, int]:
    return {words: int(number) for number, words in re.findall(r"(\d+) (?:ms: )?([a-z]+)", lateness.why())}


def test_why_a_thread_is_late_is_told_apart():
    lateness = Lateness()
    try:
        lateness.turn(0.0)
        until_ns = time.thread_time_ns() + 30_000_000
        while time.thread_time_ns() < until_ns:
            pass
        gc.collect()
        lateness.turn(0.0)
        computed = numbers_of(lateness)
        assert computed["computing"] >= 30
        assert computed["of"] > 0, "it collected"
        lateness.did("waiting", 10.0)
        time.sleep(0.06)
        lateness.turn(0.0)
        assert numbers_of(lateness)["other"] >= 40
        assert numbers_of(lateness)["computing"] < 30
    finally:
        lateness.close()
    assert not [each for each in gc.callbacks if getattr(each, "__self__", None) is lateness]


def test_who_has_no_processor_says_that_others_had_it():
    ours = os.sched_getaffinity(0)
    lateness = Lateness()
    os.sched_setaffinity(0, {min(ours)})
    other = subprocess.Popen((sys.executable, "-c", "print(flush=True)\nwhile True: pass"), stdout=subprocess.PIPE)
    try:
        other.stdout.read(1)
        lateness.turn(0.0)
        until_ns = time.thread_time_ns() + 60_000_000
        while time.thread_time_ns() < until_ns:
            pass
        lateness.turn(0.0)
        assert numbers_of(lateness)["kept"] > 5
    finally:
        os.sched_setaffinity(0, ours)
        other.kill()
        other.communicate()
        lateness.close()


def test_a_pipe_in_place_of_what_a_robot_tells_keeps_nobody_waiting(tmp_path):
    os.mkfifo(tmp_path / "robot-1.json")
    with pytest.raises(UsageError, match="is not the state file of a robot"):
        fuse_matches(tmp_path / "robot-1.json")


@pytest.mark.parametrize("name", ["flock", "guard", "wheels"])
def test_where_there_was_no_reading_controllers_move_nothing_and_send_nothing(name):
    declared = dispatch.BUNDLED[name]
    scenario = parse_scenario(f"controller: {name}\nrobots: 3\n".encode(), "mission.yaml")
    controller = compiled(dispatch.NUMBERS[name], params_of(scenario))(1)
    reading = no_reading(declared.reads, 1, 250)
    assert len(reading) == declared.reads.size
    for step in range(12):
        (act,) = controller.on_input(step, 250 * step, reading)
        command = declared.commands.decode(act.payload)
        assert {command[key] for key in command if key not in ("id", "t")} == {0}
