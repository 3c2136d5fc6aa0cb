"""A gateway before robots of ROS 2: real nodes, real DDS on loopback, the example's wheels without guards, and with."""

from __future__ import annotations

import asyncio
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from phalanx.errors import Held, Unavailable, Unknown
from phalanx.net import QrkeyClient
from phalanx.robot import Point
from serving import up_here
from waiting import eventually

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
WORLD = (sys.executable, str(Path(__file__).parent.parent / "examples" / "ros2_world.py"))
APART_M = 8.0


@pytest.fixture
def domain(monkeypatch, tmp_path):
    for name, value in {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path / "ros"),
    }.items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def bases(domain):
    """What begins two robots, 8 m apart, heading north; they are killed at the end."""
    running: list[subprocess.Popen[str]] = []

    def begun(*more):
        words = (*WORLD, "bases", "--robots", "2", "--duration", "200", "--at-once", *more)
        running.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        return running[-1]

    yield begun
    for each in running:
        each.kill()
        each.wait()


def swarm_of(wait_s=30.0):
    from phalanx.bridges.ros2.swarm import RosSwarm

    return RosSwarm(wait_s)


async def test_a_phone_drives_robots_of_ros_2_and_the_operator_stops_them(bases):
    bases()
    with swarm_of() as swarm:
        await eventually(lambda: [each.name for each in swarm.robots()] == ["r1", "r2"], 30)
        first, second = swarm.robots()
        async with (
            up_here(swarm, broker="mosquitto", qrkey=True) as (gateway, ready),
            QrkeyClient(ready["qrkey_url"]) as phone,
        ):
            ahead = {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60}

            async def moves(nth: int) -> None:
                before = swarm.robots()[nth].at
                await eventually(lambda: distance_mm(swarm.robots()[nth].at, before) > 50, 20)

            async def stand() -> None:
                """They have come to rest."""
                at = []
                while at != (at := [each.at for each in swarm.robots()]):
                    await asyncio.sleep(0.3)

            driving = asyncio.ensure_future(repeated(phone, first.address, ahead))
            await moves(0)
            driving.cancel()
            await stand()
            there = swarm.robots()[1].at
            goal = {"x": round(there.x_mm) - 300, "y": round(there.y_mm) - 800}
            await phone.command(second.address, "waypoints", {"threshold": 150, "waypoints": [goal]})
            await eventually(lambda: swarm.robots()[1].route, 10)
            await eventually(lambda: not swarm.robots()[1].route, 40)
            assert distance_mm(swarm.robots()[1].at, Point(goal["x"], goal["y"])) < 250
            far = {"threshold": 100, "waypoints": [{"x": 10_000, "y": 500}]}
            await phone.command(second.address, "waypoints", far)
            await moves(1)
            gateway.hold(True)
            await eventually(lambda: not swarm.robots()[1].route, 10)
            await stand()
            with pytest.raises(Held):
                swarm.drive(second.address, 50, 50)
            gateway.hold(False)
            driving = asyncio.ensure_future(repeated(phone, second.address, ahead))
            await moves(1)
            driving.cancel()


async def test_robots_that_went_away_are_there_again(bases):
    killed = bases()
    with swarm_of() as swarm:
        await eventually(lambda: len(swarm.robots()) == 2, 30)
        killed.kill()
        killed.wait()
        heard_at_s = max(each.heard_at_s for each in swarm.robots())
        bases()
        await eventually(lambda: min(each.heard_at_s for each in swarm.robots()) > heard_at_s + 1, 30)
        assert [each.name for each in swarm.robots()] == ["r1", "r2"]
        with pytest.raises(Unknown):
            swarm.drive("DECAFBAD000000FF", 1, 1)


def test_where_nobody_tells_odometry_it_says_so(domain):
    with pytest.raises(Unavailable, match="no robot"), swarm_of(0.5):
        pass


async def repeated(phone, address, words) -> None:
    while True:
        await phone.command(address, "move_raw", words)
        await asyncio.sleep(0.1)


def distance_mm(one: Point, other: Point) -> float:
    return math.dist((one.x_mm, one.y_mm), (other.x_mm, other.y_mm))
