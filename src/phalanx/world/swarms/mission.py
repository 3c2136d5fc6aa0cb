"""A swarm that lives an encoded mission, as the gateway sees it: robots that can be watched, and not driven.

What is told of the mission is what robots have found out: places of nodes that were decoded. Of the others nothing is
known here but how many there are.
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

# As many as two cores carry in real time, with a gateway beside them.
MOST_ROBOTS = 16
WALLS_MAX = 20_000
HISTORY_STEP_MM = 200.0
MEET_M = 8.0
# One of each part after the other: together they would be one dot on the map, all in search of the same.
APART_S = 6.0
BATTERY_V = 3.0
ATTACK = "drive-dark"


class MissionSwarm(Roster):
    """A `phalanx.robot.on_mission.OnMission` of simulated robots, unprotected; a context manager, in which their
    process lives. The seed is that of their odometry; the clock, seconds since 1970, is also the mission's.

    Raises: UsageError: too many robots, or a building without walls or a start.
    """

    defence, f_max = "none", 1

    def __init__(self, plan: FloorPlan, count: int, seed: int, clock: Callable[[], float]) -> None:
        if not 1 <= count <= MOST_ROBOTS:
            raise UsageError(f"{count} robots on a mission in real time", f"1 to {MOST_ROBOTS}")
        if not 0 < len(plan.walls) <= WALLS_MAX:
            raise UsageError(f"{plan.name} has {len(plan.walls)} walls", f"1 to {WALLS_MAX}: robots find their way by")
        self.plan = plan
        self._seed, self._clock = seed, clock
        super().__init__(replace(member(i), threshold_mm=0.0) for i in range(count))
        self._standing = [RobotTruth(*start_of(plan), WAITING, "")] * count
        self._heard_at_s = clock()
        self._orders: Orders | None = None
        self._started: set[bytes] = set()
        self._number = 0
        self._decoded: list[int] = [0] * count
        self._lit: dict[tuple[int, int], DecodedPlace | None] = {}
        self._news: list[tuple[str, News]] = []
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._held = context.RawValue("b", 0)  # without a lock, for which whoever stops them would wait
        self._process = context.Process(target=live, args=(theirs, self._held), daemon=True)
        self._theirs = theirs
        self._lost = False

    def __enter__(self) -> Self:
        # It does not hear of Ctrl-C: whoever started it ends it.
        with handled_by(signal.SIG_IGN, signal.SIGINT):
            self._process.start()
        self._theirs.close()  # or its end would not be seen
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
        """Width and height of the building."""
        x0, y0, x1, y1 = self.plan.bounds
        return max(1, math.ceil((x1 - x0) * 1000)), max(1, math.ceil((y1 - y0) * 1000))

    def robots(self) -> Sequence[Robot]:
        """Every robot, where it truly is."""
        self._listen()
        return [
            # The nose points along (-sin, cos) of the direction, y down.
            each.seen(
                self.to_area(stands.x_m, stands.y_m),
                round(-math.degrees(stands.heading_rad) - 90),
                BATTERY_V,
                self._heard_at_s,
            )
            for each, stands in zip(self._members, self._standing, strict=True)
        ]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:  # noqa: ARG002
        """Refused: a robot on a mission goes where its mission says, and nowhere else."""
        self._find(address)
        raise Unknown("robots on a mission are not driven")

    def stop(self, address: str) -> None:
        """Nothing: nobody drives them."""
        self._find(address)

    def hold(self) -> None:
        """All stand still, and their time with them, until `release`."""
        self._held.value = 1

    def release(self) -> None:
        """They go on with their mission."""
        self._held.value = 0

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:  # noqa: ARG002
        """Refused, like `drive`."""
        self._find(address)
        raise Unknown("robots on a mission follow no routes")

    # --- the mission --------------------------------------------------------------------------------------------------

    def to_area(self, x_m: float, y_m: float) -> Point:
        """A place of the map in the area's millimetres, y down."""
        return Point((x_m - self.plan.bounds[0]) * 1000, (self.plan.bounds[3] - y_m) * 1000)

    def walls_mm(self) -> list[list[int]]:
        """x, y of both ends of each wall, in the area."""
        x0, _, _, y1 = self.plan.bounds
        ends = np.rint((self.plan.walls - [x0, y1, x0, y1]) * [1000, -1000, 1000, -1000])
        told: list[list[int]] = ends.astype(np.int64).tolist()
        return told

    def check(self, plain: Mission) -> None:
        """Nothing, if robots can live such a mission, see `OnMission`."""
        check_sensed(with_fixtures(self.plan, plain), plain)

    def prepare(self, plain: Mission, built: Sequence[Built]) -> Callable[[], None]:
        """Prepare all robots for a mission, see `OnMission`."""
        return partial(self.begin, orders_of(plain, built, self.plan))

    def begin(self, orders: Orders) -> None:
        """All robots are put at the mission's start, and live it; one that runs ends.

        In a large building it waits until robots have ended their tick.

        Raises: PeerError: a robot must not start it: it is for others, for another time, or was started before.
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
        self._tell(self._number + 1, run)
        # Where robots keep it, if they were real: a mission that was begun is not begun again.
        self._started |= {part.mission.header.mission_id for part in orders.parts}
        self._number += 1
        self._orders = orders
        self._decoded = [0] * len(self._members)
        self._lit.clear()
        self._news.clear()
        for i, each in enumerate(self._members):
            each.history.clear()
            self._standing[i] = RobotTruth(*orders.parts[i % len(orders.parts)].start, WAITING, "")

    def progress(self) -> Progress | None:
        """The mission that runs, or ran last."""
        if self._orders is None:
            return None
        parts = self._orders.parts
        nodes = sum(len(part.mission.nodes) for part in parts)
        done = sum(stands.phase == "done" for stands in self._standing)
        return Progress(
            parts[0].mission.header.mission_id.hex(), self._orders.name, nodes, nodes - len(self._lit), done
        )

    def plain(self) -> Mission | None:
        """Return the mission's source, see `OnMission`."""
        return self._orders.plain if self._orders else None

    def walks(self) -> Sequence[Walk]:
        """One for every robot."""
        return [
            Walk(
                address=each.address,
                name=each.name,
                phase=stands.phase,
                decoded=self._decoded[i],
                of=self._nodes(i),
                why=stands.why,
                drift=stands.drift,
            )
            for i, (each, stands) in enumerate(zip(self._members, self._standing, strict=True))
        ]

    def lit(self) -> Sequence[DecodedPlace]:
        """Return decoded nodes that have a place, in order of decoding."""
        return [lit for lit in self._lit.values() if lit is not None]

    def news(self) -> Sequence[tuple[str, News]]:
        """(address, what is new of that robot) since the last call, oldest first."""
        news, self._news = self._news, []
        return news

    # --- inside -------------------------------------------------------------------------------------------------------

    def _tell(self, number: int, what: MissionRun | CompromiseRequest) -> None:
        try:
            self._pipe.send((number, what))
        except OSError as error:
            raise Unavailable("the robots' process has ended", "start the gateway again") from error

    def _nodes(self, i: int) -> int:
        return len(self._orders.parts[i % len(self._orders.parts)].mission.nodes) if self._orders else 0

    def _listen(self) -> None:
        if self._lost:
            return
        try:
            while self._pipe.poll():
                number, said = self._pipe.recv()
                self._heard_at_s = self._clock()
                # What was on its way of a mission that has ended is nobody's business any more.
                if said is not None and number == self._number:
                    self._take(said)
        except (EOFError, OSError):
            self._lost = True
            log.error("the robots' process has ended: they are not heard any more")  # noqa: TRY400

    def _take(self, moment: Moment) -> None:
        self._standing = list(moment.robots)
        for i, stands in enumerate(moment.robots):
            at = self.to_area(stands.x_m, stands.y_m)
            self._members[i].went(round(at.x_mm), round(at.y_mm), HISTORY_STEP_MM)
        for news in moment.news:
            self._news.append((self._members[news.robot].address, news))
            if isinstance(news, Decoded):
                self._light(news)

    def _light(self, news: Decoded) -> None:
        assert self._orders is not None, "robots decode what they were given"
        self._decoded[news.robot] += 1
        place = None if news.place_m is None else DecodedPlace(self.to_area(*news.place_m), news.type)
        self._lit.setdefault((news.robot % len(self._orders.parts), news.node), place)


class ShieldedMissionSwarm(MissionSwarm):
    """A `phalanx.robot.swarm.AuditedSwarm` swarm of robots on a mission that audit each other while they live it.

    Raises: UsageError: as MissionSwarm; or too few robots.
    """

    longest_route = 0  # nobody tells them where to go

    def __init__(
        self, plan: FloorPlan, count: int, seed: int, clock: Callable[[], float], defence: str, f_max: int
    ) -> None:
        self.defence, self.f_max = defence, f_max
        self._audits: list[Audit] = []
        super().__init__(plan, count, seed, clock)

    def shields(self) -> Sequence[Shield]:
        """One for every robot; none, if their process has ended."""
        self._listen()
        if self._lost:
            return ()
        bti = BtiConfig(f_max=self.f_max)
        return [
            Shield(
                address=each.address,
                needed=bti.tokens_needed,
                full_s=bti.t_val_ms / 1000,
                vouchers=tuple((self._members[auditor].address, left_s) for auditor, left_s in stands.vouchers),
                safe_mode=stands.safe_mode,
                attack=stands.attack,
            )
            for each, stands in zip(self._members, self._standing, strict=True)
        ]

    def new_audits(self) -> Sequence[Audit]:
        """Those that ended since the last call, oldest first."""
        audits, self._audits = self._audits, []
        return audits

    def attacks(self) -> Sequence[AttackChoice]:
        """The one that wants nothing beside the robot: the others need colluding robots, or scans that were made up."""
        return [AttackChoice(ATTACK, attacks()[ATTACK].does)]

    def compromise(self, address: str, attack: str) -> None:
        """The robot lies from now on."""
        i = self._find(address)
        if attack != ATTACK:
            raise Unknown(f"no attack {attack[:64]!r}")
        stands = self._standing[i]
        if self._orders is None or stands.attack or stands.safe_mode:
            raise Unknown(f"{self._members[i].name} is compromised or stopped already, or on no mission")
        self._tell(self._number, CompromiseRequest(i, attack))

    def _take(self, moment: Moment) -> None:
        super()._take(moment)
        self._audits += [
            Audit(auditor=self._members[auditor].address, auditee=self._members[auditee].address, refusal=why)
            for auditor, auditee, why in moment.audits
        ]
