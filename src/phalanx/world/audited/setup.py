"""Create a world from its settings: boot robots with keys and unsynchronised clocks; push the first events."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.fleet import HARDENED, PAPER, PLAIN, make_fleet
from phalanx.bti.nodes import Limits, MissionKey, Nodes, TrustedNodes, limits_of, seal_mission_key
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.config.bti import FRAGMENT_HEAD_BYTES, REQUEST_OVERHEAD_BYTES
from phalanx.config.flock import Box, Disc
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.robot import handlers
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers import dispatch
from phalanx.robot.robot import Robot
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.airtime import rates_of, unicast_us
from phalanx.wire.fields import Row
from phalanx.wire.table import KEY_BYTES
from phalanx.world.radio.channel import NOBODY, make_air
from phalanx.world.radio.reach import SKIN, SMALL_SWARM, Reach, make_reach, rebuild, set_aisles

from . import loop, pybot
from .events import CONTROL, make_queue, push
from .world import PYTHON, VERDICTS, World, clock_ms, make_clock, pack

# A robot's master key (20 bytes, secret) and its sealed mission key.
Board = tuple[bytes, MissionKey]
PROFILES = {"none": PLAIN, "paper": PAPER, "hardened": HARDENED}
MOVE_US = 50_000
# All robots boot within this time.
POWER_UP_MS = 60_000
# Extra room for neighbours in a large swarm's lists, in addition to twice n_max.
ROOM = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Settings of a world."""

    robots: int  # N
    starts_m: NDArray[np.float64]  # (M, 2), initial positions of robots, then of stations
    profile: int  # of the trusted nodes: HARDENED, PAPER or PLAIN
    controller: int  # number of the bundled controller (dispatch.NUMBERS), 0 for one in plain Python
    params: NDArray[np.float64]  # parameters of the controller
    body: int  # POINT_MASS or WHEELS, see `body.driven_by`
    seed: int  # of phases and back-offs
    contact_m: float  # distance of two robots' centres in contact
    bti: BtiConfig
    radio: RadioConfig
    obstacles: Sequence[Disc | Box] = ()  # count as contacts
    area_m: tuple[float, float] = (0.0, 0.0)  # area that wheeled robots cannot leave
    plain: bool = False  # use the simplest computation everywhere, as a reference for tests
    hub: int = 0  # the first `hub` robots are in range as usual; each other robot is in an aisle and hears only them
    # Manipulation of an a-node by a compromised c-node before the mission key is loaded, by index (Liar).
    before_key: Mapping[int, Callable[[int, int, Row, int], None]] = field(default_factory=dict)
    make_nodes: Callable[[int, int, Limits], TrustedNodes] = Nodes  # arguments: robots, profile, limits
    boards: Sequence[Board] = field(default=(), repr=False)  # keys of each robot; () draws random ones


def audits_share(config: BtiConfig, radio: RadioConfig, robots: float, *, filled: bool = False) -> float:
    """Return the share of airtime, 0 to 1, that audit requests of that many robots take if all are in one range.

    Each T_audit a robot sends f_max + 1 auditors a checkpoint and the log since. `filled`: f_max compromised robots
    fill that log to its capacity. The result is up to a quarter below measurements with 25 to 120 honest robots and
    f_max 3 to 8.
    """
    neighbours = min(max(math.ceil(robots) - 1, config.quorum), config.n_max)
    seen = replace(config, n_max=neighbours)
    grows = 1000 * seen.log_capacity_bytes / seen.t_val_ms if filled else seen.log_bytes_per_s
    shown = grows * seen.t_audit_ms / 1000 + seen.checkpoint_capacity_bytes + REQUEST_OVERHEAD_BYTES
    whole, rest = divmod(math.ceil(shown), seen.packet_max_bytes - FRAGMENT_HEAD_BYTES)
    rates = rates_of(radio)
    request_us = whole * unicast_us(rates, seen.packet_max_bytes) + unicast_us(rates, FRAGMENT_HEAD_BYTES + rest)
    return robots * seen.tokens_needed * request_us / (1000 * seen.t_audit_ms)


def make_lists(bodies: int, config: BtiConfig, radio: RadioConfig, *, skin: float) -> Reach:
    """Return empty neighbour lists, with room for more than n_max neighbours."""
    room = None if bodies <= SMALL_SWARM else bodies * (2 * config.n_max + ROOM)
    return make_reach(bodies, radio.range_m, room, skin=skin)


def power_up(
    n: int,
    profile: int,
    limits: Limits,
    now_ms: NDArray[np.int64],
    chance: np.random.Generator,
    before_key: Mapping[int, Callable[[int, int, Row, int], None]],
    make_nodes: Callable[[int, int, Limits], TrustedNodes] = Nodes,
    boards: Sequence[Board] = (),
) -> TrustedNodes:
    """Return trusted nodes of robots 1..n, with a mission key loaded at `now_ms`, (n,).

    Without `boards` the keys are random, with one master key for all: simulated keys need no secrecy.
    Source: RoboRebound §3.3, Alg. 2.
    """
    nodes = make_nodes(n, profile, limits)
    if not boards:
        master, mission, salt = chance.bytes(KEY_BYTES), chance.bytes(KEY_BYTES), chance.bytes(KEY_BYTES)
        boards = [(master, seal_mission_key(master, mission, salt, 1))] * n
    for i, (master, sealed) in enumerate(boards):
        nodes.load_master(i, master, i + 1)
        if i in before_key:
            before_key[i](i + 1, profile, nodes.anode[i], limits.f_max)
        nodes.load_mission(i, int(now_ms[i]), sealed)
    return nodes


def make_world(setup: Setup, chance: np.random.Generator) -> World:
    """Return the world at time 0, with no robot running yet.

    Raises: UsageError: the controller's state can be longer than a checkpoint. Source: docs/spec/world.md.
    """
    n, m = setup.robots, len(setup.starts_m)
    longest = int(dispatch.capacity(setup.controller, setup.params))
    if longest > setup.bti.checkpoint_capacity_bytes:
        raise UsageError(f"a controller with {longest} bytes of state", f"use BtiConfig(state_bytes={longest})")
    boot_us = chance.integers(1, POWER_UP_MS, n) * 1000
    snode, anode = np.zeros((n, 8), np.uint8), np.zeros((n, 8), np.uint8)
    if setup.profile != PLAIN:
        limits = limits_of(setup.bti, setup.radio)
        before_key, boot_ms = setup.before_key, boot_us // 1000
        nodes = power_up(n, setup.profile, limits, boot_ms, chance, before_key, setup.make_nodes, setup.boards)
        snode, anode = nodes.snode, nodes.anode
    fleet = make_fleet(
        n,
        setup.bti,
        setup.params,
        profile=setup.profile,
        controller=setup.controller,
        mission_seed=setup.seed,
        plain=setup.plain,
        snode=snode,
        anode=anode,
    )
    world = World(
        clock=make_clock(),
        fleet=fleet,
        work=make_work(setup.bti),
        queue=make_queue(16 * m + 64),
        air=make_air(m, setup.radio, setup.seed),
        reach=make_lists(m, setup.bti, setup.radio, skin=0.0 if setup.plain else SKIN),
        pos=np.full((m, 2), setup.starts_m),
        vel=np.zeros((m, 2)),
        acc=np.zeros((m, 2)),
        last=np.full((m, 2), np.nan),
        led=np.zeros((m, 3), np.uint8),
        area=np.array(setup.area_m),
        # As float64 even if given as integers: kernels accept nothing else.
        discs=np.array(
            [(o.x_m, o.y_m, o.radius_m) for o in setup.obstacles if isinstance(o, Disc)], np.float64
        ).reshape(-1, 3),
        boxes=np.array(
            [(o.left_m, o.bottom_m, o.right_m, o.top_m) for o in setup.obstacles if isinstance(o, Box)], np.float64
        ).reshape(-1, 4),
        moved_us=np.zeros(m, np.int64),
        boot_us=np.full(n, boot_us, np.int64),
        runs=np.zeros(n, np.uint8),
        safe=np.zeros(n, np.uint8),
        safe_us=np.full(n, -1, np.int64),
        retry_us=np.full(n, -1, np.int64),
        receivers=np.zeros(m, np.int32),
        packet=np.zeros(setup.radio.long_bytes + 64, np.uint8),
        packet_len=np.zeros(1, np.int64),
        reading=np.zeros(64, np.uint8),
        verdicts=np.zeros((VERDICTS, 4), np.int64),
    )
    if setup.hub:
        set_aisles(world.reach, setup.hub, n)
    clock, audited = world.clock[0], setup.profile != PLAIN
    clock.sender, clock.body, clock.contact_m = NOBODY, setup.body, setup.contact_m
    clock.move_us, clock.control_us = MOVE_US, setup.bti.t_control_ms * 1000
    clock.audit_us = setup.bti.t_audit_ms * 1000 if audited else 0
    clock.check_us = setup.bti.p_check_ms * 1000 if audited else 0
    return pack(world)


def start(world: World, robots: Mapping[int, Robot]) -> None:
    """Boot all c-nodes, those in `robots` (by index) in Python, and push the first events.

    Source: RoboRebound §3.6.
    """
    clock, settings = world.clock[0], world.fleet.settings[0]
    rebuild(world.reach, world.pos)
    push(world.queue, MOVE_US, loop.MOVE, 0, 0)
    if clock.check_us:
        push(world.queue, int(clock.check_us), loop.CHECK, 0, 0)
    for i in range(len(world.fleet.robot)):
        now_ms = clock_ms(world, i)
        robot = robots.get(i)
        if robot:
            world.runs[i] = PYTHON
            robot.on_boot(now_ms)
        else:
            handlers.on_boot(world.fleet, i, now_ms)
        # Half a millisecond later, so that the robot's clock shows the intended millisecond despite rounding.
        push(world.queue, int(world.fleet.robot[i].phase) * 1000 + 500, CONTROL, i, 0)
        if clock.audit_us:
            first_us = first_round_ms(int(settings.mission_seed), i + 1, int(clock.audit_us) // 1000) * 1000
            push(world.queue, first_us, loop.ROUND, i, 0)
        if isinstance(robot, Liar):
            pybot.wake(world, robot, 0)
