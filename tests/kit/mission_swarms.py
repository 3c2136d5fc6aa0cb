"""Robots on a small mission behind the gateway, silent or in a process."""

from __future__ import annotations

import os
from contextlib import contextmanager

import yaml

from commands import child
from phalanx.mission import BuildOptions, build, plain_mission
from phalanx.mission.landmarks import floorplan_of_yaml
from phalanx.world.missions.live import Moment, RobotTruth
from phalanx.world.missions.orders import orders_of
from phalanx.world.swarms.mission import MissionSwarm

NOW = 1_700_000_000.0
# One room, 8 by 6 m, with a door to another: a mission in it takes seconds.
SMALL = """
name: two rooms
size: [8.0, 6.0]
start_pose: [1.5, 3.0, 0.0]
walls:
- [0, 0, 8, 0]
- [8, 0, 8, 6]
- [8, 6, 0, 6]
- [0, 6, 0, 0]
- [5, 0, 5, 2.4]
- [5, 3.6, 5, 6]
"""
THROUGH = """
mission: through
coding: {delta_mm: 400, kdf_log2_n: 4}
nodes:
  start: {start: true, see: {position: [1.5, 3.0]}}
  door: {see: {doorway: [5.0, 3.0], facing: 90}, width: 1.2, within_m: 1.5, final: true}
ways:
  - [start, door]
"""
PLAN = floorplan_of_yaml(SMALL.encode())


def plain_of(text: str = THROUGH):
    return plain_mission(yaml.safe_load(text))


def orders(text: str = THROUGH, plan=PLAN, **options):
    plain = plain_of(text)
    return orders_of(plain, build(plain, BuildOptions(**options), os.urandom), plan)


class Silent(MissionSwarm):
    """A swarm without its process: what robots do is said by the test."""

    def __init__(self, count: int = 2, plan=PLAN):
        super().__init__(plan, count, 0, lambda: NOW)
        self.sent: list[tuple] = []
        self._pipe = self

    def send(self, message):
        self.sent.append(message)

    def poll(self):
        return False

    def say(self, *news, phases=("seeking", "seeking"), at=((1.5, 3.0), (1.5, 3.0)), drift=(0, 0, 0)):
        standing = tuple(RobotTruth(*place, 0.0, phase, "", drift=drift) for phase, place in zip(phases, at))
        self._take(Moment(standing, news))


@contextmanager
def a_mission_gateway(*arguments: str):
    """Like `a_gateway`, with robots that live missions."""
    with child("up", "--events", "--port", "0", *arguments) as running:
        yield running, running.wait_for("ready")


def addresses(swarm):
    return [robot.address for robot in swarm.robots()]
