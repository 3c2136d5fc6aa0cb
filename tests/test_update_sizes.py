"""Updates are short whatever happens to robots, and whatever happens is told in turns that come soon."""

from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirror import Mirror, are_near
from phalanx.gateway.frames import CHANGES_BYTES, UNIT_ROBOTS, StateUpdates, tick_bytes
from phalanx.gateway.outbox import Outbox
from phalanx.gateway.visitors import MOST_DRIVERS
from phalanx.gateway.vocabulary import robot_json
from phalanx.link.envelope import encode_json
from phalanx.link.session.padding import padded_size
from phalanx.robot import Led, Point, Robot

NOW = 1_700_000_000.0
ROBOT_BYTES, ROUTE_BYTES = 420, 420  # of an element of `joined` or `changed`, and of `routes`
NAMES = ["", "Ada", "\U0001f916" * 32, 'a"\\' * 10]


class Fleet:
    """Robots to which anything may happen."""

    def __init__(self, robots: int, seed: int, spread_mm: float) -> None:
        self.chance, self.spread_mm = random.Random(seed), spread_mm
        self.robots: dict[str, Robot] = {}
        self.made = 0
        for _ in range(robots):
            self.join()

    def point(self) -> Point:
        return Point(*(self.chance.uniform(-self.spread_mm, self.spread_mm) for _ in range(2)))

    def route(self) -> tuple[Point, ...]:
        return tuple(self.point() for _ in range(self.chance.choice([0, 1, 5, 65, 65])))

    def join(self) -> None:
        address = f"{self.made:016X}"
        self.made += 1
        led = Led(255, 255, 255)
        self.robots[address] = Robot(address, "robot", self.point(), 0, 3.0, led, self.route(), 40, NOW, ())

    def move(self) -> None:
        for address, robot in self.robots.items():
            self.robots[address] = robot._replace(at=self.point(), direction_deg=self.chance.randrange(360))

    def change(self, share: float) -> None:
        for address, robot in list(self.robots.items()):
            if self.chance.random() < share:
                led, threshold = Led(*self.chance.choices(range(256), k=3)), self.chance.randrange(1, 1000)
                changed = robot._replace(route=self.route(), led=led, threshold_mm=threshold)
                self.robots[address] = changed._replace(battery_v=self.chance.uniform(0, 5))

    def come_and_go(self, share: float) -> None:
        for address in list(self.robots):
            if self.chance.random() < share:
                del self.robots[address]
                self.made += self.chance.choice([0, 200, 5000])
                self.join()


counts = st.one_of(st.integers(1, 130), st.sampled_from([100, 125, 126, 250, 500]))
shares = st.sampled_from([0.0, 0.01, 0.3, 1.0])


any_fleet = given(counts, st.integers(0, 2**32), st.sampled_from([1e3, 9e4, 9e6, 2e7]), shares, shares, shares)


@settings(max_examples=10)
@any_fleet
def test_every_update_is_short_and_all_of_it_is_told_in_the_end(robots, seed, spread_mm, change, come, driven):
    updates_are_short_and_complete(robots, seed, spread_mm, change, come, driven)


@pytest.mark.long
@settings(max_examples=100)
@any_fleet
def test_every_update_of_many_fleets_is_short_and_all_of_it_is_told_in_the_end(
    robots, seed, spread_mm, change, come, driven
):
    updates_are_short_and_complete(robots, seed, spread_mm, change, come, driven)


def updates_are_short_and_complete(
    robots: int, seed: int, spread_mm: float, change: float, come: float, driven: float
) -> None:
    fleet, frames, uptime_s = Fleet(robots, seed, spread_mm), StateUpdates(), 0.0
    told = [robot_json(each, NOW, 0) | {"n": frames.number(each.address)} for each in fleet.robots.values()]
    frames.next(list(fleet.robots.values()), NOW, uptime_s)
    mirror, drivers = Mirror(told), {}

    def tick(more) -> None:
        nonlocal uptime_s
        uptime_s += 0.1
        if come == 0:
            fleet.move()
        sent = frames.next(list(fleet.robots.values()), NOW, uptime_s, more, held=True)
        text = encode_json(sent.frame)
        assert len(text) <= tick_bytes(len(fleet.robots))
        mirror.read(json.loads(text))

    for _ in range(5):
        fleet.change(change)
        fleet.come_and_go(come)
        names = {a: fleet.chance.choices(NAMES, k=MOST_DRIVERS) for a in fleet.robots if fleet.chance.random() < driven}
        drivers |= names
        tick({"drivers": [[frames.number(address), who] for address, who in names.items()]})
    driver_bytes = max((len(encode_json(who)) + 10 for who in drivers.values()), default=0)
    waiting_bytes = robots * (2 * ROBOT_BYTES + ROUTE_BYTES + driver_bytes)
    units = -(-robots // UNIT_ROBOTS)
    for _ in range(3 + 2 * waiting_bytes // (CHANGES_BYTES * units)):
        tick({})
    assert mirror.robots.keys() == fleet.robots.keys()
    for address, robot in fleet.robots.items():
        known, now = mirror.robots[address], robot_json(robot, NOW, 0)
        assert known["rgb_led"] == now["rgb_led"]
        assert known["waypoints_threshold"] == now["waypoints_threshold"]
        assert len(known["waypoints"]) <= len(now["waypoints"])
        if spread_mm <= 1e3:
            assert are_near(known["waypoints"], now["waypoints"])
            assert known["mode"] == now["mode"]
    seen = {address: who for address, who in drivers.items() if address in fleet.robots}
    assert {address: mirror.robots[address].get("drivers") for address in seen} == seen


@pytest.mark.parametrize(("robots", "padded", "most_ticks"), [(100, 2048, 45), (1000, 16 * 1024, 60)])
def test_a_storm_of_routes_fits_two_kib_for_a_hundred_robots_and_sixteen_for_a_thousand(robots, padded, most_ticks):
    fleet, frames = Fleet(robots, 1, 1e3), StateUpdates()
    frames.next(list(fleet.robots.values()), NOW, 0.0)
    waiting, longest = dict.fromkeys(fleet.robots, 0), 0
    routes = [tuple(fleet.point() for _ in range(65)) for _ in range(20)]
    numbers = {frames.number(address): address for address in fleet.robots}
    for n in range(1, 2 * most_ticks):
        fleet.move()
        for address, robot in fleet.robots.items():  # another route for each robot in each tick
            fleet.robots[address] = robot._replace(route=routes[n % 20])
        data = frames.next(list(fleet.robots.values()), NOW, n / 10).frame
        assert padded_size(len(encode_json(data))) <= padded
        for number, *_ in data["data"].get("routes", ()):
            longest = max(longest, n - waiting[numbers[number]])
            waiting[numbers[number]] = n
    assert max(2 * most_ticks - 1 - since for since in waiting.values()) <= most_ticks
    assert longest <= most_ticks


def test_where_robots_are_so_far_apart_that_places_have_no_room_all_take_turns():
    fleet, frames = Fleet(100, 1, 1e3), StateUpdates()
    known = list(fleet.robots.values())
    for k, robot in enumerate(known):  # each has a piece of its own
        frames._numbers[robot.address] = 5000 * k
    frames.next(known, NOW, 0.0)
    seen = {}
    for n in range(1, 20):
        data = frames.next(known, NOW, n / 10).frame
        assert len(encode_json(data)) <= tick_bytes(100)
        seen |= {piece[0]: n for piece in data["data"].get("places", ())}
    assert len(seen) == 100


def test_what_waits_keeps_its_turn_and_is_the_newest():
    outbox, sent = Outbox(), []
    for key in ("a", "b", "c", "a"):
        outbox.put_item((key,), "things", key * 40 + str(len(sent)))
        sent.append(key)
    first = outbox.next(70)
    assert first.lists == {"things": ["a" * 40 + "3"]}
    assert outbox.next(70).lists == first.lists, "until it is sent"
    outbox.sent(first)
    assert outbox.next(1).lists == {"things": ["b" * 40 + "1"]}, "one at least"
    with pytest.raises(ValueError, match="JSON"):
        outbox.put_item(("b",), "things", math.nan)
    assert outbox.next(1000).lists == {"things": ["b" * 40 + "1", "c" * 40 + "2"]}
