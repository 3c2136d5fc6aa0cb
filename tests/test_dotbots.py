"""DotBots: what PyDotBot's controller was recorded to say is understood, orders reach it, robots stop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import subprocess
import time
from contextlib import contextmanager
from types import SimpleNamespace
from unittest.mock import AsyncMock

import pytest
from aiohttp import WSMessage, WSMsgType
from hypothesis import given
from hypothesis import strategies as st

from commands import called, child
from dotbot_controller import HELLO, RECORDED, SNAPSHOT, A, B, C, Controller
from phalanx.bridges.dotbots import DotbotSwarm, parse_dotbot_url
from phalanx.bridges.dotbots.line import REFUSALS, Orders, _hear_refusals
from phalanx.bridges.dotbots.stream import MOST_ROBOTS, TRAIL_POINTS, Fleet, area_of
from phalanx.daemon.driver import NoReading, make_driver
from phalanx.daemon.settings import read_robot
from phalanx.errors import BadPayload, Held, Unavailable, Unknown, UsageError
from phalanx.robot import Led, Point
from phalanx.robot.swarm import RouteLimited
from phalanx.scenarios.behaviour import declaration_of
from phalanx.scenarios.file import parse_scenario
from ports import free_port
from waiting import wait_until

NOW = 1_000_000.0
STAND = {"left_x": 0, "left_y": 0, "right_x": 0, "right_y": 0}


def fleet() -> Fleet:
    told = Fleet()
    for message in RECORDED["begins"]:
        told.hear(json.dumps(message), NOW)
    return told


def delta(**patch) -> str:
    return json.dumps({"type": "delta", "seq": 99, "robots": {A: patch}})


def stops(orders: list[dict]) -> list[str]:
    return [said["cmd"] for said in orders if said["data"] == STAND or said["data"].get("waypoints") == []]


class TestTold:
    def test_robots_are_as_the_controller_told_them(self):
        robots = [bot.robot for bot in fleet().robots.values()]
        assert [(robot.address, robot.name) for robot in robots] == [(A, "0000"), (B, "0001"), (C, "0002")]
        assert robots[0].at == Point(900.0, 900.0), "the middle of the axle, which waypoints steer"
        assert (robots[0].direction_deg, robots[0].route, robots[0].heard_at_s) == (180, (), NOW)
        assert 2.9 < robots[0].battery_v < 3.1

    def test_a_change_changes_what_it_names_and_null_takes_it_away(self):
        told = fleet()
        told.hear(delta(rgb_led={"red": 9, "green": 8, "blue": 7}, battery=2.5), NOW)
        robot = told.robots[A].robot
        assert (robot.led, robot.battery_v, robot.at) == (Led(9, 8, 7), 2.5, Point(900.0, 900.0))
        told.hear(delta(rgb_led=None, axle_position=None, pose=None, lh2_position=None), NOW)
        assert told.robots[A].robot.led != Led(9, 8, 7)
        assert math.isnan(told.robots[A].robot.at.x_mm)

    def test_of_a_robot_that_never_drove_it_is_where_the_lighthouse_sees_it(self):
        told = fleet()
        pose = {"x": 1.0, "y": 2.0, "heading_deg": 0.0, "heading_source": "none"}
        told.hear(delta(axle_position=None, pose=pose, lh2_position={"x": 5.0, "y": 6.0}), NOW)
        assert told.robots[A].robot.at == Point(5.0, 6.0)
        told.hear(delta(pose=pose | {"heading_source": "travel"}), NOW)
        assert told.robots[A].robot.at == Point(1.0, 2.0)

    def test_silent_robots_are_quiet_and_lost_by_the_controllers_word(self):
        told = fleet()
        told.hear(delta(status=1), NOW)
        assert (told.robots[A].robot.heard_at_s, told.robots[A].active) == (NOW - 5, False)
        told.hear(delta(status=2), NOW)
        assert told.robots[A].robot.heard_at_s == NOW - 60
        told.hear(json.dumps({"type": "delta", "seq": 100, "robots": {A: None}}), NOW)
        assert list(told.robots) == [B, C], "forgotten"

    def test_a_trail_is_cut_to_its_newest_points(self):
        told = fleet()
        for x in range(TRAIL_POINTS + 5):
            told.hear(delta(trail_append=[{"x": x, "y": 0}]), NOW)
        assert len(told.robots[A].robot.history) == TRAIL_POINTS
        assert told.robots[A].robot.history[-1] == Point(TRAIL_POINTS + 4, 0)
        told.hear(delta(trail_reset=True, trail_append=[{"x": 7, "y": 7}]), NOW)
        assert told.robots[A].robot.history == (Point(7, 7),)

    def test_boats_are_left_out_and_what_they_say_is_not_read(self):
        told = fleet()
        boat = {"address": "B" * 16, "application": 1, "waypoints": [{"latitude": 1, "longitude": 2}]}
        told.hear(json.dumps({"type": "delta", "seq": 9, "robots": {"B" * 16: boat}}), NOW)
        told.hear(json.dumps({"type": "delta", "seq": 9, "robots": {"B" * 16: {"trail": "sail"}}}), NOW)
        assert list(told.robots) == [A, B, C]

    def test_two_robots_with_one_ending_have_two_names(self):
        told = fleet()
        twin = SNAPSHOT["robots"][0] | {"address": "FF" + A[2:]}
        told.hear(json.dumps({"type": "delta", "seq": 9, "robots": {twin["address"]: twin}}), NOW)
        names = {address: bot.robot.name for address, bot in told.robots.items()}
        assert len(set(names.values())) == 4
        told.hear(json.dumps({"type": "delta", "seq": 10, "robots": {A: None, twin["address"]: twin}}), NOW)
        assert told.robots[twin["address"]].robot.name == names[twin["address"]], "though the ending is free"

    @pytest.mark.parametrize(
        "said",
        [
            "",
            "[" * 100_000,
            "1" * 5000,
            "7",
            '{"type":"delta"}',
            json.dumps(HELLO | {"protocol": 3}),
            json.dumps(SNAPSHOT | {"part": 2}),
            json.dumps(SNAPSHOT | {"part": 2, "parts": 2}),
            json.dumps(SNAPSHOT | {"parts": 2, "robots": [{"address": 7}]}),
            json.dumps(SNAPSHOT | {"robots": SNAPSHOT["robots"] * (MOST_ROBOTS // 3 + 1)}),
            json.dumps({"type": "delta", "seq": 1, "robots": {"C" * 16: {"battery": 1.0}}}),
            json.dumps({"type": "delta", "seq": 1, "robots": {"../../x": None}}),
            delta(battery=math.nan),
            delta(battery="3"),
            delta(battery=True),
            delta(status=3),
            delta(mode=1.5),
            delta(direction=1e9),
            delta(rgb_led={"red": 256, "green": 0, "blue": 0}),
            delta(lh2_position={"x": "1", "y": 0}),
            delta(waypoints=[{"x": 0, "y": 0}] * 1001),
        ],
        ids=lambda said: said[:40],
    )
    def test_nonsense_is_refused(self, said):
        with pytest.raises(BadPayload):
            fleet().hear(said, NOW)

    @given(st.data())
    def test_whatever_stands_in_a_field_only_bad_payload_escapes(self, data):
        values = st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("x y red".split()), inner),
            max_leaves=4,
        )
        told = fleet()
        name = data.draw(st.sampled_from([*SNAPSHOT["robots"][0], "mode", "trail_append", "trail_reset", "rgb_led"]))
        try:
            told.hear(delta(**{name: data.draw(values)}), NOW)
        except BadPayload:
            return
        robot = told.robots[A].robot
        assert robot.direction_deg in range(360)
        assert math.isfinite(robot.battery_v)
        assert len(robot.history) <= TRAIL_POINTS

    def test_a_place_beyond_reach_is_none_and_a_site_has_two_sides(self):
        told = fleet()
        told.hear(delta(axle_position={"x": 4e9, "y": 0.0}), NOW)
        assert math.isnan(told.robots[A].robot.at.x_mm)
        assert area_of(b'{"extent_mm":null}') == (2000, 2000)
        assert area_of(b'{"extent_mm":[3000,4000]}') == (3000, 4000)
        for site in (
            b"",
            b"[]",
            b'{"extent_mm":[1]}',
            b'{"extent_mm":[0,5]}',
            b'{"extent_mm":[1,2,3]}',
            b"\xff",
            b"[" * 99999,
        ):
            with pytest.raises(BadPayload):
                area_of(site)


def test_refusals_without_end_are_not_logged_without_end(caplog):
    stream = SimpleNamespace(receive=AsyncMock(side_effect=[WSMessage(WSMsgType.TEXT, "no", None)] * 50))
    with pytest.raises(StopAsyncIteration):
        asyncio.run(_hear_refusals(stream))
    assert len(caplog.messages) == REFUSALS[1]


def test_of_orders_about_one_thing_the_newest_is_sent_and_none_that_is_old():
    orders = Orders()
    orders.put(A, "wheels", 1, until_s=10.0)
    orders.put(A, "led", 2, until_s=10.0)
    orders.put(A, "wheels", 3, 4, until_s=5.0)
    orders.put(B, "wheels", 5, until_s=1.0)
    assert orders.take(3.0) == [3, 4, 2]
    assert orders.take(3.0) == []


@pytest.mark.parametrize(
    "url",
    ["dotbot://", "http://h:1", "dotbot://u:p@h", "dotbot://h:0", "dotbot://h:99999", "dotbot://h/x", "dotbot://h?x"],
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(UsageError):
        parse_dotbot_url(url)


def test_an_address_is_a_host_and_a_port():
    assert str(parse_dotbot_url("dotbot://lab")) == "dotbot://lab:8000"
    assert parse_dotbot_url("dotbot://[::1]:9").http == "http://[::1]:9"
    assert [parse_dotbot_url(f"dotbot://{h}").is_here for h in ("localhost", "127.0.0.1", "[::1]", "10.0.0.1")] == [
        True,
        True,
        True,
        False,
    ]


@contextmanager
def a_swarm(**more):
    with Controller(**more) as controller, DotbotSwarm(parse_dotbot_url(controller.url), 10.0) as swarm:
        yield controller, swarm


def one(swarm, address):
    return next(robot for robot in swarm.robots() if robot.address == address)


@pytest.mark.waits
class TestSwarm:
    def test_orders_are_those_that_were_recorded_and_what_follows_is_shown(self):
        with a_swarm() as (controller, swarm):
            assert isinstance(swarm, RouteLimited)
            assert swarm.area_mm == (2000, 2000)
            wait_until(lambda: controller.acknowledged[-1:] == [RECORDED["begins"][-1]["seq"]])
            swarm.set_led(A, Led(1, 2, 3))
            wait_until(lambda: one(swarm, A).led == Led(1, 2, 3))
            swarm.drive(A, 60, 60)
            wait_until(lambda: one(swarm, A).at.y_mm < 700)
            assert len(one(swarm, A).history) > 2
            swarm.follow(B, [Point(1500.0, 1500.0), Point(300.0, 300.0)], 50.0)
            wait_until(lambda: len(one(swarm, B).route) == 3)
            swarm.stop(B)
            wait_until(lambda: one(swarm, B).route == ())
            swarm.clear_history(A)
            wait_until(lambda: len(one(swarm, A).history) == 1)
            recorded = [order for step in RECORDED["steps"] for order in step.get("orders", [])]
            assert controller.heard == [*recorded, f"forget {A}"]

    def test_what_dotbots_cannot_do_is_refused(self):
        with a_swarm() as (controller, swarm):
            with pytest.raises(Unknown):
                swarm.drive("F" * 16, 1, 1)
            with pytest.raises(UsageError):
                swarm.follow(A, [Point(1, 1)] * (swarm.longest_route + 1), 50.0)
        assert controller.heard == []

    def test_held_robots_are_stopped_those_too_that_come_and_obey_nobody(self):
        with a_swarm() as (controller, swarm):
            swarm.hold()
            wait_until(
                lambda: all(stops(controller.orders_of(each)) == ["move_raw", "waypoints"] for each in (A, B, C))
            )
            for order in (lambda: swarm.drive(A, 50, 50), lambda: swarm.follow(A, [Point(1, 1)], 50.0)):
                with pytest.raises(Held):
                    order()
            late = SNAPSHOT["robots"][0] | {"address": "D" * 16}
            controller.say({"type": "delta", "seq": 99, "robots": {"D" * 16: late}})
            wait_until(lambda: swarm.hold() or controller.orders_of("D" * 16))
            swarm.release()
            swarm.drive(A, 50, 50)
            wait_until(lambda: controller.orders_of(A)[-1]["data"].get("left_y") == 50)

    def test_who_is_under_way_is_stopped_at_the_end_and_nobody_else(self):
        with Controller() as controller:
            with DotbotSwarm(parse_dotbot_url(controller.url), 10.0) as swarm:
                swarm.follow(A, [Point(100.0, 100.0)], 50.0)
                swarm.follow(B, [Point(100.0, 100.0)], 50.0)
                wait_until(lambda: controller.orders_of(A) and controller.orders_of(B))
                swarm.stop(B)
                wait_until(lambda: stops(controller.orders_of(B)) == ["move_raw", "waypoints"])
            wait_until(lambda: stops(controller.orders_of(A)) == ["move_raw", "waypoints"])
            assert stops(controller.orders_of(B)) == ["move_raw", "waypoints"]
            assert not controller.orders_of(C)

    def test_a_controller_that_comes_back_is_reached_and_hears_the_stop_first(self, caplog):
        with Controller() as controller:
            swarm = DotbotSwarm(parse_dotbot_url(controller.url), 10.0)
            swarm.__enter__()
            assert time.time() - one(swarm, A).heard_at_s < 1
        try:
            wait_until(lambda: "lost the connection" in caplog.text)
            heard_at_s = one(swarm, A).heard_at_s
            with pytest.raises(Unknown):
                swarm.drive(A, 50, 50)
            swarm.stop(A)
            assert one(swarm, A).heard_at_s == heard_at_s, "they are quiet, and soon lost"
            with Controller(port=controller.port) as again:
                wait_until(lambda: "connected to" in caplog.text)
                wait_until(lambda: stops(again.heard) == ["move_raw", "waypoints"])
                assert one(swarm, A).heard_at_s > heard_at_s
        finally:
            swarm.__exit__(None, None, None)

    @pytest.mark.parametrize(
        "said", ["{", json.dumps({"type": "event", "seq": 99, "x": "9" * 5_000_000})], ids=["nonsense", "long"]
    )
    def test_a_controller_that_says_nonsense_is_left_and_tried_again(self, said, caplog):
        with a_swarm() as (controller, swarm):
            controller.say(said)
            wait_until(lambda: controller.visits == 2 and "connected to" in caplog.text)
            assert "not the protocol of" in caplog.text
            assert len(swarm.robots()) == 3

    def test_a_refusal_is_said(self, caplog):
        with a_swarm() as (_, swarm):
            swarm.follow(A, [Point(-1.0, 5.0)], 50.0)
            wait_until(lambda: "refused a command" in caplog.text)

    @pytest.mark.parametrize(
        ("begins", "trouble"),
        [([HELLO | {"protocol": 3}], "protocol 3 of the stream"), ([HELLO], "no answer")],
        ids=["another", "silent"],
    )
    def test_who_is_no_such_controller_is_not_waited_for_longer(self, begins, trouble):
        with (
            Controller(begins=begins) as controller,
            pytest.raises(Unavailable, match=trouble),
            DotbotSwarm(parse_dotbot_url(controller.url), 1.0),
        ):
            raise AssertionError


@pytest.mark.waits
class TestUp:
    def test_a_phone_drives_a_dotbot_and_sees_where_it_is(self):
        with Controller() as controller:
            with child("up", "--events", "--port", "0", "--swarm", controller.url) as up:
                ready = up.wait_for("ready", timeout_s=60.0)
                drive = ["--drive", "0000", "--left", "60", "--right", "60", "--for", "0.5", "--json"]
                drove = json.loads(called("link", "connect", ready["qr_url"], *drive).stdout)
                assert drove["address"] == A
                assert drove["to"] != drove["from"]
                # A stop ends a route, too.
                wait_until(lambda: STAND in [order["data"] for order in controller.orders_of(A)[-2:]])
                listed = json.loads(called("link", "connect", ready["qr_url"], "--json").stdout)["robots"]
                assert [robot["name"] for robot in listed] == ["0000", "0001", "0002"]
                assert up.stop() == 0
            (said,) = [line for line in up.err if "do not audit each other" in line]
            assert "16 points" in said

    @pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
    def test_a_controller_that_is_not_there_is_one_line_and_a_hint(self, phalanx, host):
        code, out, err = phalanx("up", "--swarm", f"dotbot://{host}:{free_port()}", "--wait", "0.3")
        *warning, error, hint = err.splitlines()
        assert (code, out) == (1, "")
        assert "no DotBot controller" in error
        assert "Connection refused" in error
        assert "dotbot run controller" in hint
        assert [("its API has no login" in line) for line in warning] == [True] * (host != "127.0.0.1")

    @pytest.mark.parametrize("more", [("--robots", "3"), ("--mission", "office"), ("--defence", "none")])
    def test_what_real_robots_cannot_be_told_is_refused(self, phalanx, more):
        code, _, err = phalanx("up", "--swarm", "dotbot://127.0.0.1:1", *more)
        assert code in (1, 2)
        assert f"--swarm with {more[0]}" in err


def driver_of(tmp_path, where, mission="controller: wheels\nrobots: 3\n"):
    radio = {"here": "127.0.0.1:4411", "peers": ["127.0.0.1:4412"]}
    said = {"robot": 1, "mission": "m", "key": "k", "driver": where, "radio": radio}
    (tmp_path / "robot.yaml").write_text(json.dumps(said))
    declared = declaration_of(parse_scenario(mission.encode(), "mission.yaml"))
    return make_driver(read_robot(tmp_path / "robot.yaml"), declared), declared


def soon_sensed(hardware):
    """Its first reading."""
    for _ in range(500):
        with contextlib.suppress(NoReading):
            return asyncio.run(hardware.sense(7, 1.0))
        time.sleep(0.01)
    raise AssertionError("no reading")


@pytest.mark.waits
class TestDriver:
    """A daemon of ours in front of each robot."""

    def test_it_reads_where_the_robot_is_drives_it_and_stops_it(self, tmp_path):
        with Controller() as controller:
            hardware, declared = driver_of(tmp_path, f"{controller.url}/{A}")
            said = declared.reads.decode(soon_sensed(hardware))
            assert (said["id"], said["x_mm"], said["y_mm"], said["direction_deg"]) == (1, 900.0, 900.0, 180.0)
            command = {"id": 1, "t": 7, "left": 60, "right": 60, "red": 1, "green": 2, "blue": 3}
            for _ in range(2):
                hardware.drive(declared.commands.encode(**command))
                wait_until(lambda: len([each for each in controller.orders_of(A) if each["cmd"] == "move_raw"]) > 0)
            wait_until(lambda: [each["cmd"] for each in controller.orders_of(A)].count("move_raw") == 2)
            assert [each["data"] for each in controller.orders_of(A) if each["cmd"] == "rgb_led"] == [
                {"red": 1, "green": 2, "blue": 3}
            ], "the light is told when it changes"
            controller.say(json.loads(delta(status=1)))
            with pytest.raises(NoReading, match="has not heard from this robot"):
                while True:
                    asyncio.run(hardware.sense(8, 1.0))
            hardware.stop()
            wait_until(lambda: stops(controller.orders_of(A)))
            hardware.drive(declared.commands.encode(**command))
            wait_until(lambda: [each["cmd"] for each in controller.orders_of(A)].count("move_raw") == 4)
            hardware.close()
            wait_until(lambda: len(stops(controller.orders_of(A))) >= 4)
        hardware.drive(declared.commands.encode(**command))  # nobody is there: it stands by itself

    def test_what_is_no_robot_of_a_controllers_or_no_mission_for_one_is_said(self, tmp_path):
        with Controller() as controller:
            for where, says in (
                (f"{controller.url}/DEAD", "driver is"),
                (f"{controller.url}/{'F' * 16}", "no DotBot FFFF"),
                (controller.url, "driver is"),
            ):
                with pytest.raises(UsageError, match=says):
                    driver_of(tmp_path, where)
        with pytest.raises(UsageError, match="a driver for DotBots"):
            driver_of(tmp_path, f"{controller.url}/{A}", "robots: 3\nbti: {f_max: 1}\n")


@pytest.mark.waits
@pytest.mark.peers
@pytest.mark.skipif(
    "PHALANX_DOTBOT" not in os.environ, reason="names the command dotbot of PyDotBot 0.33, if there is one"
)
def test_the_real_controllers_simulated_robots_drive_follow_and_stop(tmp_path):
    port = free_port()
    words = ["run", "simulator", "--headless", "--robots", "2", "--controller-http-port", str(port)]
    with subprocess.Popen([os.environ["PHALANX_DOTBOT"], *words], cwd=tmp_path, stderr=subprocess.DEVNULL) as real:
        try:
            with DotbotSwarm(parse_dotbot_url(f"dotbot://127.0.0.1:{port}"), 60.0) as swarm:
                began = one(swarm, A)
                until_s = time.monotonic() + 2.0
                while time.monotonic() < until_s:
                    swarm.drive(A, 70, 70)
                    time.sleep(0.1)
                wait_until(lambda: one(swarm, A).at != began.at)
                swarm.set_led(A, Led(1, 2, 3))
                wait_until(lambda: one(swarm, A).led == Led(1, 2, 3))
                swarm.follow(B, [Point(1900.0, 1900.0)], 50.0)
                wait_until(lambda: one(swarm, B).route)
                swarm.stop(B)
                wait_until(lambda: not one(swarm, B).route)
                swarm.follow(B, [Point(1900.0, 1900.0)], 50.0)
                wait_until(lambda: one(swarm, B).route)
            with DotbotSwarm(parse_dotbot_url(f"dotbot://127.0.0.1:{port}"), 10.0) as swarm:
                wait_until(lambda: not one(swarm, B).route), "the end of the first stopped it"
        finally:
            real.terminate()
