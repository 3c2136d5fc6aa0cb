"""A gateway before robots that are processes of their own: signed orders by radio, and what pages show of them."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import pytest

from commands import called
from ordered import KEYS, PUBLIC, robot
from phalanx.bti.refusal import Refusal
from phalanx.cli.credentials import read_signing_key
from phalanx.daemon.evidence import read_robot_log
from phalanx.daemon.gateway_node import GatewayNode, gateway_limits
from phalanx.daemon.proofs import NOBODY, count_signed_messages, mac_of, unsealed
from phalanx.daemon.run import mission_of
from phalanx.daemon.settings import read_robot
from phalanx.daemon.swarm import LAST_TIMES, YEAR_MS, RobotSwarm
from phalanx.daemon.swarm_file import read_swarm
from phalanx.daemon.trusted import program
from phalanx.errors import Unavailable, Unknown, UsageError
from phalanx.net import QrkeyClient
from phalanx.net.keyring import Keys, pem
from phalanx.net.mission_key import encode_mission_key_file, read_mission_key
from phalanx.net.serial_line import open_line
from phalanx.net.serial_node import SerialNode
from phalanx.robot import Led, Point
from phalanx.wire.driven import GATEWAY, OPERATOR, ORDER, TELL_WHEELS, WHEELS_MEMORY
from phalanx.wire.table import AUDIT_FRAGMENT, AUDIT_TOKEN, BOARD, KEY_BYTES, REQUEST, SEAL, TOKEN, WHEELS_STATE
from serving import up_here
from waiting import eventually, wait_until

pytestmark = [pytest.mark.waits, pytest.mark.timeout(300)]
PHALANX = (sys.executable, "-m", "phalanx", "--log-level", "error")
MISSION = """controller: wheels
robots: 3
grid_step_m: 0.6
contact_m: 0.08
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 200, steps_per_state: 2, delta_ms: 95, skew_ms: 200}
"""
NAMED = f"gateway_key: {PUBLIC[GATEWAY].hex()}\noperator_key: {PUBLIC[OPERATOR].hex()}\n"
MOST_FRAMES = 30  # beacons among them: one a second
HCKPT, OTHER = bytes(range(20)), bytes(20)
STATE = {"t": 1, "x_mm": 500.0, "y_mm": 600.0, "direction_deg": 90.0, "red": 1, "green": 2, "blue": 3}


class Robots:
    """Two radios, of robots 1 and 2, whose controllers hear what comes."""

    def __init__(self):
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
        for each in self.sockets:
            each.bind(("127.0.0.1", 0))
            each.settimeout(5)
        self.at = [f"127.0.0.1:{each.getsockname()[1]}" for each in self.sockets]
        self.sockets.pop().close()  # that is where the gateway listens
        self.here = self.at.pop()
        self.controllers = [robot(1, mission=1), robot(2, mission=1)]

    def say(self, which: int, packet: bytes) -> None:
        host, _, port = self.here.partition(":")
        self.sockets[which].sendto(packet, (host, int(port)))

    def obeys(self, which: int, is_so) -> bool:
        """Whether what comes leads there. The robot's clock stands, as a busy machine would make orders late."""
        this = self.controllers[which]
        for _ in range(MOST_FRAMES):
            if is_so(WHEELS_MEMORY.decode(this.encode())):
                return True
            this.on_recv(0, self.sockets[which].recv(2048))
            this.on_input(0, 0, b"")
        return False


@pytest.fixture
def robots():
    made = Robots()
    yield made
    for each in made.sockets:
        each.close()


@pytest.fixture
def file(tmp_path, robots):
    """A swarm's file and all that it names."""
    keys = Keys.new("test")
    for rob_id in (1, 2):
        keys.provision(rob_id, "2026-01-01")
    (tmp_path / "key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))
    (tmp_path / "mission.yaml").write_text(MISSION + NAMED)
    at = [{"robot": rob_id, "at": where} for rob_id, where in enumerate(robots.at, 1)]
    said = {"mission": "mission.yaml", "key": "key.json", "here": robots.here, "robots": at}
    for name, who in (("gateway", GATEWAY), ("operator", OPERATOR)):
        (tmp_path / f"{name}.pem").write_bytes(pem(KEYS[who]))
        said[name] = f"{name}.pem"
    path = tmp_path / "swarm.yaml"
    path.write_text(json.dumps(said, indent=1))
    return path


@pytest.fixture
def protected(file):
    """A swarm's file with trusted nodes of the gateway's own, and the mission's key."""
    keys = Keys.new("test")
    for rob_id in (1, 2, 9):
        master = keys.provision(rob_id, "2026-01-01")
    file.with_name("gateway.bin").write_bytes(BOARD.encode(id=9, master=master))
    file.with_name("key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))
    nodes = {"trusted": "process:gateway.flash", "number": 9, "board": "gateway.bin"}
    file.write_text(json.dumps(json.loads(file.read_text()) | nodes))
    return file, unsealed(master, read_mission_key(file.with_name("key.json"), 9))


def claims(robots, which, auditee, hckpt):
    """A robot begins to show what it wants a token for."""
    head = bytearray(REQUEST.size)
    head[REQUEST.at("hckpt") : REQUEST.at("hckpt") + len(hckpt)] = hckpt
    robots.say(which, AUDIT_FRAGMENT.encode(src=auditee, dst=1, request=1, index=0, count=1, bytes=bytes(head)))


def vouches(robots, which, key, auditor, auditee, t, hckpt):
    """A robot says a token for another."""
    mac = mac_of(key, TOKEN.encode(auditor=auditor, auditee=auditee, t=t, hckpt=hckpt))
    robots.say(which, AUDIT_TOKEN.encode(src=auditor, dst=auditee, request=1, t=t, mac=mac))


def both_seen(swarm, robots):
    """Both robots are heard, and all that each of them said before."""
    for which in (0, 1):
        robots.say(which, WHEELS_STATE.encode(id=which + 1, **STATE))
    wait_until(lambda: len(swarm.robots()) == 2)


@contextmanager
def gateway(file, clock=time.time):
    with RobotSwarm(read_swarm(file), KEYS[GATEWAY], KEYS[OPERATOR], clock) as swarm:
        yield swarm


def waiting(radio: socket.socket) -> Iterator[bytes]:
    """What has come and waits."""
    with suppress(BlockingIOError):
        while True:
            yield radio.recv(2048)


def waiting_now(radio: socket.socket) -> list[bytes]:
    """The same, of a radio that waits otherwise."""
    radio.setblocking(False)
    came = list(waiting(radio))
    radio.settimeout(5)
    return came


class TestFile:
    @pytest.mark.parametrize(
        ("was", "is_now", "trouble"),
        [
            ("controller: wheels", "controller: flock", "controller: flock"),
            (NAMED, "", "has no gateway_key and operator_key"),
            (PUBLIC[GATEWAY].hex(), PUBLIC[OPERATOR].hex(), "names another gateway_key"),
            (PUBLIC[OPERATOR].hex(), "ab", "operator_key is 'ab'"),
            ("grid_step_m: 0.6", "grid_step_m: 6", "area_m has no room"),
        ],
        ids=["flock", "nobody", "another", "short", "large"],
    )
    def test_what_is_wrong_with_the_mission_is_said_before_anybody_is_told_anything(self, file, was, is_now, trouble):
        mission = file.with_name("mission.yaml")
        mission.write_text(mission.read_text().replace(was, is_now))
        ended = called("up", "--swarm", str(file), "--duration", "0.1")
        assert (ended.returncode, ended.stdout) == (2, "")
        assert trouble in ended.stderr
        assert not file.with_name("mission-1.said").exists()

    def test_a_robot_that_the_missions_key_is_not_for_is_refused(self, file):
        file.write_text(file.read_text().replace('"robot": 2', '"robot": 3'))
        with pytest.raises(UsageError, match="no key for robot 3"):
            read_swarm(file)

    def test_a_group_on_which_orders_do_not_work_is_refused(self, file):
        driven = {"robot": 1, "mission": "mission.yaml", "key": "key.json", "driver": "python:none.py:None"}
        radio = {"here": "127.0.0.1:4410", "peers": ["127.0.0.2:4410"], "group": "239.1.2.3:4410"}
        file.with_name("robot.yaml").write_text(json.dumps(driven | {"radio": radio}))
        with pytest.raises(UsageError, match="a group"):
            mission_of(read_robot(file.with_name("robot.yaml")))

    @pytest.mark.parametrize(
        ("said", "trouble"),
        [
            ({"trusted": "process:g.flash"}, "trusted nodes with number 0"),
            ({"number": 9}, "trusted nodes with number 9"),
            ({"trusted": "process:g.flash", "number": 2}, "trusted nodes with number 2"),
            ({"packets": "sealed"}, "packets: sealed, without trusted"),
            ({"trusted": "carrier:pigeon", "number": 9}, "carrier:pigeon"),
        ],
    )
    def test_trusted_nodes_that_cannot_be_a_gateways_are_told_of(self, file, said, trouble):
        file.write_text(json.dumps(json.loads(file.read_text()) | said))
        with pytest.raises(UsageError, match=trouble):
            assert read_swarm(file).own

    def test_real_robots_are_as_many_as_they_are(self, file):
        ended = called("up", "--swarm", str(file), "--robots", "4")
        assert ended.returncode == 2
        assert "--swarm with --robots" in ended.stderr


class TestSwarm:
    def test_a_robot_is_there_from_when_it_was_heard_and_only_from_where_it_is(self, file, robots):
        with gateway(file) as swarm:
            robots.say(1, WHEELS_STATE.encode(id=1, **STATE))  # the second, in the first one's name
            robots.say(1, b"\x07nonsense")
            robots.say(1, WHEELS_STATE.encode(id=2, **STATE | {"x_mm": 1e6}))
            wait_until(swarm.robots)
            (there,) = swarm.robots()
            assert there.at == Point(2000.0, 600.0), "inside the area, wherever a liar says that it is"
            assert (there.direction_deg, there.led) == (90, Led(1, 2, 3))
            with pytest.raises(Unknown):
                swarm.drive("DECAFBAD00000001", 50, 50)
            swarm.set_led(there.address, Led(7, 8, 9))
            assert robots.obeys(1, lambda state: state["green"] == 8)
            swarm.drive(there.address, 40, -400)
            assert robots.obeys(1, lambda state: (state["left"], state["right"]) == (40, -100))
            swarm.follow(there.address, [Point(100.0, 200.0)], 50.0)
            assert robots.obeys(1, lambda state: state["count"] == 1)
        assert robots.obeys(1, lambda state: state["count"] == 0), "under way by our word, at our end"

    def test_who_follows_the_longest_route_when_a_gateway_ends_is_told_more_than_once_to_stop(self, file, robots):
        route = [Point(100.0 * k, 200.0) for k in range(32)]
        with gateway(file) as swarm:
            for which in (0, 1):
                robots.say(which, WHEELS_STATE.encode(id=which + 1, **STATE))
            wait_until(lambda: len(swarm.robots()) == 2)
            for each in swarm.robots():
                swarm.follow(each.address, route, 50.0)
            assert all(robots.obeys(which, lambda state: state["count"] == 32) for which in (0, 1))
        for which, each in enumerate(robots.sockets):
            each.setblocking(False)
            told = [ORDER.decode(packet)["action"] for packet in waiting(each)]
            assert told.count(TELL_WHEELS) == LAST_TIMES, which

    def test_a_go_is_said_though_this_gateway_said_no_stop(self, file, robots):
        with gateway(file) as swarm:
            swarm.hold()
            assert robots.obeys(0, lambda state: state["held"] == 1 << OPERATOR)
        with gateway(file) as swarm:
            swarm.release()
            assert robots.obeys(0, lambda state: state["held"] == 0)

    def test_the_operators_stop_is_heard_by_robots_that_never_spoke_and_ends_at_go(self, file, robots):
        with gateway(file) as swarm:
            swarm.hold()
            assert all(robots.obeys(which, lambda state: state["held"] == 1 << OPERATOR) for which in (0, 1))
            swarm.release()
            assert all(robots.obeys(which, lambda state: state["held"] == 0) for which in (0, 1))

    def test_no_flood_of_what_costs_its_nodes_time_holds_up_the_operators_stop(self, protected, robots, monkeypatch):
        file, _ = protected
        looked_at = []

        def slowly(*_):  # as a board on a serial line does
            looked_at.append(time.sleep(0.1))
            return False

        monkeypatch.setattr(GatewayNode, "is_token", slowly)
        with gateway(file) as swarm:
            for t in range(1, 65):
                robots.say(0, AUDIT_TOKEN.encode(src=1, dst=2, request=1, t=t, mac=bytes(8)))
            wait_until(lambda: looked_at)
            robots.say(1, WHEELS_STATE.encode(id=2, **STATE))
            wait_until(swarm.robots)
            assert len(looked_at) < 32, "nor does it keep others from being seen"
            swarm.hold()
            began_s = time.monotonic()
            assert robots.obeys(1, lambda state: state["held"] == 1 << OPERATOR)
            assert time.monotonic() - began_s < 1

    def test_a_gateway_is_obeyed_after_each_start_whatever_its_clock_says(self, file, robots):
        robots.say(0, WHEELS_STATE.encode(id=1, **STATE))
        for nth, clock_s in enumerate((2e9, 1e9, 2e9 + 5), 1):
            with gateway(file, lambda now_s=clock_s: now_s) as swarm:
                robots.say(0, WHEELS_STATE.encode(id=1, **STATE))
                wait_until(swarm.robots)
                swarm.set_led(swarm.robots()[0].address, Led(nth, 0, 0))
                assert robots.obeys(0, lambda state, nth=nth: state["red"] == nth)
                swarm.hold()
                assert robots.obeys(0, lambda state: state["held"] == 1 << OPERATOR)
                swarm.release()
                assert robots.obeys(0, lambda state: state["held"] == 0)
        assert int(file.with_name("mission-1.said").read_text()) == 2e12 + 2 * YEAR_MS

    def test_a_start_that_does_not_know_what_was_said_warns_of_it_once(self, file, caplog):
        for _ in range(2):
            with gateway(file):
                pass
        (words,) = caplog.messages
        assert words.startswith("mission 1 is new here: ")
        assert "if another gateway, or a copy of this folder, drove robots in this mission" in words.lower()

    @pytest.mark.parametrize("kept", ["soon", "-5", str(1 << 64), "9" * 5000])
    def test_what_was_said_is_not_guessed_if_its_file_is_damaged(self, file, kept):
        file.with_name("mission-1.said").write_text(kept)
        with pytest.raises(Unavailable, match="cannot read"):
            gateway(file).__enter__()

    def test_without_nodes_of_its_own_it_shows_no_shields(self, file, robots):
        with gateway(file) as swarm:
            robots.say(0, WHEELS_STATE.encode(id=1, **STATE))
            wait_until(swarm.robots)
            assert (swarm.shields(), swarm.attacks()) == ((), ())
            assert "no shields" in swarm.unchecked

    def test_shields_are_the_tokens_that_came_by_and_were_made_by_a_robots_nodes(self, protected, robots):
        file, key = protected
        with gateway(file) as swarm:
            claims(robots, 1, 2, HCKPT)
            claims(robots, 1, 1, bytes(20))  # the second, in the first one's name
            both_seen(swarm, robots)
            vouches(robots, 0, key, 1, 2, 5, OTHER)  # for a checkpoint that it did not show
            vouches(robots, 0, bytes(20), 1, 2, 5, HCKPT)  # with another mission's key
            vouches(robots, 0, key, 2, 1, 5, HCKPT)  # in another's name
            vouches(robots, 0, key, 1, 1, 5, HCKPT)
            vouches(robots, 0, key, 1, 2, 9, HCKPT)
            vouches(robots, 0, key, 1, 2, 9, HCKPT)  # again
            vouches(robots, 0, key, 1, 2, 8, HCKPT)
            robots.say(0, WHEELS_STATE.encode(id=1, **STATE | {"red": 77}))  # behind all of it
            wait_until(lambda: len(swarm.robots()) == 2 and swarm.robots()[0].led.red == 77)
            audits = swarm.new_audits()
            first, second = swarm.shields()
            assert (first.vouchers, first.safe_mode, second.safe_mode, second.needed) == ((), False, False, 2)
            ((auditor, left_s),) = second.vouchers
            assert [auditor] == [audit.auditor for audit in audits] == [first.address]
            assert 2 < left_s <= 2.5
            # Neither speaks any more, and one token is not enough.
            wait_until(lambda: all(shield.safe_mode for shield in swarm.shields()))
            assert (swarm.attacks(), swarm.new_audits()) == ((), [])
            with pytest.raises(Unknown):
                swarm.compromise(first.address, "hijack")

    def test_true_tokens_that_were_held_back_show_nobody_as_protected_for_longer(self, protected, robots):
        file, key = protected
        with gateway(file) as swarm:
            claims(robots, 1, 2, HCKPT)
            both_seen(swarm, robots)

            def left_s(t, red):
                vouches(robots, 0, key, 1, 2, t, HCKPT)
                robots.say(0, WHEELS_STATE.encode(id=1, **STATE | {"red": red}))  # behind it
                wait_until(lambda: len(swarm.robots()) == 2 and swarm.robots()[0].led.red == red)
                return sum(left_s for _, left_s in swarm.shields()[1].vouchers)

            began_s = time.monotonic()
            assert left_s(50_000, 10) > 1
            time.sleep(1.2)
            # Its robot asked for it soon after the first, and it is shown now: as its nodes do, we count from then.
            assert 0 < left_s(50_100, 20) <= 2.5 - 1.1
            new = 50_000 + int(1000 * (time.monotonic() - began_s))
            assert left_s(new, 30) > 1.5

    def test_no_seal_is_older_than_one_of_a_start_before(self, protected, robots):
        file, _ = protected
        file.write_text(json.dumps(json.loads(file.read_text()) | {"packets": "sealed"}))
        newest = 0
        for _ in range(3):
            with gateway(file) as swarm:
                swarm.hold()
                seals = [SEAL.decode(robots.sockets[0].recv(2048)[-SEAL.size :]) for _ in range(3)]
            assert {each["src"] for each in seals} == {9}
            assert min(each["t"] for each in seals) > newest
            newest = max(each["t"] for each in seals)
            for packet in waiting_now(robots.sockets[0]):
                newest = max(newest, SEAL.decode(packet[-SEAL.size :])["t"])

    @pytest.mark.parametrize("whose", [1, None])
    def test_a_file_that_holds_anothers_nodes_or_none_is_left_as_it_is(self, protected, whose):
        file, _ = protected
        flash = file.with_name("gateway.flash")
        flash.touch(0o600)
        if whose:
            line = open_line(f"process:{program()},{flash}", "-", "0,0")
            node = SerialNode(line)
            node.make(gateway_limits(read_swarm(file).scenario))
            node.load_master(bytes(KEY_BYTES), whose)
            node.close()
        else:
            flash.write_text("-----BEGIN PRIVATE KEY-----")
        before = flash.read_bytes()
        with pytest.raises(UsageError, match="does not belong to this gateway's nodes"), gateway(file):
            pass
        assert flash.read_bytes() == before

    def test_what_is_not_sealed_was_not_said(self, protected, robots, monkeypatch):
        opened, open_frame = [], GatewayNode.open
        monkeypatch.setattr(GatewayNode, "open", lambda node, raw: opened.append(open_frame(node, raw)) or opened[-1])
        file, _ = protected
        file.write_text(json.dumps(json.loads(file.read_text()) | {"packets": "sealed"}))
        with gateway(file) as swarm:
            robots.say(0, WHEELS_STATE.encode(id=1, **STATE))
            robots.say(0, b"short")
            robots.say(0, bytes(SEAL.size))
            wait_until(lambda: len(opened) == 3)
            assert not any(opened)
            assert swarm.robots() == []


@pytest.mark.parametrize("more", [("--sealed",), pytest.param((), marks=pytest.mark.long)], ids=["sealed", "plain"])
async def test_a_phone_drives_processes_and_the_operator_stops_them_all(tmp_path, more):
    (tmp_path / "mission.yaml").write_text(MISSION)
    kept = tmp_path / "kept"
    words = ("robot", "arena", str(tmp_path / "mission.yaml"), "--duration", "9", "--keep", str(kept), "--json", *more)
    arena = subprocess.Popen((*PHALANX, *words), stdout=subprocess.PIPE, text=True)
    try:
        await eventually((kept / "robot-3.json").exists, 120)  # their mission has begun
        settings = read_swarm(kept / "swarm.yaml")
        keys = [read_signing_key(kept / name) for name in ("gateway.pem", "operator.pem")]
        with RobotSwarm(settings, *keys) as swarm:
            async with (
                up_here(swarm, broker="mosquitto", qrkey=True) as (gateway, ready),
                QrkeyClient(ready["qrkey_url"]) as phone,
            ):
                await eventually(lambda: [s.safe_mode for s in swarm.shields() if len(s.vouchers) > 1] == [False] * 3)
                first, second, _ = swarm.robots()
                corner = {"threshold": 60, "waypoints": [{"x": 1900, "y": 1900}]}
                ahead = {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60}

                async def moves(nth: int) -> None:
                    before = swarm.robots()[nth].at
                    await eventually(lambda: swarm.robots()[nth].at != before)

                for _ in range(5):
                    await phone.command(first.address, "move_raw", ahead)
                    await asyncio.sleep(0.1)
                await moves(0)
                await phone.command(second.address, "waypoints", corner)
                await moves(1)
                gateway.hold(True)
                heard = [each.heard_at_s for each in swarm.robots()]
                # What they say a second later is of robots that stand.
                await eventually(lambda: all(r.heard_at_s > h + 1 for r, h in zip(swarm.robots(), heard, strict=True)))
                stood = [each.at for each in swarm.robots()]
                await phone.command(second.address, "waypoints", corner)
                await asyncio.sleep(0.6)
                assert [each.at for each in swarm.robots()] == stood
                assert swarm.robots()[1].route == ()
        summary = json.loads((await asyncio.to_thread(arena.communicate))[0])
    finally:
        arena.kill()
        arena.wait()
    assert summary["correct_in_safe_mode"] == []
    # Whoever has the log can tell who ordered what: with another mission's keys or number it is no honest robot's.
    log = read_robot_log(kept / "robot-2.log")
    said = {each.signer: each for each in count_signed_messages(log)}
    assert set(said) == {"gateway", "operator"}
    assert said["gateway"].key == log.scenario.gateway_key
    assert said["gateway"].count > 5, "a beacon a second, and a route"
    assert 0 < said["operator"].first_s <= said["operator"].last_s < 60
    other = replace(log, scenario=replace(log.scenario, operator_key=log.scenario.gateway_key))
    assert {each.signer for each in count_signed_messages(other)} == {"gateway", NOBODY}
    assert log.first_dishonest_entry() is None
    assert replace(log, mission=log.mission + 1).first_dishonest_entry().refusal == Refusal.OUTPUT_WRONG
