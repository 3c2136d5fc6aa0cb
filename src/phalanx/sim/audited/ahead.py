"""Prefetching: ask the processor's caches for the rows that the next event reads.

The memory of a large swarm is not in the caches, and each event would wait for it. Prefetching changes no result.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.memory import prefetch
from phalanx.sim.radio.nic import NIC

from .world import World

# Fields that every event reads lie at the front of a robot's rows; most controllers' states are this long.
HOT_BYTES, STATE_BYTES, NIC_BYTES = 192, 256, NIC.itemsize
# Swarms of up to so many robots fit into the caches: there prefetching would cost 2 %.
CACHED_ROBOTS = 500


@kernel
def prefetch_receiver(world: World, i: int) -> None:
    """Prefetch the rows that robot i reads when it receives a packet."""
    f = world.fleet
    if len(f.robot) > CACHED_ROBOTS and 0 <= i < len(f.robot):
        prefetch(f.robot, i, 0, HOT_BYTES)
        prefetch(f.anode, i, 0, HOT_BYTES)
        prefetch(f.state, i, 0, STATE_BYTES)
        prefetch(f.peer_id, i, 0, 1)


@kernel
def prefetch_event(world: World, i: int) -> None:
    """Prefetch the rows that any event of robot i reads: also its sensors, actuators and radio."""
    robots = len(world.fleet.robot)
    if robots > CACHED_ROBOTS and 0 <= i < robots:
        prefetch_receiver(world, i)
        prefetch(world.fleet.snode, i, 0, HOT_BYTES)
        prefetch(world.pos, i, 0, 1)
        prefetch(world.vel, i, 0, 1)
        prefetch(world.acc, i, 0, 1)
        prefetch(world.air.nic, i, 0, NIC_BYTES)


@kernel
def prefetch_log(world: World, i: int) -> None:
    """Prefetch where robot i logs next."""
    f = world.fleet
    if len(f.robot) > CACHED_ROBOTS:
        at, front = f.robot[i].log_len, f.log.shape[1]
        if at < front:
            prefetch(f.log, i, at, 1)
        else:
            prefetch(f.log_rest, i, at - front, 1)
