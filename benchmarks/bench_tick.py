"""What a tick costs the gateway, in shares of the time there is for it."""

from __future__ import annotations

import gc
import os
import statistics
import time

from bench_codec import fresh_epoch
from rows import Row, timed

from phalanx.crypto import IV_BYTES
from phalanx.gateway.frames import StateUpdates
from phalanx.gateway.gateway import TICK_S
from phalanx.gateway.running import WORLD_HZ
from phalanx.link.envelope import encode_envelope, seal
from phalanx.robot import Point
from phalanx.world.swarms.dotbots import Dotbots


def driving(count: int) -> Dotbots:
    """A swarm of which one half is driven and the other half follows a route; nobody stands still."""
    swarm = Dotbots(count, seed=0, clock=time.time)
    for i, robot in enumerate(swarm.robots()):
        if i % 2:
            swarm.follow(robot.address, [Point(200.0 + 1600 * (j % 2), 100.0 * (j % 19)) for j in range(60)], 60)
        else:
            swarm.drive(robot.address, 60, 55)
    return swarm


def bench_tick(robots: int, repetitions: int, ticks: int) -> list[Row]:
    """Everything for visitors in one tick: where robots are, the frames, each sealed; then a step of the world."""
    swarm, frames, epoch = driving(robots), StateUpdates(), fresh_epoch()
    uptime_s = 0.0
    times: list[float] = []
    for _ in range(repetitions):
        gc.collect()
        spent_s = 0.0
        for _ in range(ticks):
            swarm.step(TICK_S)
            uptime_s += TICK_S
            began = time.perf_counter()
            now_s = time.time()
            tick = frames.next(swarm.robots(), now_s, uptime_s)
            seal(encode_envelope(tick.frame, now_s), epoch, os.urandom(IV_BYTES))
            spent_s += time.perf_counter() - began
        times.append(spent_s / ticks * 1e6)
    steps = [timed(lambda: swarm.step(1 / WORLD_HZ), ticks) for _ in range(repetitions)]
    return [
        Row(
            section=0,
            what=f"tick of {robots} robots made and sealed",
            measured=statistics.median(times) / 1000,
            unit="ms",
            note=f"{statistics.median(times) / TICK_S / 1e4:.1f} % of a core",
        ),
        Row(
            section=0,
            what="… their world one step on (Dotbots.step)",
            measured=statistics.median(steps) / 1000,
            unit="ms",
            note=f"{statistics.median(steps) * WORLD_HZ / 1e4:.1f} % of a core",
        ),
    ]
