"""Frames: who reads all of them knows what the swarm knows, and none makes a packet too long."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirror import Mirror, are_near, read_places
from phalanx.gateway import vocabulary
from phalanx.gateway.frames import StateUpdates, tick_bytes
from phalanx.link.envelope import encode_json
from phalanx.robot import Led, Point
from phalanx.world import Dotbots

NOW = 1_700_000_000.0


actions = st.lists(
    st.tuples(
        st.sampled_from(["drive", "follow", "led", "join", "leave", "wait", "threshold"]),
        st.integers(0, 9),
        st.integers(0, 255),
    ),
    max_size=25,
)


class TestFrames:
    @settings(deadline=None)
    @given(actions)
    def test_a_visitor_who_reads_frames_knows_what_the_swarm_knows(self, steps):
        swarm, frames, uptime = Dotbots(4, 1, lambda: NOW), StateUpdates(), 0.0
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
                vocabulary.robot_json(robot, NOW, 0) | {"n": frames.number(robot.address)} for robot in swarm.robots()
            ]
            if mirror is None:
                mirror = Mirror(told)
            mirror.read(json.loads(json.dumps(tick.frame)))
            for robot in told:
                known = mirror.robots[robot["address"]]
                for key in ("direction", "status", "mode", "rgb_led", "waypoints_threshold"):
                    assert known[key] == robot[key], key
                assert are_near(known["waypoints"], robot["waypoints"])
                for axis in "xy":
                    assert abs(known["lh2_position"][axis] - robot["lh2_position"][axis]) <= 0.6
                assert abs(known["battery"] - robot["battery"]) <= 0.021
            assert set(mirror.robots) == {robot["address"] for robot in told}

    @pytest.mark.parametrize(("robots", "limit_bytes"), [(10, 2044), (100, 2044), (1000, 16 * 1024 - 4)])
    def test_a_tick_is_small_whatever_was_told_to_robots_and_all_of_it_is_told_in_the_end(self, robots, limit_bytes):
        swarm, frames = Dotbots(robots, 1, lambda: NOW), StateUpdates()
        frames.next(swarm.robots(), NOW, 0.0)
        mirror = Mirror(
            [vocabulary.robot_json(robot, NOW, 0) | {"n": frames.number(robot.address)} for robot in swarm.robots()]
        )
        for robot in swarm.robots():
            swarm.set_led(robot.address, Led(1, 2, 3))
            swarm.follow(robot.address, [Point(1234.56, 1765.43)] * 16, 60)
        longest = 0
        for n in range(1, robots + 2):
            swarm.step(0.001)  # nobody arrives meanwhile
            tick = frames.next(swarm.robots(), NOW, n / 10)
            longest = max(longest, len(encode_json(tick.frame)))
            mirror.read(json.loads(encode_json(tick.frame)))
            if all(len(mirror.robots[each.address]["waypoints"]) == len(each.route) for each in swarm.robots()):
                break
        assert limit_bytes / 4 < longest <= limit_bytes
        assert all(each["rgb_led"] == {"red": 1, "green": 2, "blue": 3} for each in mirror.robots.values())
        assert n <= 100, "robots take turns"
        # One route may be longer than a tick's share of changes, and is told all the same.
        swarm.follow(robot.address, [Point(1234.56, 1765.43)] * 64, 60)
        mirror.read(json.loads(encode_json(frames.next(swarm.robots(), NOW, n / 10 + 0.1).frame)))
        assert len(mirror.robots[robot.address]["waypoints"]) == 65

    def test_a_full_frame_of_large_numbers_is_no_longer_than_the_limit(self):
        frames = StateUpdates()
        frames._ticks = 10**12
        far = [
            robot._replace(at=Point(-9_999_999.0 + i % 7, 9_999_999.0 - i), direction_deg=359)
            for i, robot in enumerate(Dotbots(1000, 1, lambda: NOW).robots())
        ]
        for uptime_s, robots in enumerate((far, far[::2], [robot._replace(led=Led(255, 255, 255)) for robot in far])):
            more = {
                "shields": [[i, 0, []] for i in range(300)],
                "walks": [[i, "seeking", 1, 2, ""] for i in range(300)],
            }
            tick = frames.next(robots, NOW, float(uptime_s), more, held=True)
            spare = tick_bytes(len(robots)) - len(encode_json(tick.frame))
            assert 0 <= spare < (200 if uptime_s == 0 else 2048)

    def test_of_a_swarm_at_rest_places_are_told_once_a_second_and_there_is_a_frame_each_tick(self):
        robots, frames = Dotbots(3, 1, lambda: NOW).robots(), StateUpdates()
        told = [frames.next(robots, NOW, tick * 0.1).frame["data"] for tick in range(31)]
        assert [data["seq"] for data in told] == list(range(31))
        full = [data for data in told if "places" in data]
        assert len(full) in (3, 4)
        assert all(len(read_places(data["places"])) == 3 for data in full)

    def test_that_the_operator_holds_all_is_told_by_every_frame_until_it_is_over(self):
        robots, frames = Dotbots(3, 1, lambda: NOW).robots(), StateUpdates()
        told = [frames.next(robots, NOW, tick * 0.1, held=2 <= tick < 5).frame["data"].get("held") for tick in range(7)]
        assert told == [None, None, True, True, True, None, None]

    def test_a_robot_that_knows_no_place_does_not_silence_the_others(self):
        lost, known = Dotbots(2, 1, lambda: NOW).robots()
        nowhere = lost._replace(at=Point(math.nan, 5.0), history=[Point(1.0, math.inf), Point(1.0, 1.0)])
        frames = StateUpdates()
        frames.next([known], NOW, 0.0)
        frame = frames.next([known, nowhere], NOW, 1.0).frame
        assert [number for number, *_ in read_places(frame["data"]["places"])] == [0]
        (told,) = json.loads(encode_json(frame))["data"]["joined"]
        assert told["lh2_position"] is None
        listed = json.loads(encode_json(vocabulary.robot_json(nowhere, NOW)))
        assert (listed["lh2_position"], listed["position_history"]) == (None, [{"x": 1.0, "y": 1.0, "z": 0}])

    def test_what_could_not_be_told_is_told_at_the_next_tick(self):
        here, other = Dotbots(2, 1, lambda: NOW).robots()
        frames = StateUpdates()
        frames.next([here], NOW, 0.0)
        with pytest.raises(ValueError, match="JSON"):
            frames.next([here._replace(led=Led(1, 2, 3)), other._replace(threshold_mm=1, name=math.nan)], NOW, 0.1)
        frame = frames.next([here._replace(led=Led(1, 2, 3)), other], NOW, 0.2).frame
        assert [robot["address"] for robot in frame["data"]["joined"]] == [other.address]
        assert [change["address"] for change in frame["data"]["changed"]] == [here.address]

    def test_a_cleared_history_is_told(self):
        swarm, frames = Dotbots(1, 1, lambda: NOW), StateUpdates()
        address = swarm.robots()[0].address
        swarm.drive(address, 100, 100)
        swarm.step(0.5)
        frames.next(swarm.robots(), NOW, 0.0)
        swarm.clear_history(address)
        frame = frames.next(swarm.robots(), NOW, 0.1).frame
        assert frame["data"]["changed"] == [{"address": address, "history_cleared": True}]
