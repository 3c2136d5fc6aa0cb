"""Robots on encoded missions in a building: walls, lidars and wheels behind the events of the audited world.

Each robot's c-node runs in Python, with its own start key; the trusted nodes, the radio and the rounds of audits are
those of every protected swarm. Without a defence there are none, and robots take in what no chain would hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.config.bti import quorum_of
from phalanx.config.radio import RadioConfig
from phalanx.mission import Walker
from phalanx.robot.actions import Actuate
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.mission_cheat import CheatPlan
from phalanx.robot.controllers.mission.controller import Assignment, Missions, message_packet
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.robot.robot import Robot
from phalanx.world.audited import loop, pybot
from phalanx.world.audited.body import POINT_MASS
from phalanx.world.audited.events import CONTROL, refused
from phalanx.world.audited.setup import PROFILES, Setup, make_world, start
from phalanx.world.audited.world import VerdictReader, clock_ms
from phalanx.world.building.walkers import Walkers
from phalanx.world.radio.channel import BROADCAST

from .body import Building, MissionBody
from .report import Logbook, Report, TimedController
from .setup import MissionRun, doing

Proofs = tuple[tuple[int, bytes], ...]  # node, and what shows that somebody decoded it
US_PER_S = 1e6
STEP_S = 0.1  # from one reading to the next, where robots do not audit each other
PICTURE_S = 0.5  # from one picture of a camera to the next
NO_CONTACTS_M = 0.0
NEIGHBOURS_LEAST = 8
STATION_ID = 0
# How often robots that see each other exchange proofs, and the station says a message.
MEET, SAY = "meet", "say"
PERIOD_US = {MEET: 500_000, SAY: 1_500_000}
WATCH_M = 10.0  # robots see what others do from so near
KEYS_DRAW = 0x706D
PEOPLE_DRAW = 1 << 32  # no robot's number: what is drawn for people is drawn for nobody else


def walkers_of(run: MissionRun) -> list[Walker]:
    """Of each part. Raises: as `Walker`."""
    return [Walker(part.mission, part.key, run.config.seen_by(run.lidar)) for part in run.parts]


class MissionRobot(Logbook):
    """One robot of a run.

    Attributes:
        rests: it is left where it stands for now.
        attack: that it was made to run, or "".
        hears: messages that come to it by another road than the radio, with its next reading.
    """

    def __init__(self, number: int, body: MissionBody, inner: Robot, *, keep_trace: bool) -> None:
        assert isinstance(inner.controller, TimedController), "the world has made it"
        super().__init__(number, body, inner.controller, keep_trace=keep_trace)
        self.inner = inner
        self.rests = False
        self.hears: tuple[bytes, ...] = ()
        self.attack = ""


class MissionWorld:
    """A run, being lived.

    Args:
        numbers: robots that live here; None is all.
        building: where; None is the run's.
        walkers: of each part, or one for all; without, they are made here. What one has searched in vain for a robot it
            need not search for the next.
    Raises: as `Walker`, for a start key that is missing or another mission's.
    """

    def __init__(
        self,
        run: MissionRun,
        numbers: Sequence[int] | None = None,
        *,
        building: Building | None = None,
        walkers: Sequence[Walker] = (),
    ) -> None:
        self.run = run
        numbers = range(run.robots) if numbers is None else numbers
        crowd = Walkers(run.plan, run.people, np.random.default_rng([run.seed, PEOPLE_DRAW])) if run.people else None
        self.building = building or Building(run.plan, run.lidar, crowd)
        starts = [run.part_of(number).start for number in numbers]
        self.missions = Missions(
            {
                i + 1: Assignment(
                    run.part_of(number).mission,
                    run.part_of(number).start,
                    run.pool,
                    run.begin_s,
                    number // len(run.parts) * run.apart_s,
                )
                for i, number in enumerate(numbers)
            },
            Sensors(run.lidar, run.plan.extraction),
            run.config.seen_by(run.lidar),
            self.building.eye,
            audited=run.audited,
        )
        self.bti = BtiConfig(f_max=run.f_max, n_max=max(NEIGHBOURS_LEAST, quorum_of(run.f_max), len(numbers)))
        if run.audited:
            self.bti = self.missions.audits(self.bti)
        else:
            self.bti = replace(self.bti, t_control_ms=round(1000 * STEP_S), delta_ms=40)
        x0, y0, x1, y1 = run.plan.bounds
        self.world = make_world(
            Setup(
                robots=len(numbers),
                starts_m=np.array([*(pose[:2] for pose in starts), ((x0 + x1) / 2, (y0 + y1) / 2)], np.float64),
                profile=PROFILES[run.defence],
                controller=0,
                params=np.zeros(1),
                body=POINT_MASS,
                seed=run.seed + numbers[0],
                contact_m=NO_CONTACTS_M,
                bti=self.bti,
                radio=RadioConfig(),
            ),
            np.random.default_rng([run.seed, numbers[0], KEYS_DRAW]),
        )
        # Asked for at every event: reading a record's field takes a microsecond.
        clock = self.world.clock
        self._now_us, self._event = clock["now_us"], (clock["kind"], clock["robot"])
        walkers = walkers or walkers_of(run)
        self.robots = [self._robot(i, number, walkers) for i, number in enumerate(numbers)]
        self._verdicts = VerdictReader(self.world)
        self._said = 0
        self._is_watched = any(part.name for part in run.parts)
        happens = {MEET: run.meet_m > 0, SAY: bool(run.controller)}
        self._due_us = {what: PERIOD_US[what] for what, does in happens.items() if does}
        start(self.world, self._inners)

    def _robot(self, i: int, number: int, walkers: Sequence[Walker]) -> MissionRobot:
        run, walker = self.run, walkers[number % len(walkers)]
        every = round(PICTURE_S * 1000 / self.bti.t_control_ms)
        body = MissionBody(
            i + 1, self.building, self.missions.sensors, run.part_of(number).start, run.noise, (run.seed, number), every
        )
        make = self.missions.controllers_of(i + 1, walker, TimedController)
        inner = run.liars.get(number, Robot)(self.world.fleet, i, self.world.work, make)
        return MissionRobot(number, body, inner, keep_trace=run.keep_trace)

    @property
    def _inners(self) -> dict[int, Robot]:
        return {i: robot.inner for i, robot in enumerate(self.robots)}

    @property
    def now_s(self) -> float:
        """Simulated seconds so far."""
        return float(self._now_us[0]) / US_PER_S

    @property
    def over(self) -> bool:
        """Return whether nobody has anything left to do."""
        return all(robot.controller.over or self.world.safe[i] for i, robot in enumerate(self.robots))

    def advance(self, until_s: float) -> None:
        """The world at `until_s`; robots that meet tell each other where they were, the station says its messages."""
        until_us = round(until_s * US_PER_S)
        while self._now_us[0] < until_us:
            self._advance(min([until_us, *self._due_us.values()]))
            now_us = int(self._now_us[0])
            for what, due_us in self._due_us.items():
                if due_us <= now_us:
                    self._due_us[what] += PERIOD_US[what]
                    self.meet() if what == MEET else self._say()

    def _advance(self, until_us: int) -> None:
        inners, (kind, robot) = self._inners, self._event
        while loop.run(self.world, until_us) == loop.FOR_PYTHON:
            if kind[0] == CONTROL:
                self._control(int(robot[0]))
            else:
                pybot.handle(self.world, inners)
        assert refused(self.world.queue) == 0, "the queue of events was too short"
        for i in range(len(self.robots)):
            self._move(i)

    def _say(self) -> None:
        """The controller's messages, one after the other, again and again: a robot may have been out of hearing."""
        message = self.run.controller[self._said % len(self.run.controller)]
        packet = np.frombuffer(bytearray(message_packet(STATION_ID, message)), np.uint8)
        self._said += 1
        loop.transmit(self.world, len(self.robots), packet, len(packet), BROADCAST)

    def meet(self) -> list[tuple[MissionRobot, Proofs]]:
        """Robots on the same part that see each other exchange proofs: another part's nodes have the same numbers.

        Returns: who was told, and what.
        """
        told: list[tuple[MissionRobot, Proofs]] = []
        for one, other in combinations(self.robots, 2):
            a, b = one.body.wheels.pose[:2], other.body.wheels.pose[:2]
            is_same = one.number % len(self.run.parts) == other.number % len(self.run.parts)
            if is_same and math.dist(a, b) <= self.run.meet_m and self.run.plan.sees(a, b):
                for here, there in ((one, other), (other, one)):
                    told.append((there, here.controller.walker.report(here.controller.memory.walk)))
        for robot, proofs in told:
            memory = robot.controller.memory
            robot.controller.memory = replace(memory, walk=robot.controller.walker.accept_report(memory.walk, proofs))
        return told

    def _move(self, i: int) -> None:
        """The robot is where physics puts it now, and radio waves find it there."""
        body, safe_us = self.robots[i].body, int(self.world.safe_us[i])
        if safe_us >= 0:
            body.advance(safe_us / US_PER_S)
            body.halt()
        self.building.advance_people(self.now_s)
        body.advance(self.now_s)
        self.world.pos[i] = body.wheels.pose[:2]

    def _control(self, i: int) -> None:
        """A reading is due: the robot's sensors are read, its c-node acts on them. Source: RoboRebound Alg. 1."""
        robot = self.robots[i]
        if robot.rests or (robot.controller.over and not self.run.audited and not robot.controller.memory.said):
            robot.body.halt()
            return
        self._move(i)
        inner, now_ms = robot.inner, clock_ms(self.world, i)
        reading, inner.raw = robot.body.sense(now_ms, self._watched(robot))
        if not self.run.audited:
            robot.controller.messages, robot.hears = robot.hears, ()
        was_over = robot.controller.over
        for action in inner.on_reading(now_ms, reading):
            if isinstance(action, Actuate):
                robot.body.obey(action.command)
            else:
                pybot.perform(self.world, i, now_ms, [action])
        if not was_over:
            robot.note(self.now_s)

    def _watched(self, robot: MissionRobot) -> list[str]:
        """Return the actions of others that a robot sees, all around it: S_ij. Source: Encoded graphs Fig. 5."""
        if not self._is_watched:
            return []
        at, told = robot.body.wheels.pose[:2], list[str]()
        for other in self.robots:
            name = self.run.part_of(other.number).name
            if name and other is not robot and (does := other.body.does()):
                place = other.body.wheels.pose[:2]
                if math.dist(at, place) <= WATCH_M and self.run.plan.sees(at, place):
                    told += [doing(name, action) for action in does]
        return told

    def compromise(self, i: int, attack: Attack, plan: CheatPlan) -> None:
        """A robot lies from now on, with all that it knows."""
        robot = self.robots[i]
        assert robot.inner.make_controller is not None, "the world has made it"
        liar = attack.kind(self.world.fleet, i, self.world.work, robot.inner.make_controller, plan=plan)
        liar.take_over(robot.controller)
        robot.inner, robot.attack = liar, attack.name

    def stopped_s(self, i: int) -> float | None:
        """Return when a robot was put in Safe Mode, None if it was not."""
        safe_us = int(self.world.safe_us[i])
        return None if safe_us < 0 else safe_us / US_PER_S

    def new_verdicts(self) -> list[tuple[float, int, int, Refusal]]:
        """Audits that ended since the last call: time s, auditor's id, auditee's, why it got no token or NONE."""
        return self._verdicts.new()

    def finish(self) -> list[Report]:
        """Return the outcome of each robot."""
        told = self.world.fleet.robot
        return [
            replace(
                robot.finish(self.stopped_s(i)),
                audits_passed=int(told["audits_passed"][i]),
                audits_refused=int(told["audits_refused"][i]),
            )
            for i, robot in enumerate(self.robots)
        ]
