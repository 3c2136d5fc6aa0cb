"""Protected swarm of the demo: wheeled robots that audit each other, driven by orders over their radio.

A station in the middle sends the orders of visitors and the operator (station.py). Robots log them, and audits replay
their effect like any other input.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from numpy.typing import NDArray

from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig, RadioConfig, WheelsConfig
from phalanx.errors import Unknown, UsageError
from phalanx.robot import Led, Point, Robot
from phalanx.robot.adversary.liar import Liar, Plan, lying
from phalanx.robot.adversary.registry import attacks
from phalanx.robot.controllers import dispatch, orders
from phalanx.robot.controllers.bundled import wheels
from phalanx.robot.controllers.peer_bodies import STANDS_MM
from phalanx.robot.robot import Robot as AuditedRobot
from phalanx.robot.roster import HISTORY_STEP_MM, Member, member
from phalanx.robot.signer import Signer
from phalanx.robot.station import Ordered, Station
from phalanx.robot.swarm import AttackChoice, Audit, Done, Shield
from phalanx.scenarios.behaviour import FOREVER_MS
from phalanx.scenarios.scenario import ORDERS_AS_NEIGHBOURS
from phalanx.wire.driven import EVERYBODY, GATEWAY, OPERATOR, SIGNER_KEY_BYTES
from phalanx.wire.fields import get_u64
from phalanx.world.audited import loop, pybot
from phalanx.world.audited.body import driven_by
from phalanx.world.audited.events import refused
from phalanx.world.audited.setup import PROFILES, Board, Setup, make_world, start
from phalanx.world.audited.world import PYTHON, VerdictReader, World, clock_ms, shields
from phalanx.world.radio.channel import BROADCAST

from .dotbots import AREA_MM, BATTERY_EMPTY_MV, BATTERY_FULL_MV, DRIVE_MVPS, IDLE_MVPS
from .revival import Factory, revive
from .work import Work

# More robots in one radio range saturate the channel: audits would be late, and honest robots stopped.
MOST_ROBOTS = 100
# Ten control steps per second, for a responsive joystick; the rest are the paper's parameters.
DEMO = BtiConfig(t_control_ms=100, steps_per_state=15, delta_ms=40)
EDGE_MM = 200.0
# Distance that keeps robots distinguishable on a phone. If they do not fit, TRIES draws find the largest distance.
APART_MM = 200.0
TRIES = 64
# Attack offered first to operators, because its effect is obvious.
FIRST_CHOICE = "hijack"
FULL_TURN_DEG = 360.0
# Separates the random stream of the station's keys from others of the same seed.
STATION = 0x0DE5
LAST_EVENTS_MS = 1000  # margin after a round, by which a stopped robot has no events left
MISSION = 1  # number of the mission key at the start
HEARD_AT = wheels.SIGNERS + orders.EACH_BYTES * GATEWAY + orders.HIGHEST


def fewest_robots(f_max: int) -> int:
    """Return the least number of robots that can lose f_max and still get f_max + 1 tokens from each other.

    P2 needs one more: `BtiConfig.least_robots`. With fewer, compromised robots can cause others to be stopped.
    """
    return 2 * f_max + 2


def draw_places(count: int, chance: np.random.Generator) -> NDArray[np.float64]:
    """Draw positions inside the area, APART_MM from each other, or as far as TRIES draws allow.

    Returns: (count, 2), mm.
    """
    places = np.empty((count, 2))
    for i in range(count):
        tried = chance.uniform(EDGE_MM, np.array(AREA_MM) - EDGE_MM, (TRIES, 2))
        nearest = np.linalg.norm(tried[:, None] - places[:i], axis=2).min(axis=1, initial=APART_MM)
        places[i] = tried[nearest.argmax()]
    return places


@dataclass(frozen=True, slots=True, repr=False)
class SwarmKeys:
    """Keys that the owner of a swarm issues for one mission."""

    mission: int
    boards: Sequence[Board]  # of each robot, in the order of ids
    gateway: Ed25519PrivateKey  # signs visitors' orders
    operator: Ed25519PrivateKey  # signs stop orders


def drawn_keys(seed: int) -> SwarmKeys:
    """Return random keys for a simulation, where they need no secrecy; boards' keys are drawn by the world."""
    chance = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, STATION])))
    gateway, operator = (Ed25519PrivateKey.from_private_bytes(chance.bytes(SIGNER_KEY_BYTES)) for _ in range(2))
    return SwarmKeys(MISSION, (), gateway, operator)


class StationAir:
    """Simulated radio of the station in the middle: the row after the robots'."""

    def __init__(self, world: World, row: int) -> None:
        self._world, self._row = world, row

    def is_busy(self) -> bool:
        """See `phalanx.robot.station.Air`."""
        return bool(self._world.air.nic[self._row].long_used)

    def is_permanently_stopped(self, robot: int) -> bool:
        """See `phalanx.robot.station.Air`."""
        return bool(self._world.safe[robot - 1])

    def say(self, packet: bytes, robot: int) -> None:
        """See `phalanx.robot.station.Air`."""
        to = BROADCAST if robot == EVERYBODY else robot - 1
        loop.transmit(self._world, self._row, np.frombuffer(bytearray(packet), np.uint8), len(packet), to)


class ProtectedSwarm(Ordered):
    """A `phalanx.robot.swarm.AuditedSwarm` of 2 f_max + 2 to 100 simulated robots, advanced by `step`.

    If f_max are stopped, each of the others still gets f_max + 1 tokens. The clock returns seconds since 1970.
    Without `keys` random ones are used. With a `protocol`, one of ON_WHEELS, idle robots do its work; with
    `keeps_apart` they always avoid each other, also when driven by a visitor.
    Raises: UsageError: the count is out of range.
    """

    def __init__(
        self,
        count: int,
        seed: int,
        clock: Callable[[], float],
        *,
        defence: str = "hardened",
        f_max: int = 3,
        keys: SwarmKeys | None = None,
        protocol: str = "",
        keeps_apart: bool = False,
    ) -> None:
        if not fewest_robots(f_max) <= count <= MOST_ROBOTS:
            raise UsageError(
                f"{count} robots in one radio range cannot audit each other with f_max {f_max}",
                f"{fewest_robots(f_max)} to {MOST_ROBOTS} robots, or --defence none",
            )
        keys = keys or drawn_keys(seed)
        station = Station(Signer(keys.gateway, keys.mission, GATEWAY), Signer(keys.operator, keys.mission, OPERATOR))
        super().__init__((member(i) for i in range(count)), range(1, count + 1), station)
        chance = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0x7077])))
        self._chance, self._clock = chance, clock
        self._config = replace(DEMO, f_max=f_max, n_max=count + ORDERS_AS_NEIGHBOURS)
        places_mm = draw_places(count, chance)
        middle_m = np.array([AREA_MM]) / 2000
        params = wheels.CONTROLLER.params(
            WheelsConfig(
                state_every=self._config.steps_per_state,
                mission=keys.mission,
                gateway_key=station.gateway.public,
                operator_key=station.operator.public,
            )
        )
        self._work: Work | None = None
        if protocol:
            self._work = Work(protocol, self._config, params, places_mm / 1000, seed, keeps_apart=keeps_apart)
            self._config = self._work.bti
        self._factory, self._seed = Factory(), seed
        self.world = make_world(
            Setup(
                robots=count,
                starts_m=np.vstack((places_mm / 1000, middle_m)),
                profile=PROFILES[defence],
                controller=0 if self._work else dispatch.NUMBERS["wheels"],
                params=params,
                body=driven_by(wheels.CONTROLLER),
                seed=seed,
                contact_m=0.08,
                bti=self._config,
                radio=RadioConfig(),
                area_m=(AREA_MM[0] / 1000, AREA_MM[1] / 1000),
                boards=keys.boards,
                make_nodes=self._factory,
            ),
            chance,
        )
        self._air = StationAir(self.world, count)
        self.world.vel[:count, 0] = chance.uniform(0, FULL_TURN_DEG, count)
        self._battery_mv = BATTERY_EMPTY_MV + chance.uniform(0.5, 1.0, count) * (BATTERY_FULL_MV - BATTERY_EMPTY_MV)
        # Set by another thread, applied in the next step.
        self._to_stop = set[int]()
        self._to_revive = set[int]()
        self._liars: dict[int, Liar] = {}
        # Robots that run in Python, by row.
        self._nodes: dict[int, AuditedRobot] = {}
        if self._work:
            make = self._work.make_controller
            self._nodes = {i: AuditedRobot(self.world.fleet, i, self.world.work, make) for i in range(count)}
        self._verdicts = VerdictReader(self.world)
        self._now_s = 0.0
        self._stopped_at_s: dict[int, float] = {}
        start(self.world, self._nodes)
        for i, each in enumerate(self._members):
            self._show(i, each.led)
            each.led = Led(0, 0, 0)

    # --- the swarm ----------------------------------------------------------------------------------------------------

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return width and height of the area."""
        return AREA_MM

    def robots(self) -> Sequence[Robot]:
        """Return all robots with their true poses."""
        now = self._clock()
        found = []
        for i, each in enumerate(self._members):
            x_m, y_m = self.world.pos[i].tolist()
            each.led = Led(*self.world.led[i].tolist())
            direction_deg, battery_v = round(float(self.world.vel[i, 0])), float(self._battery_mv[i]) / 1000
            seen_at_s = self._stopped_at_s.get(i, now)
            found.append(each.snapshot(Point(x_m * 1000, y_m * 1000), direction_deg, battery_v, seen_at_s))
        return found

    def stop(self, address: str) -> None:
        """Stop a robot until the next order."""
        self._to_stop.add(self._find(address))

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Drive to these points in order; an empty route stops the robot.

        Raises: UsageError: more than `longest_route`.
        """
        i = self._find(address)
        self._follow(i, route, threshold_mm, Point(*(self.world.pos[i] * 1000).tolist()))

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        while self._to_stop:
            self.drive(self._members[self._to_stop.pop()].address, 0, 0)
        end_s, looks = self._now_s + dt_s, self._work.looks if self._work else None
        while self._now_s < end_s:
            self._now_s = min(end_s, self._station.send_due(self._air, self._now_s, self._now_ms), self._next_grid_s())
            until_us = round(self._now_s * 1e6)
            while loop.run(self.world, until_us) == loop.FOR_PYTHON:
                pybot.handle(self.world, self._nodes, stage=looks)
            self._revive()
        for node in self._nodes.values():
            node.flush_state()
        assert refused(self.world.queue) == 0, "the event queue overflowed"
        effort = np.abs(self.world.acc[: len(self._members)]).mean(axis=1)
        drained = self._battery_mv - (IDLE_MVPS + DRIVE_MVPS * effort) * dt_s
        # An empty robot gets a fresh battery in place, because auditors must not leave.
        self._battery_mv = np.where(drained <= BATTERY_EMPTY_MV, BATTERY_FULL_MV, drained)
        for i in np.flatnonzero(effort > 0).tolist():
            x_mm, y_mm = (self.world.pos[i] * 1000).tolist()
            self._members[i].append_position(x_mm, y_mm, HISTORY_STEP_MM)
        for i, each in enumerate(self._members):
            state, ordered = self.world.fleet.state[i], self._station.last_order_number(i + 1)
            # The robot has received its last order, and has no route left.
            is_free = ordered is not None and get_u64(state, HEARD_AT) >= ordered and not state[wheels.COUNT]
            if each.route and is_free:
                each.route = ()
            if self.world.safe[i] and i not in self._stopped_at_s:
                self._stopped_at_s[i] = self._clock()
                each.route = ()
            elif self._work and is_free:
                self._show_goal(self._work, i, each)

    def _show_goal(self, work: Work, i: int, each: Member) -> None:
        """Show the goal of a robot that works by itself as a route of one point."""
        aim_m, (x_m, y_m) = work.aim_m(self._nodes[i].controller, clock_ms(self.world, i)), self.world.pos[i].tolist()
        if aim_m is None or self.world.safe[i] or math.dist(aim_m, (x_m, y_m)) < 2 * STANDS_MM / 1000:
            each.route = ()
        elif not each.route or each.route[-1] != Point(aim_m[0] * 1000, aim_m[1] * 1000):
            each.route = (Point(x_m * 1000, y_m * 1000), Point(aim_m[0] * 1000, aim_m[1] * 1000))

    # --- its work -----------------------------------------------------------------------------------------------------

    def done(self) -> Done | None:
        """Return the work's score, about once a second; None while robots wait for visitors."""
        return self._work.done(self._now_s) if self._work else None

    def things(self) -> Sequence[Point]:
        """Return the places of the work's objects in the area."""
        return [Point(x * 1000, y * 1000) for x, y in self._work.objects_m(self._now_s)] if self._work else ()

    # --- the shields --------------------------------------------------------------------------------------------------

    def shields(self) -> Sequence[Shield]:
        """Return every robot's tokens and state."""
        return [self._shield(i) for i in range(len(self._members))]

    def _shield(self, i: int) -> Shield:
        liar = self._liars.get(i)
        return Shield(
            address=self._members[i].address,
            needed=self._config.tokens_needed,
            full_s=self._config.t_val_ms / 1000,
            vouchers=tuple((self._members[auditor - 1].address, left_s) for auditor, left_s in shields(self.world, i)),
            safe_mode=bool(self.world.safe[i]),
            attack=liar.attack.name if isinstance(liar, Liar) else "",
        )

    def new_audits(self) -> Sequence[Audit]:
        """Return the audits that ended since the last call, oldest first."""
        return [
            Audit(
                auditor=self._members[auditor - 1].address,
                auditee=self._members[auditee - 1].address,
                refusal="" if why is Refusal.NONE else why.name.lower().replace("_", " "),
            )
            for _, auditor, auditee, why in self._verdicts.new()
        ]

    def attacks(self) -> Sequence[AttackChoice]:
        """Return the attacks that a robot can run, the most visible first."""
        own = self._work.protocol if self._work else None
        choices = [
            AttackChoice(name, attack.does)
            for name, attack in attacks().items()
            if (attack.scene == "flock" and attack.on_wheels) or (attack.scene == "protocol" and attack.against == own)
        ]
        return sorted(choices, key=lambda choice: choice.name != FIRST_CHOICE)

    def compromise(self, address: str, attack: str) -> None:
        """Compromise a robot from now on."""
        i = self._find(address)
        if attack not in {choice.name for choice in self.attacks()}:
            raise Unknown(f"no attack {attack[:64]!r}")
        if i in self._liars or self.world.safe[i]:
            raise Unknown(f"{self._members[i].name} is compromised or stopped already")
        now_ms = clock_ms(self.world, i)
        plan = Plan(
            ids=tuple(range(1, len(self._members) + 1)),
            goal_m=(0.0, 0.0),
            colluding=tuple(other + 1 for other in self._liars),
            start_ms=now_ms,
            stop_ms=FOREVER_MS,
            chance=self._chance,
        )
        make = self._work.make_controller if self._work else None
        if self._work:
            self._nodes[i].flush_state()  # the compromised robot continues with this state
        liar = lying(attacks()[attack], self.world.fleet, i, self.world.work, plan, make)
        self._liars[i] = self._nodes[i] = liar
        self.world.runs[i] = PYTHON
        pybot.wake(self.world, liar, int(self.world.clock[0].now_us))

    def revive(self, address: str) -> None:
        """Restart a stopped robot with honest code, once its last round is over.

        Raises: Unknown: no such robot, or it is not stopped.
        """
        i = self._find(address)
        if not self.world.safe[i]:
            raise Unknown(f"{self._members[i].name} is not stopped")
        self._to_revive.add(i)

    def _next_grid_s(self) -> float:
        """Return the next time at which a robot may be revived, s; infinity if none waits."""
        grid_s = self._config.t_control_ms / 1000
        return (math.floor(self._now_s / grid_s + 1e-6) + 1) * grid_s if self._to_revive else math.inf

    def _revive(self) -> None:
        now_us, grid_us = int(self.world.clock[0].now_us), self._config.t_control_ms * 1000
        rested_us = (self._config.t_audit_ms + LAST_EVENTS_MS) * 1000
        for i in sorted(self._to_revive) if now_us % grid_us == 0 else ():
            if now_us - int(self.world.safe_us[i]) < rested_us:
                continue
            self._to_revive.discard(i)
            self._liars.pop(i, None)
            self._nodes.pop(i, None)
            self._stopped_at_s.pop(i, None)
            if self._work:
                self._nodes[i] = AuditedRobot(self.world.fleet, i, self.world.work, self._work.make_controller)
            revive(self.world, i, self._factory, self._seed + i, self._nodes.get(i))
            self._show(i, Led(*self.world.led[i].tolist()))  # the first order to the new controller

    @property
    def liars(self) -> Mapping[int, Liar]:
        """Return the compromised robots, by row."""
        return self._liars

    # --- inside -------------------------------------------------------------------------------------------------------

    @property
    def _now_ms(self) -> int:
        """Return the station's time, which is the world's."""
        return int(self.world.clock[0].now_us) // 1000
