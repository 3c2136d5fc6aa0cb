"""The simulated world as arrays: bodies, one radio channel, and the fleet's nodes; loop.py advances it.

There may be more bodies and radios than robots. Those after the last robot are stations, such as a gateway's radio:
they have no trusted nodes and no controller.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from numpy.typing import NDArray

from phalanx.arrays import F64x1, F64x2, I32x1, I64x1, I64x2, Records, U8x1, U8x2, layout
from phalanx.bti.fleet import Fleet, held_tokens, records
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import Work
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.wire.fields import prefetch
from phalanx.world.radio.channel import Air
from phalanx.world.radio.nic import NIC
from phalanx.world.radio.reach import Reach

from .events import Queue

# How a robot runs: compiled; in Python, event by event (an attack, a user's controller); or in Python for a trace, with
# the same result as compiled.
COMPILED, PYTHON, TRACED = 0, 1, 2
VERDICTS = 4096
Verdict = tuple[float, int, int, Refusal]
# Bytes of a row to prefetch: fields that every event reads come first; most controllers' states have this length.
HOT_BYTES, STATE_BYTES, NIC_BYTES = 192, 256, NIC.itemsize
# Swarms of at most this size fit into the caches, where prefetching would cost 2 %.
CACHED_ROBOTS = 500

CLOCK = layout(
    "now_us i8",
    "check_us i8",  # period of CheckTokens, 0 without a defence
    "move_us control_us i8",
    "audit_us i8",  # period of rounds, 0 without a defence
    "contact_m f8",
    "contacts i8",
    "crowded i8",  # 1 if `reach` ever lacked room for all neighbours: the run is invalid from then on
    "body i8",  # the kind of body: body.POINT_MASS or body.WHEELS
    # The transmission that is being delivered.
    "sender next receivers arrived i8",
    # The event that waits for Python.
    "kind robot i8",
    "arg i8",  # for SENT: whether the packet arrived; for ROUND: whether the robot has listened
    "verdicts i8",  # count since the start; the ring keeps the newest
)


class World(NamedTuple):
    """All arrays that a run changes. Of M bodies the first N are robots."""

    clock: Annotated[Any, Records(CLOCK)]  # (1,)
    fleet: Fleet  # the robots' nodes
    work: Work  # scratch memory
    queue: Queue  # future events
    air: Air  # the channel
    reach: Reach  # neighbour lists, rebuilt every 50 ms
    pos: F64x2  # (M, 2), m
    vel: F64x2  # (M, 2), m/s; with wheels, [:, 0] is the direction in degrees
    acc: F64x2  # (M, 2), m/s²; for wheels, speed of each as a share of the largest
    last: F64x2  # (M, 2), `pos` at the last check for contacts
    led: U8x2  # (M, 3)
    area: F64x1  # (2,), m, area that wheeled robots cannot leave
    discs: F64x2  # (D, 3), obstacles (body.obstacle_contacts)
    boxes: F64x2  # (B, 4), the same
    moved_us: I64x1  # (M,), time at which `pos` and `vel` hold
    boot_us: I64x1  # (N,), offset of a robot's clock from the world's
    runs: U8x1  # (N,), COMPILED, PYTHON or TRACED
    safe: U8x1  # (N,), in Safe Mode
    safe_us: I64x1  # (N,), start of Safe Mode, -1 if never
    retry_us: I64x1  # (N,), time of the next RETRY, -1 if none
    receivers: I32x1  # (M,), of the transmission that is being delivered
    packet: U8x1  # that transmission's bytes, or the packet for Python
    packet_len: I64x1  # (1,), its length
    reading: U8x1  # (64,)
    verdicts: I64x2  # (VERDICTS, 4): time µs, auditor, auditee, refusal


pack = bundled(World)


@kernel
def clock_ms(world: World, i: int) -> int:
    """Return the time of robot i's own clock, ms. Source: docs/spec/rebound.md."""
    return int((world.clock[0].now_us + world.boot_us[i]) // 1000)


def make_clock() -> NDArray[Any]:
    """Return a clock at 0."""
    return records(1, CLOCK)


# --- prefetching rows for the next event: the caches do not hold all rows of a large swarm ---


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
    """Prefetch the end of robot i's log."""
    f = world.fleet
    if len(f.robot) > CACHED_ROBOTS:
        at, front = f.robot[i].log_len, f.log.shape[1]
        if at < front:
            prefetch(f.log, i, at, 1)
        else:
            prefetch(f.log_rest, i, at - front, 1)


# --- observation: tokens held by a robot, and results of audits ---


def shields(world: World, i: int) -> list[tuple[int, float]]:
    """Return the auditors whose tokens robot i holds, each with the seconds left, longest first; none in Safe Mode.

    Source: RoboRebound §3.5.
    """
    if world.safe[i]:
        return []
    return sorted(held_tokens(world.fleet, i, clock_ms(world, i)), key=lambda each: -each[1])


class VerdictReader:
    """Iterator over verdicts; if more than VERDICTS came since the last call, the oldest are lost."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._read = 0

    def new(self) -> list[Verdict]:
        """Return the verdicts since the last call: time s, auditor, auditee, refusal or NONE. Source: §3.7."""
        total = int(self._world.clock[0].verdicts)
        first = max(self._read, total - VERDICTS)
        self._read = total
        rows = (self._world.verdicts[k % VERDICTS] for k in range(first, total))
        return [(int(t) / 1e6, int(auditor), int(auditee), Refusal(int(why))) for t, auditor, auditee, why in rows]
