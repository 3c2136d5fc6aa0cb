"""Swarm of simulated robots on an encoded mission, for the gateway: robots can be watched, but not driven.

The swarm reports only what robots have found out: positions of decoded nodes. Of the other nodes only the number is
known here.
"""

from __future__ import annotations

import logging
import math
import signal
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from types import TracebackType
from typing import Self

import numpy as np

from phalanx.config import BtiConfig
from phalanx.errors import Unavailable, Unknown, UsageError
from phalanx.mission import Built, Mission, admit
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot import Point, Robot
from phalanx.robot.adversary.registry import attacks
from phalanx.robot.on_mission import Decoded, DecodedPlace, News, Progress, Walk
from phalanx.robot.roster import Roster, member
from phalanx.robot.swarm import AttackChoice, Audit, Shield
from phalanx.world.missions.live import WAITING, CompromiseRequest, Moment, RobotTruth, live
from phalanx.world.missions.orders import Orders, check_sensed, orders_of, start_of, with_fixtures
from phalanx.world.missions.setup import MissionRun
from phalanx.world.signals import handled_by

log = logging.getLogger(__name__)

# Limit for real time on two cores, with a gateway on the same machine.
MOST_ROBOTS = 16
WALLS_MAX = 20_000
HISTORY_STEP_MM = 200.0
MEET_M = 8.0
# Delay between robots on the same part, which would otherwise be one dot on the map and search for the same.
APART_S = 6.0
BATTERY_V = 3.0
ATTACK = "drive-dark"


class MissionSwarm(Roster):
    """A `phalanx.robot.on_mission.OnMission` of simulated robots without audits; a context manager for their process.

    The seed is that of their odometry. The clock returns seconds since 1970, and is also the mission's.

    Raises: UsageError: too many robots, or a building without walls or a start.
    """

    defence, f_max = "none", 1

    def __init__(self, plan: FloorPlan, count: int, seed: int, clock: Callable[[], float]) -> None:
        if not 1 <= count <= MOST_ROBOTS:
            raise UsageError(f"{count} robots on a mission in real time", f"use 1 to {MOST_ROBOTS}")
        if not 0 < len(plan.walls) <= WALLS_MAX:
            raise UsageError(f"{plan.name} has {len(plan.walls)} walls", f"use a building with 1 to {WALLS_MAX}")
        self.plan = plan
        self._seed, self._clock = seed, clock
        super().__init__(replace(member(i), threshold_mm=0.0) for i in range(count))
        self._truths = [RobotTruth(*start_of(plan), WAITING, "")] * count
        self._received_at_s = clock()
        self._orders: Orders | None = None
        self._started: set[bytes] = set()
        self._number = 0
        self._decoded: list[int] = [0] * count
        self._lit: dict[tuple[int, int], DecodedPlace | None] = {}
        self._news: list[tuple[str, News]] = []
        context = get_context("spawn")
        self._pipe, child_end = context.Pipe()
        self._held = context.RawValue("b", 0)  # without a lock, so that `hold` never blocks
        self._process = context.Process(target=live, args=(child_end, self._held), daemon=True)
        self._child_end = child_end
        self._lost = False

    def __enter__(self) -> Self:
        # The child ignores Ctrl-C: this process ends it.
        with handled_by(signal.SIG_IGN, signal.SIGINT):
            self._process.start()
        self._child_end.close()  # so that the child's exit closes the pipe
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pipe.close()
        self._process.terminate()
        self._process.join()

    # --- the swarm ----------------------------------------------------------------------------------------------------

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return width and height of the building."""
        x0, y0, x1, y1 = self.plan.bounds
        return max(1, math.ceil((x1 - x0) * 1000)), max(1, math.ceil((y1 - y0) * 1000))

    def robots(self) -> Sequence[Robot]:
        """Return all robots with their true poses."""
        self._receive()
        return [
            # The robot's front points along (-sin, cos) of the direction, y down.
            each.snapshot(
                self.to_area(truth.x_m, truth.y_m),
                round(-math.degrees(truth.heading_rad) - 90),
                BATTERY_V,
                self._received_at_s,
            )
            for each, truth in zip(self._members, self._truths, strict=True)
        ]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:  # noqa: ARG002
        """Refuse: a robot on a mission drives only where its mission leads."""
        self._find(address)
        raise Unknown("robots on a mission cannot be driven")

    def stop(self, address: str) -> None:
        """Do nothing but check the address: robots on a mission are not driven."""
        self._find(address)

    def hold(self) -> None:
        """Pause all robots and their mission time until `release`."""
        self._held.value = 1

    def release(self) -> None:
        """Resume the mission."""
        self._held.value = 0

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:  # noqa: ARG002
        """Refuse, like `drive`."""
        self._find(address)
        raise Unknown("robots on a mission cannot follow routes")

    # --- the mission --------------------------------------------------------------------------------------------------

    def to_area(self, x_m: float, y_m: float) -> Point:
        """Convert a position on the map to the area's millimetres, y down."""
        return Point((x_m - self.plan.bounds[0]) * 1000, (self.plan.bounds[3] - y_m) * 1000)

    def walls_mm(self) -> list[list[int]]:
        """Return x, y of both ends of each wall, in the area's millimetres."""
        x0, _, _, y1 = self.plan.bounds
        ends = np.rint((self.plan.walls - [x0, y1, x0, y1]) * [1000, -1000, 1000, -1000])
        walls: list[list[int]] = ends.astype(np.int64).tolist()
        return walls

    def check(self, plain: Mission) -> None:
        """Check that robots can sense such a mission's nodes in this building; see `OnMission`."""
        check_sensed(with_fixtures(self.plan, plain), plain)

    def prepare(self, plain: Mission, built: Sequence[Built]) -> Callable[[], None]:
        """Prepare a mission for all robots, and return the function that starts it; see `OnMission`."""
        return partial(self.begin, orders_of(plain, built, self.plan))

    def begin(self, orders: Orders) -> None:
        """Put all robots at the mission's start and start it; a running mission ends.

        In a large building this waits for the end of the robots' tick.

        Raises: PeerError: a robot refuses it: it is for other robots or another time, or was started before.
            UsageError: as `MissionRun`.
        """
        now_s = self._clock()
        for i in range(len(self._members)):
            admit(orders.parts[i % len(orders.parts)].mission, i + 1, now_s, self._started)
        run = orders.run(
            robots=len(self._members),
            defence=self.defence,
            f_max=self.f_max,
            seed=self._seed,
            begin_s=now_s,
            apart_s=APART_S,
            meet_m=MEET_M if self.defence == "none" else 0.0,
        )
        self._send(self._number + 1, run)
        # Real robots store this themselves: a mission can be started only once.
        self._started |= {part.mission.header.mission_id for part in orders.parts}
        self._number += 1
        self._orders = orders
        self._decoded = [0] * len(self._members)
        self._lit.clear()
        self._news.clear()
        for i, each in enumerate(self._members):
            each.history.clear()
            self._truths[i] = RobotTruth(*orders.parts[i % len(orders.parts)].start, WAITING, "")

    def progress(self) -> Progress | None:
        """Return the progress of the running or last mission."""
        if self._orders is None:
            return None
        parts = self._orders.parts
        nodes = sum(len(part.mission.nodes) for part in parts)
        done = sum(truth.phase == "done" for truth in self._truths)
        return Progress(
            parts[0].mission.header.mission_id.hex(), self._orders.name, nodes, nodes - len(self._lit), done
        )

    def plain(self) -> Mission | None:
        """Return the mission's source, see `OnMission`."""
        return self._orders.plain if self._orders else None

    def walks(self) -> Sequence[Walk]:
        """Return the state of every robot's mission."""
        return [
            Walk(
                address=each.address,
                name=each.name,
                phase=truth.phase,
                decoded=self._decoded[i],
                of=self._nodes(i),
                why=truth.why,
                drift=truth.drift,
            )
            for i, (each, truth) in enumerate(zip(self._members, self._truths, strict=True))
        ]

    def lit(self) -> Sequence[DecodedPlace]:
        """Return decoded nodes that have a place, in order of decoding."""
        return [lit for lit in self._lit.values() if lit is not None]

    def news(self) -> Sequence[tuple[str, News]]:
        """Return the events since the last call with the robots' addresses, oldest first."""
        news, self._news = self._news, []
        return news

    # --- inside -------------------------------------------------------------------------------------------------------

    def _send(self, number: int, message: MissionRun | CompromiseRequest) -> None:
        try:
            self._pipe.send((number, message))
        except OSError as error:
            raise Unavailable("the robots' process has ended", "restart the gateway") from error

    def _nodes(self, i: int) -> int:
        return len(self._orders.parts[i % len(self._orders.parts)].mission.nodes) if self._orders else 0

    def _receive(self) -> None:
        if self._lost:
            return
        try:
            while self._pipe.poll():
                number, moment = self._pipe.recv()
                self._received_at_s = self._clock()
                # Ignore states of an earlier mission that were still in the pipe.
                if moment is not None and number == self._number:
                    self._take(moment)
        except (EOFError, OSError):
            self._lost = True
            log.error("the robots' process has ended: their state is no longer updated")  # noqa: TRY400

    def _take(self, moment: Moment) -> None:
        self._truths = list(moment.robots)
        for i, truth in enumerate(moment.robots):
            at = self.to_area(truth.x_m, truth.y_m)
            self._members[i].append_position(round(at.x_mm), round(at.y_mm), HISTORY_STEP_MM)
        for news in moment.news:
            self._news.append((self._members[news.robot].address, news))
            if isinstance(news, Decoded):
                self._add_decoded(news)

    def _add_decoded(self, news: Decoded) -> None:
        assert self._orders is not None, "only robots with orders decode nodes"
        self._decoded[news.robot] += 1
        place = None if news.place_m is None else DecodedPlace(self.to_area(*news.place_m), news.type)
        self._lit.setdefault((news.robot % len(self._orders.parts), news.node), place)


class ShieldedMissionSwarm(MissionSwarm):
    """A `phalanx.robot.swarm.AuditedSwarm` of robots that audit each other during a mission.

    Raises: UsageError: as MissionSwarm; or too few robots.
    """

    longest_route = 0  # robots on a mission accept no routes

    def __init__(
        self, plan: FloorPlan, count: int, seed: int, clock: Callable[[], float], defence: str, f_max: int
    ) -> None:
        self.defence, self.f_max = defence, f_max
        self._audits: list[Audit] = []
        super().__init__(plan, count, seed, clock)

    def shields(self) -> Sequence[Shield]:
        """Return every robot's tokens and state; nothing if the robots' process has ended."""
        self._receive()
        if self._lost:
            return ()
        bti = BtiConfig(f_max=self.f_max)
        return [
            Shield(
                address=each.address,
                needed=bti.tokens_needed,
                full_s=bti.t_val_ms / 1000,
                vouchers=tuple((self._members[auditor].address, left_s) for auditor, left_s in truth.vouchers),
                safe_mode=truth.safe_mode,
                attack=truth.attack,
            )
            for each, truth in zip(self._members, self._truths, strict=True)
        ]

    def new_audits(self) -> Sequence[Audit]:
        """Return the audits that ended since the last call, oldest first."""
        audits, self._audits = self._audits, []
        return audits

    def attacks(self) -> Sequence[AttackChoice]:
        """Return the only attack that needs nothing but the robot; others need accomplices or fabricated scans."""
        return [AttackChoice(ATTACK, attacks()[ATTACK].does)]

    def compromise(self, address: str, attack: str) -> None:
        """Compromise a robot from now on."""
        i = self._find(address)
        if attack != ATTACK:
            raise Unknown(f"no attack {attack[:64]!r}")
        truth = self._truths[i]
        if self._orders is None or truth.attack or truth.safe_mode:
            raise Unknown(f"{self._members[i].name} is compromised or stopped already, or on no mission")
        self._send(self._number, CompromiseRequest(i, attack))

    def _take(self, moment: Moment) -> None:
        super()._take(moment)
        self._audits += [
            Audit(auditor=self._members[auditor].address, auditee=self._members[auditee].address, refusal=why)
            for auditor, auditee, why in moment.audits
        ]
