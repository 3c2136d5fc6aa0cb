"""Revive a stopped robot of the simulation: new trusted nodes, an empty memory, and its honest controller.

The mission key is the swarm's, and its clock goes on, so that no token of before counts again. A real robot has to be
given a new mission key: in Safe Mode its a-node obeys nobody.
"""

from __future__ import annotations

import numpy as np

from phalanx.bti.fleet import LONG_AGO, Fleet
from phalanx.bti.nodes import Limits, MissionKey, Nodes
from phalanx.pool import NO_ROW, give_back
from phalanx.robot import handlers
from phalanx.robot.robot import Robot
from phalanx.robot.runtime import first_round_ms
from phalanx.world.audited import loop
from phalanx.world.audited.events import push
from phalanx.world.audited.world import COMPILED, PYTHON, World, clock_ms
from phalanx.world.radio.nic import make_nics

# Kept of a robot's memory: its number, and that of its last request, so that others take the next one for a new one.
KEPT = ("id", "request_no")


class Factory:
    """Makes trusted nodes, and keeps what they were given: for a robot of a simulation there is another pair."""

    def __init__(self) -> None:
        self._masters: dict[int, tuple[bytes, int]] = {}
        self._missions: dict[int, MissionKey] = {}
        self._limits: Limits | None = None

    def __call__(self, n: int, profile: int, limits: Limits) -> Nodes:
        """Return the nodes of n robots; see `Setup.make_nodes`."""
        self._limits = limits
        return _Remembered(n, profile, limits, self._masters, self._missions)

    def another(self, i: int, profile: int, now_ms: int) -> Nodes:
        """Return one robot's new pair of nodes, with the keys of robot i, loaded at `now_ms`."""
        assert self._limits is not None, "the swarm was made"
        made = Nodes(1, profile, self._limits)
        made.load_master(0, *self._masters[i])
        made.load_mission(0, now_ms, self._missions[i])
        return made


class _Remembered(Nodes):
    def __init__(
        self,
        n: int,
        profile: int,
        limits: Limits,
        masters: dict[int, tuple[bytes, int]],
        missions: dict[int, MissionKey],
    ) -> None:
        super().__init__(n, profile, limits)
        self._masters, self._missions = masters, missions

    def load_master(self, i: int, key: bytes, robot_id: int) -> None:
        super().load_master(i, key, robot_id)
        self._masters[i] = key, robot_id

    def load_mission(self, i: int, now: int, sealed: MissionKey) -> None:
        super().load_mission(i, now, sealed)
        self._missions[i] = sealed


def revive(world: World, i: int, factory: Factory, seed: int, robot: Robot | None) -> None:
    """Let robot i begin anew where it stands; `robot` runs it, if it runs in Python.

    The world's time is a multiple of the control period, as the robots' readings come on a grid since then. The events
    of the robot's last round have passed: it was stopped for longer than a round takes.
    """
    fleet, now_ms = world.fleet, clock_ms(world, i)
    nodes = factory.another(i, int(fleet.settings[0].profile), now_ms)
    fleet.snode[i], fleet.anode[i] = nodes.snode[0], nodes.anode[0]
    _forget(fleet, i)
    world.air.nic[i] = make_nics(1, seed)[0]
    world.safe[i], world.safe_us[i], world.retry_us[i] = 0, -1, -1
    world.runs[i] = PYTHON if robot else COMPILED
    if robot:
        robot.on_boot(now_ms)
    else:
        handlers.on_boot(fleet, i, now_ms)
    audit_ms = int(world.clock[0].audit_us) // 1000
    first_ms = first_round_ms(int(fleet.settings[0].mission_seed), i + 1, audit_ms)
    push(world.queue, int(world.clock[0].now_us) + first_ms * 1000, loop.ROUND, i, 0)


def _forget(fleet: Fleet, i: int) -> None:
    """Empty the c-node's memory."""
    robot = fleet.robot[i]
    if robot.request_row != NO_ROW:
        give_back(fleet.request, int(robot.request_row))
    for info in fleet.rx_info[i]:
        if info.src:
            give_back(fleet.rx, int(info.row))
    kept = {name: int(robot[name]) for name in KEPT}
    rows = (fleet.robot, fleet.checkpoint, fleet.hckpt, fleet.token, fleet.peer, fleet.peer_id, fleet.owed)
    for array in (*rows, fleet.state, fleet.rx_info):
        array[i] = np.zeros((), array.dtype)
    for name, value in kept.items():
        fleet.robot[i][name] = value
    fleet.robot[i].request_row = NO_ROW
    fleet.taken[i] = LONG_AGO
