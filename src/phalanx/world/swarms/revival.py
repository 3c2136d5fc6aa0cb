"""Revive a stopped simulated robot: new trusted nodes, empty memory, and its honest controller.

The mission key and the clock stay the same, so that earlier tokens remain invalid. A real robot needs a new mission
key: in Safe Mode its a-node accepts no commands.
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

# Kept in a robot's memory: its id, and its last request number, so that other robots accept the next one as new.
KEPT = ("id", "request_no")


class Factory:
    """Factory of trusted nodes that stores their keys, to create another pair for the same simulated robot."""

    def __init__(self) -> None:
        self._masters: dict[int, tuple[bytes, int]] = {}
        self._missions: dict[int, MissionKey] = {}
        self._limits: Limits | None = None

    def __call__(self, n: int, profile: int, limits: Limits) -> Nodes:
        """Return the nodes of n robots; see `Setup.make_nodes`."""
        self._limits = limits
        return _Remembered(n, profile, limits, self._masters, self._missions)

    def another(self, i: int, profile: int, now_ms: int) -> Nodes:
        """Return a new pair of nodes for one robot, with the keys of robot i, loaded at `now_ms`."""
        assert self._limits is not None, "called after the swarm was created"
        nodes = Nodes(1, profile, self._limits)
        nodes.load_master(0, *self._masters[i])
        nodes.load_mission(0, now_ms, self._missions[i])
        return nodes


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
    """Restart robot i where it stands; `robot` runs it, if it runs in Python.

    The world's time must be a multiple of the control period, to which readings are aligned. The events of the robot's
    last round must have passed: it must have been stopped for longer than a round.
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
    """Clear the c-node's memory."""
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
