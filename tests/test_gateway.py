"""Frames, joysticks, visitors, PyDotBot's words, and the gateway over a real broker."""

from __future__ import annotations

import asyncio
import json
import os
import time
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import eventually
from phalanx.config import LinkConfig
from phalanx.gateway import Gateway, vocabulary
from phalanx.gateway.frames import Frames
from phalanx.gateway.gateway import TICK_S, UPDATES_PER_TICK
from phalanx.gateway.joystick import EXPIRES_S, Joysticks
from phalanx.gateway.visitors import FORGET_AFTER_S, LIMIT, Visitors
from phalanx.io import Client, Server
from phalanx.link import ClientSide, Request, ServerSide
from phalanx.link.messages import Reply, ReplyPart
from phalanx.robot import Led, Point
from phalanx.sim import Dotbots

NOW = 1_700_000_000.0


class Mirror:
    """What a visitor knows, kept up from frames alone."""

    def __init__(self, robots):
        self.robots = {robot["address"]: dict(robot) for robot in robots}
        self.seq = None

    def read(self, frame):
        assert frame["cmd"] == 16
        data = frame["data"]
        assert self.seq is None or data["seq"] == self.seq + 1
        self.seq = data["seq"]
        for address in data.get("left", ()):
            del self.robots[address]
        for robot in data.get("joined", ()):
            self.robots[robot["address"]] = dict(robot)
        by_number = {robot["n"]: robot for robot in self.robots.values()}
        assert len(by_number) == len(self.robots)
        for number, x, y, direction in data["robots"]:
            by_number[number] |= {"lh2_position": {"x": x, "y": y, "z": 0}, "direction": direction}
        for change in data.get("changed", ()):
            known = self.robots[change["address"]]
            known |= {key: value for key, value in change.items() if key not in ("history_cleared", "battery_mv")}
            if "battery_mv" in change:
                known["battery"] = change["battery_mv"] / 1000


FRAME_BYTES = LinkConfig().part_plaintext_bytes


actions = st.lists(
    st.tuples(
        st.sampled_from(["drive", "follow", "led", "join", "leave", "wait", "threshold"]),
        st.integers(0, 9),
        st.integers(0, 255),
    ),
    max_size=25,
)


class TestFrames:
    @given(actions)
    def test_a_visitor_who_reads_frames_knows_what_the_swarm_knows(self, steps):
        swarm, frames, uptime = Dotbots(4, 1, lambda: NOW), Frames(FRAME_BYTES), 0.0
        mirror = None
        for what, who, value in [("wait", 0, 0), *steps]:
            robots = swarm.robots()
            address = robots[who % len(robots)].address if robots else swarm.join()
            match what:
                case "drive":
                    swarm.drive(address, value - 128, 50)
                case "follow":
                    swarm.follow(address, [Point(value * 5, 1000)] * (who % 3), 60)
                case "threshold":
                    swarm.follow(address, [], 1 + value)
                case "led":
                    swarm.set_led(address, Led(value, 0, 0))
                case "join":
                    swarm.join()
                case "leave":
                    swarm.leave(address)
            swarm.step(0.1)
            uptime += 0.1
            tick = frames.next(swarm.robots(), NOW, uptime)
            told = [
                vocabulary.tell_robot(robot, NOW, 0) | {"n": frames.number(robot.address)} for robot in swarm.robots()
            ]
            if mirror is None:
                mirror = Mirror(told)
            for frame in tick.frames if tick else ():
                mirror.read(json.loads(json.dumps(frame)))
            for robot in told:
                known = mirror.robots[robot["address"]]
                for key in ("direction", "status", "mode", "rgb_led", "waypoints", "waypoints_threshold"):
                    assert known[key] == robot[key], key
                for axis in "xy":
                    assert abs(known["lh2_position"][axis] - robot["lh2_position"][axis]) <= 0.6
                assert abs(known["battery"] - robot["battery"]) <= 0.021
            assert set(mirror.robots) == {robot["address"] for robot in told}

    @pytest.mark.parametrize("root", ["/qrkey", "/" + "r" * 64 + "/" + "s" * 64])
    def test_no_frame_or_part_makes_a_packet_that_mosquitto_would_dribble(self, root):
        config = LinkConfig(root=root)
        swarm, frames = Dotbots(1000, 1, lambda: NOW), Frames(config.part_plaintext_bytes)
        server = ServerSide(config, os.urandom, 0.0)
        frames.next(swarm.robots(), NOW, 0.0)
        for robot in swarm.robots():
            swarm.follow(robot.address, [Point(1234.56, 1765.43)] * 64, 60)
        for _ in range(3):
            swarm.join()
        swarm.step(0.5)
        tick = frames.next(swarm.robots(), NOW, 0.5)
        assert len(tick.frames) > 300
        request = Request(0, "phalanx_" + "f" * 16, {"parts": True})
        answer = [vocabulary.tell_robot(robot, NOW, 3) for robot in swarm.robots()]
        sealed = [publish for frame in tick.frames for publish in server.notify(frame, NOW)]
        sealed += server.reply(request, answer, NOW)
        assert max(len(publish.payload) + len(publish.topic) + 16 for publish in sealed) <= 4096

    def test_an_answer_in_parts_is_the_answer(self):
        config = LinkConfig()
        server = ServerSide(config, os.urandom, 0.0)
        client = ClientSide(config, os.urandom, server.epoch.pin, "c")
        ask = client.request(0, NOW)
        request = server.receive(ask.topic, ask.payload, NOW, 0.0)
        data = [vocabulary.tell_robot(robot, NOW) for robot in Dotbots(100, 1, lambda: NOW).robots()]
        said = [client.receive(publish.topic, publish.payload, NOW) for publish in server.reply(request, data, NOW)]
        assert len(said) > 10
        assert all(isinstance(part, ReplyPart) for part in said[:-1])
        assert said[-1] == Reply(0, data)
        whole = server.reply(replace(request, words={}), data, NOW)
        assert len(whole) == 1, "who does not read parts gets it in one piece"

    def test_a_swarm_at_rest_is_told_once_a_second(self):
        robots = Dotbots(3, 1, lambda: NOW).robots()
        frames = Frames(FRAME_BYTES)
        told = [frames.next(robots, NOW, tick * 0.1) for tick in range(31)]
        full = [tick for tick in told if tick]
        assert len(full) in (3, 4)
        assert all(len(tick.frames[0]["data"]["robots"]) == 3 for tick in full)

    def test_a_cleared_history_is_told(self):
        swarm, frames = Dotbots(1, 1, lambda: NOW), Frames(FRAME_BYTES)
        address = swarm.robots()[0].address
        swarm.drive(address, 100, 100)
        swarm.step(0.5)
        frames.next(swarm.robots(), NOW, 0.0)
        swarm.clear_history(address)
        (frame,) = frames.next(swarm.robots(), NOW, 0.1).frames
        assert frame["data"]["changed"] == [{"address": address, "history_cleared": True}]


class TestJoysticks:
    def test_a_robot_stops_300_ms_after_the_last_word(self):
        sticks = Joysticks()
        sticks.drive("A", True, 0.0)
        sticks.drive("A", True, 0.2)
        assert sticks.expired(0.2 + EXPIRES_S - 0.001) == []
        assert sticks.expired(0.2 + EXPIRES_S) == ["A"]
        assert sticks.expired(10.0) == []

    def test_a_stop_or_a_route_needs_no_stop(self):
        sticks = Joysticks()
        sticks.drive("A", True, 0.0)
        sticks.drive("A", False, 0.1)
        assert sticks.expired(10.0) == []
        assert EXPIRES_S == 0.3

    @given(st.lists(st.tuples(st.sampled_from("AB"), st.booleans(), st.floats(0, 1)), max_size=40))
    def test_every_driven_robot_is_stopped_exactly_once_after_its_last_word(self, words):
        sticks, now = Joysticks(), 0.0
        moving_until: dict[str, float] = {}
        for who, moving, pass_s in [*words, ("end", False, 1.0)]:
            now += pass_s
            due = sorted(name for name, until in moving_until.items() if until <= now)
            assert sorted(sticks.expired(now)) == due
            for name in due:
                del moving_until[name]
            sticks.drive(who, moving, now)
            moving_until.pop(who, None)
            if moving:
                moving_until[who] = now + EXPIRES_S
        assert not moving_until


class TestVisitors:
    def test_they_are_forgotten_when_they_stop_asking(self):
        visitors = Visitors()
        visitors.asked("a", True, 0.0)
        visitors.asked("b", True, 100.0)
        assert [v.client_id for v in visitors.present(101.0)] == ["b", "a"]
        assert [v.client_id for v in visitors.present(FORGET_AFTER_S + 50)] == ["b"]

    def test_inventing_names_does_not_grow_it_without_end(self):
        visitors = Visitors()
        for i in range(3 * LIMIT):
            visitors.asked(str(i), True, 1.0)
        assert len(visitors.present(1.0)) == LIMIT

    def test_older_pages_are_served_for_a_while_after_they_ask(self):
        visitors = Visitors()
        visitors.asked("ours", True, 0.0)
        assert not visitors.older_pages(1.0)
        visitors.asked("theirs", False, 10.0)
        assert visitors.older_pages(600.0)
        assert not visitors.older_pages(611.0)


class TestVocabulary:
    def test_long_histories_are_dropped_until_the_answer_fits(self):
        swarm = Dotbots(50, 1, lambda: NOW)
        trail = [Point(i * 1.1, i * 1.3) for i in range(1000)]
        robots = [replace(robot, history=trail) for robot in swarm.robots()]
        whole = vocabulary.tell_robots(robots, NOW, 1 << 30, 1 << 30)
        assert all(len(robot["position_history"]) == 1000 for robot in whole)
        told = vocabulary.tell_robots(robots, NOW, 48 << 10, 1 << 20)
        assert len(json.dumps(told, separators=(",", ":"))) <= 48 << 10
        lengths = {len(robot["position_history"]) for robot in told}
        assert 0 < min(lengths) <= max(lengths) < 1000
        assert told[0]["position_history"][-1] == {"x": 1098.9, "y": 1298.7, "z": 0}, "the newest are kept"
        assert len(vocabulary.tell_robots(robots, NOW, 100, 1 << 20)) == 50, "robots are not dropped for a wish"

    def test_nothing_makes_an_answer_longer_than_a_client_reads(self):
        robots = [
            replace(robot, route=[Point(1234.5, 1234.5)] * 65, history=[Point(1.5, 1.5)] * 1000)
            for robot in Dotbots(2000, 1, lambda: NOW).robots()
        ]
        told = vocabulary.tell_robots(robots, NOW, 48 << 10, 1 << 20)
        assert len(json.dumps(told, separators=(",", ":"))) <= 1 << 20
        assert len(told) == 2000
        assert len(vocabulary.tell_robots(robots, NOW, 100, 100_000)) >= 100, "in the end, some robots"

    @pytest.mark.parametrize(("silent_s", "status"), [(0, 0), (4.9, 0), (5, 1), (59, 1), (60, 2)])
    def test_a_silent_robot_is_quiet_then_lost(self, silent_s, status):
        robot = replace(Dotbots(1, 1, lambda: NOW).robots()[0], heard_at_s=NOW - silent_s)
        assert vocabulary.tell_robot(robot, NOW)["status"] == status


async def turn(swarm):
    while True:
        swarm.step(0.02)
        await asyncio.sleep(0.02)


async def stands_still(swarm, timeout_s: float = 3.0):
    """Every robot is where it was a quarter of a second ago, within a time that ends long before the wall would stop it."""
    deadline, before = time.monotonic() + timeout_s, None
    while (now := [robot.at for robot in swarm.robots()]) != before:
        assert time.monotonic() < deadline, "somebody still drives"
        before = now
        await asyncio.sleep(0.25)


class TestGateway:
    async def test_driving_by_the_link_moves_the_robot_and_stops_it_when_nobody_says_more(self, broker):
        swarm = Dotbots(3, 1, time.time)
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            gateway = Gateway(swarm, server)
            jobs = [asyncio.create_task(gateway.run()), asyncio.create_task(turn(swarm))]
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                robots = await client.request(0, frames=True)
                assert await client.request(1) == {"width": 2000, "height": 2000}
                first = robots[0]
                # Lower case, as some pages of PyDotBot write addresses.
                await client.command(first["address"].lower(), "move_raw", {"left_y": 60, "right_y": 60})
                await eventually(lambda: swarm.robots()[0].at != Point(*list(first["lh2_position"].values())[:2]))
                await stands_still(swarm)
                route = {"threshold": 60, "waypoints": [{"x": 1000, "y": 1000}]}
                await client.command(first["address"], "move_raw", {"left_y": 60, "right_y": 60})
                await client.command(first["address"], "waypoints", route)
                await eventually(lambda: swarm.robots()[0].route)
                await asyncio.sleep(EXPIRES_S + 0.1)
                assert swarm.robots()[0].route, "the joystick's end must not end a route that came after it"
                await client.command(first["address"], "rgb_led", {"red": 1, "green": 2, "blue": 3})
                await client.command(first["address"], "clear_position_history", "")
                await eventually(lambda: swarm.robots()[0].led == Led(1, 2, 3))
                for bad in (
                    ("FFFF", "move_raw", {"left_y": 1, "right_y": 1}, "0"),
                    (first["address"], "move_raw", {"left_y": 1e999}, "0"),
                    (first["address"], "move_raw", {"left_y": 1, "right_y": 1}, "3"),
                    (first["address"], "xgo_action", {"action": 1}, "0"),
                ):
                    try:
                        await client.command(*bad)
                    except Exception as error:
                        assert "not JSON" in str(error)
                await eventually(lambda: server.rejected["unknown"] == 3)
            for job in jobs:
                job.cancel()

    async def test_a_command_that_waited_here_for_too_long_moves_nothing(self, broker):
        swarm, driven = Dotbots(1, 1, time.time), []
        swarm.drive = lambda _, left_pct, right_pct: driven.append((left_pct, right_pct))
        address = swarm.robots()[0].address
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            Gateway(swarm, server)
            slow, go_on = asyncio.Event(), asyncio.Event()

            @server.on_request(7)
            async def hold_up(request):
                slow.set()
                await go_on.wait()

            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                asking = asyncio.create_task(client.request(7))
                await slow.wait()
                await client.command(address, "move_raw", {"left_y": 100, "right_y": 100})
                await client.command(address, "move_raw", {"left_y": 0, "right_y": 0})
                await asyncio.sleep(2.0)
                go_on.set()
                await asking
                await eventually(lambda: driven == [(0, 0)])
                await client.command(address, "move_raw", {"left_y": 90, "right_y": 80})
                await eventually(lambda: driven == [(0, 0), (90, 80)])
        assert server.rejected == {"late": 1}

    async def test_a_driver_that_fails_does_not_end_the_stopping_of_the_others(self, broker, caplog):
        class Flaky(Dotbots):
            fails = 3

            def drive(self, address, left_pct, right_pct):
                if (left_pct, right_pct) == (0, 0) and self.fails:
                    self.fails -= 1
                    raise OSError("the radio is gone")
                super().drive(address, left_pct, right_pct)

        swarm = Flaky(2, 1, time.time)
        addresses = [robot.address for robot in swarm.robots()]
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            gateway = Gateway(swarm, server)
            jobs = [asyncio.create_task(gateway.run()), asyncio.create_task(turn(swarm))]
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                for address in addresses:
                    await client.command(address, "move_raw", {"left_y": 60, "right_y": 60})
                await eventually(lambda: swarm.fails == 0)
                await stands_still(swarm)
            assert not any(job.done() for job in jobs)
            assert "trying again" in caplog.text
            for job in jobs:
                job.cancel()

    async def test_one_encryption_a_tick_whatever_the_number_of_visitors(self, broker):
        swarm = Dotbots(3, 1, time.time)
        rates = []
        for visitors in (1, 6):
            async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
                gateway = Gateway(swarm, server)
                await server.wait_connected(10)
                clients = [Client(server.qr()) for _ in range(visitors)]
                for client in clients:
                    await client.__aenter__()
                    await client.request(0, frames=True)
                swarm.drive(swarm.robots()[0].address, 30, -30)
                began = time.monotonic()
                jobs = [asyncio.create_task(gateway.run()), asyncio.create_task(turn(swarm))]
                await asyncio.sleep(2)
                rates.append(server.counters["notifications"] / (time.monotonic() - began))
                for client in clients:
                    assert await asyncio.wait_for(anext(client.notifications()), 3)
                    await client.__aexit__(None, None, None)
                for job in jobs:
                    job.cancel()
        assert all(5 <= rate <= 11 for rate in rates), rates

    async def test_an_older_page_gets_the_older_words_and_ours_do_not_cost_them(self, broker):
        swarm = Dotbots(3, 1, time.time)
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            gateway = Gateway(swarm, server)
            job = asyncio.create_task(gateway.run())
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                heard = []

                async def listen():
                    async for note in client.notifications():
                        heard.append(note)

                listener = asyncio.create_task(listen())
                await client.request(0, frames=True)
                await asyncio.sleep(1.2)
                assert {note["cmd"] for note in heard} == {16}
                await client.request(0)
                await eventually(lambda: {1, 2, 16} <= {note["cmd"] for note in heard}, 5)
                heard.clear()
                began = time.monotonic()
                await asyncio.sleep(1)
                ticks = (time.monotonic() - began) / TICK_S + 1
                assert sum(note["cmd"] == 2 for note in heard) <= ticks * UPDATES_PER_TICK
                swarm.join()
                await eventually(lambda: any(note["cmd"] == 4 for note in heard))
                new = next(note for note in heard if note["cmd"] == 4)
                assert new["data"]["address"] == swarm.robots()[-1].address
                swarm.set_led(swarm.robots()[0].address, Led(7, 7, 7))
                heard.clear()
                await eventually(lambda: any(note["cmd"] == 1 for note in heard))
                listener.cancel()
            job.cancel()
