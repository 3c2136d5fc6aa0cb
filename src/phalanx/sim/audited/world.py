"""The simulated world as arrays: bodies, one radio channel, and the fleet's nodes. The loop over it is in `loop`.

There may be more bodies and radios than robots: those behind the last robot are stations that people talk through,
without trusted nodes and without a controller.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.audit import Work
from phalanx.bti.fleet import Fleet, records
from phalanx.bundle import reference
from phalanx.kernel import kernel
from phalanx.sim.radio.channel import Air
from phalanx.sim.radio.reach import Reach

from .events import Queue

# Who runs a robot: compiled code, or Python events (a lying robot, a researcher's controller).
COMPILED, PYTHON = 0, 1
VERDICTS = 4096

CLOCK = np.dtype(
    [
        ("now_us", "i8"),
        ("check_us", "i8"),  # period of CheckTokens, 0 without a defence
        ("move_us", "i8"),
        ("control_us", "i8"),
        ("audit_us", "i8"),  # period of rounds, 0 without a defence
        ("contact_m", "f8"),
        ("contacts", "i8"),
        ("crowded", "i8"),  # more neighbours than `reach` has room for, once: the run is wrong from then on
        ("body", "i8"),  # what robots are, see `body`
        # A transmission that is being delivered.
        ("sender", "i8"),
        ("next", "i8"),
        ("receivers", "i8"),
        # An event that waits for Python.
        ("kind", "i8"),
        ("robot", "i8"),
        ("arrived", "i8"),
        ("verdicts", "i8"),  # ever; the ring keeps the newest
    ],
    align=True,
)


class World(NamedTuple):
    """Everything a run changes.

    Args:
        clock: (1,) CLOCK.
        fleet: the robots' nodes.
        work: scratch memory.
        queue: events to come.
        air: the channel.
        reach: who hears whom, as of the last 50 ms.
        pos, vel, acc: (M, 2) float64, m, m/s, m/s²; with wheels, vel[:, 0] is the direction in degrees and acc the
            wheels' shares of their speed. M >= N, robots first.
        last: (M, 2) float64, `pos` at the last look at contacts.
        led: (M, 3) uint8.
        area: (2,) float64, m, what wheels stay within.
        discs: (D, 3), boxes: (B, 4) float64, obstacles (motion.obstacle_contacts).
        moved_us: (N,) int64, the moment for which `pos` and `vel` hold.
        boot_us: (N,) int64, by how much a robot's clock is ahead of the world's.
        runs: (N,) uint8, COMPILED or PYTHON.
        safe: (N,) uint8, in Safe Mode; safe_us: (N,) int64, since when, -1 never.
        retry_us: (N,) int64, when the next RETRY is due, -1 if none is.
        receivers: (N,) int32, of the transmission that is being delivered.
        frame: (2048,) uint8, that transmission's bytes, or the frame for Python; its length in frame_len (1,).
        reading: (64,) uint8.
        verdicts: (VERDICTS, 4) int64: time µs, auditor, auditee, refusal.
    """

    clock: NDArray[Any]
    fleet: Fleet
    work: Work
    queue: Queue
    air: Air
    reach: Reach
    pos: NDArray[np.float64]
    vel: NDArray[np.float64]
    acc: NDArray[np.float64]
    last: NDArray[np.float64]
    led: NDArray[np.uint8]
    area: NDArray[np.float64]
    discs: NDArray[np.float64]
    boxes: NDArray[np.float64]
    moved_us: NDArray[np.int64]
    boot_us: NDArray[np.int64]
    runs: NDArray[np.uint8]
    safe: NDArray[np.uint8]
    safe_us: NDArray[np.int64]
    retry_us: NDArray[np.int64]
    receivers: NDArray[np.int32]
    frame: NDArray[np.uint8]
    frame_len: NDArray[np.int64]
    reading: NDArray[np.uint8]
    verdicts: NDArray[np.int64]


WorldType, WorldRef = reference(World)


@kernel
def refer(world: World) -> Any:
    """The world as kernels take it, see `bundle`."""
    return WorldRef(*world)


def make_clock() -> NDArray[Any]:
    """A clock at 0."""
    return records(1, CLOCK)
