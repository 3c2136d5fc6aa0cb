"""Joysticks, visitors, PyDotBot's words, and the gateway over a real broker."""

from __future__ import annotations

import asyncio
import json
import re
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.gateway import Gateway, vocabulary
from phalanx.gateway.brakes import EXPIRES_S, Joysticks
from phalanx.gateway.gateway import TICK_S, UPDATES_PER_TICK
from phalanx.gateway.missions.watch import MOST_THINGS, WorkWatch
from phalanx.gateway.visitors import FORGET_AFTER_S, LIMIT, MOST_DRIVERS, Drivers, Visitors
from phalanx.net import QrkeyClient, Server
from phalanx.robot import Led, Point
from phalanx.robot.swarm import Done
from phalanx.world import Dotbots
from waiting import eventually

pytestmark = pytest.mark.waits

NOW = 1_700_000_000.0


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
        visitors.asked("a", 0.0)
        visitors.asked("b", 40.0)
        assert [v.client_id for v in visitors.present(41.0)] == ["b", "a"]
        assert [v.client_id for v in visitors.present(FORGET_AFTER_S + 1)] == ["b"]
        assert [v.client_id for v in visitors.present(FORGET_AFTER_S + 41)] == []

    def test_what_the_operators_page_calls_a_visitor_is_too_little_to_ask_in_its_place(self):
        visitors, published = Visitors(), "mqttjs_1a2b3c4d"
        assert visitors.shown("phalanx_0123456789abcdef") == "phalanx…abcdef"
        assert re.fullmatch("visitor [0-9a-f]{6}", visitors.shown(published))
        assert visitors.shown(published) == visitors.shown(published) != visitors.shown("mqttjs_1a2b3c4e")
        assert visitors.shown(published) != Visitors().shown(published), "nobody finds it by trying names"

    def test_work_is_told_once_a_second_and_things_when_they_move(self):
        at_work = SimpleNamespace(things=lambda: places, done=lambda: done)
        watch, places = WorkWatch(at_work), [Point(10.4, 20.6)]
        done = Done(name="tracking", score=61.6, counts="% tracked", lately_s=120.0)
        told = {"work": [["tracking", 62, "% tracked", 120]], "things": [[[10, 21]]]}
        assert watch.news(dict, 10.0) == told
        assert watch.news(dict, 10.1) == {}
        places = [Point(i, 0.0) for i in range(100)]
        assert watch.news(dict, 10.2) == {"things": [[[i, 0] for i in range(MOST_THINGS)]]}
        places = []
        assert watch.news(dict, 10.3) == {"things": [[]]}
        assert watch.news(dict, 11.0) == {"work": told["work"]}
        done = replace(done, score=None)
        assert watch.news(dict, 12.5) == {"work": [["tracking", None, "% tracked", 120]]}
        done = None
        assert watch.news(dict, 14.0) == {}

    def test_drivers_are_told_when_they_change_and_so_many_only(self):
        drivers, number = Drivers(), {"A": 1, "B": 2}.__getitem__
        for i in range(100):
            drivers.drives("A", f"{i:02}", 10.0)
        drivers.drives("B", "", 10.2)
        some = [f"{i:02}" for i in range(MOST_DRIVERS)]
        assert drivers.news(number, 10.3) == {"drivers": [[1, some], [2, [""]]]}
        assert drivers.in_list() == {"A": {"drivers": some}, "B": {"drivers": [""]}}
        assert drivers.news(number, 10.4) == {"drivers": []}
        drivers.drives("B", "b", 10.5)
        assert drivers.news(number, 10.6) == {"drivers": [[2, ["", "b"]], [1, []]]}
        assert drivers.news(number, 11.1) == {"drivers": [[2, []]]}
        assert drivers.in_list() == {}
        assert drivers.news(number, 11.2) == {"drivers": []}

    def test_inventing_names_does_not_grow_it_without_end(self):
        visitors = Visitors()
        for i in range(3 * LIMIT):
            visitors.asked(str(i), 1.0)
        assert len(visitors.present(1.0)) == LIMIT

    def test_pages_are_notified_for_a_while_after_they_ask(self):
        visitors = Visitors()
        assert not visitors.are_there(1.0)
        visitors.asked("theirs", 10.0)
        assert visitors.are_there(600.0)
        assert not visitors.are_there(611.0)


class TestVocabulary:
    def test_long_histories_are_dropped_until_the_answer_fits(self):
        swarm = Dotbots(50, 1, lambda: NOW)
        trail = [Point(i * 1.1, i * 1.3) for i in range(1000)]
        robots = [robot._replace(history=trail) for robot in swarm.robots()]
        whole = vocabulary.robots_json(robots, NOW, 1 << 30, 1 << 30)
        assert all(len(robot["position_history"]) == 1000 for robot in whole)
        told = vocabulary.robots_json(robots, NOW, 48 << 10, 1 << 20)
        assert len(json.dumps(told, separators=(",", ":"))) <= 48 << 10
        lengths = {len(robot["position_history"]) for robot in told}
        assert 0 < min(lengths) <= max(lengths) < 1000
        assert told[0]["position_history"][-1] == {"x": 1098.9, "y": 1298.7, "z": 0}, "the newest are kept"
        assert len(vocabulary.robots_json(robots, NOW, 100, 1 << 20)) == 50, "robots are not dropped for a wish"

    def test_nothing_makes_an_answer_longer_than_a_client_reads(self):
        robots = [
            robot._replace(route=[Point(1234.5, 1234.5)] * 65, history=[Point(1.5, 1.5)] * 1000)
            for robot in Dotbots(2000, 1, lambda: NOW).robots()
        ]
        told = vocabulary.robots_json(robots, NOW, 48 << 10, 1 << 20)
        assert len(json.dumps(told, separators=(",", ":"))) <= 1 << 20
        assert len(told) == 2000
        assert len(vocabulary.robots_json(robots, NOW, 100, 100_000)) >= 100, "in the end, some robots"

    @pytest.mark.parametrize(("silent_s", "status"), [(0, 0), (4.9, 0), (5, 1), (59, 1), (60, 2)])
    def test_a_silent_robot_is_quiet_then_lost(self, silent_s, status):
        robot = Dotbots(1, 1, lambda: NOW).robots()[0]._replace(heard_at_s=NOW - silent_s)
        assert vocabulary.robot_json(robot, NOW)["status"] == status


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
            async with QrkeyClient(server.qr()) as client:
                robots = await client.request(0)
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

            @server.on_command("hold_up")
            async def hold_up(command):
                slow.set()
                await go_on.wait()

            await server.wait_connected(10)
            async with QrkeyClient(server.qr()) as client:
                await client.command(address, "hold_up", {})
                await slow.wait()
                await client.command(address, "move_raw", {"left_y": 100, "right_y": 100})
                await client.command(address, "move_raw", {"left_y": 0, "right_y": 0})
                await client.command(address, "rgb_led", {"red": 1, "green": 2, "blue": 3})
                route = {"threshold": 60, "waypoints": [{"x": 1000, "y": 1000}]}
                await client.command(address, "waypoints", route)
                await asyncio.sleep(2.0)
                go_on.set()
                await eventually(lambda: driven == [(0, 0)])
                await client.command(address, "move_raw", {"left_y": 90, "right_y": 80})
                await eventually(lambda: driven == [(0, 0), (90, 80)])
        assert server.rejected == {"late": 3}
        assert not swarm.robots()[0].route

    async def test_a_driver_that_fails_does_not_end_the_stopping_of_the_others(self, broker, caplog):
        class Flaky(Dotbots):
            fails = 3

            def stop(self, address):
                if self.fails:
                    self.fails -= 1
                    raise OSError("the radio is gone")
                super().stop(address)

        swarm = Flaky(2, 1, time.time)
        addresses = [robot.address for robot in swarm.robots()]
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            gateway = Gateway(swarm, server)
            jobs = [asyncio.create_task(gateway.run()), asyncio.create_task(turn(swarm))]
            await server.wait_connected(10)
            async with QrkeyClient(server.qr()) as client:
                for address in addresses:
                    await client.command(address, "move_raw", {"left_y": 60, "right_y": 60})
                await eventually(lambda: swarm.fails == 0)
                await stands_still(swarm)
            assert not any(job.done() for job in jobs)
            assert "retrying" in caplog.text
            for job in jobs:
                job.cancel()

    @pytest.mark.alone
    async def test_one_encryption_a_tick_whatever_the_number_of_visitors(self, broker):
        swarm = Dotbots(3, 1, time.time)
        rates = []
        for visitors in (1, 6):
            async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
                gateway = Gateway(swarm, server)
                await server.wait_connected(10)
                clients = [QrkeyClient(server.qr()) for _ in range(visitors)]
                for client in clients:
                    await client.__aenter__()
                    await client.request(0)
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
        # Each tick two robots' news: as much for six as for one.
        assert all(rate <= 10 * (UPDATES_PER_TICK + 1) for rate in rates), rates
        assert rates[1] < 1.5 * rates[0]

    async def test_a_published_page_gets_its_words_and_no_state_updates(self, broker):
        swarm = Dotbots(3, 1, time.time)
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            gateway = Gateway(swarm, server)
            job = asyncio.create_task(gateway.run())
            await server.wait_connected(10)
            async with QrkeyClient(server.qr()) as client:
                heard = []

                async def listen():
                    async for note in client.notifications():
                        heard.append(note)

                listener = asyncio.create_task(listen())
                await asyncio.sleep(0.5)
                assert not heard, "nobody asked"
                await client.request(0)
                await eventually(lambda: {1, 2} <= {note["cmd"] for note in heard}, 5)
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
                assert {note["cmd"] for note in heard} <= {1, 2, 4}
                listener.cancel()
            job.cancel()
