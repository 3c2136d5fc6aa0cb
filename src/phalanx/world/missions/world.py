"""Robots on encoded missions in a building: walls, lidars and wheels for the event loop of the audited world.

Each robot's c-node runs in Python with its own start key. Trusted nodes, radio and audits are those of any protected
swarm. Without a defence there are no audits, and robots use inputs that no log covers.
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
from .report import Report, ReportRecorder, TimedController
from .setup import MissionRun, doing

Proofs = tuple[tuple[int, bytes], ...]  # node, and proof that a robot decoded it
US_PER_S = 1e6
STEP_S = 0.1  # time between readings without audits
PICTURE_S = 0.5  # time between pictures of the camera
NO_CONTACTS_M = 0.0
NEIGHBOURS_LEAST = 8
STATION_ID = 0
# Periods at which robots that see each other exchange proofs, and at which the station sends a message.
MEET, SEND = "meet", "send"
PERIOD_US = {MEET: 500_000, SEND: 1_500_000}
WATCH_M = 10.0  # distance within which robots see each other's actions
KEYS_DRAW = 0x706D
PEOPLE_DRAW = 1 << 32  # not a robot's number, so that people have a random stream of their own


def walkers_of(run: MissionRun) -> list[Walker]:
    """Return a walker for each part. Raises: as `Walker`."""
    return [Walker(part.mission, part.key, run.config.seen_by(run.lidar)) for part in run.parts]


class MissionRobot(ReportRecorder):
    """One robot of a run, with its body, controller and report.

    Attributes:
        rests: whether the robot stands still for now.
        attack: name of the attack that it runs, or "".
        hears: messages to deliver with its next reading, other than by radio.
    """

    def __init__(self, number: int, body: MissionBody, inner: Robot, *, keep_trace: bool) -> None:
        assert isinstance(inner.controller, TimedController), "created by MissionWorld"
        super().__init__(number, body, inner.controller, keep_trace=keep_trace)
        self.inner = inner
        self.rests = False
        self.hears: tuple[bytes, ...] = ()
        self.attack = ""


class MissionWorld:
    """Simulation of a mission run.

    Args:
        numbers: robots in this world; None is all.
        building: None is the run's.
        walkers: one for each part, or one for all; if empty, they are created. They cache failed searches.
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
        # Cached for use at every event: reading a record's field takes a microsecond.
        clock = self.world.clock
        self._now_us, self._event = clock["now_us"], (clock["kind"], clock["robot"])
        walkers = walkers or walkers_of(run)
        self.robots = [self._robot(i, number, walkers) for i, number in enumerate(numbers)]
        self._verdicts = VerdictReader(self.world)
        self._sent = 0
        self._is_watched = any(part.name for part in run.parts)
        happens = {MEET: run.meet_m > 0, SEND: bool(run.controller)}
        self._due_us = {what: PERIOD_US[what] for what, is_due in happens.items() if is_due}
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
        """Return the simulated time, s."""
        return float(self._now_us[0]) / US_PER_S

    @property
    def over(self) -> bool:
        """Return whether all robots are finished or in Safe Mode."""
        return all(robot.controller.over or self.world.safe[i] for i, robot in enumerate(self.robots))

    def advance(self, until_s: float) -> None:
        """Advance to `until_s`, with exchanges between robots that meet and the station's messages."""
        until_us = round(until_s * US_PER_S)
        while self._now_us[0] < until_us:
            self._advance(min([until_us, *self._due_us.values()]))
            now_us = int(self._now_us[0])
            for what, due_us in self._due_us.items():
                if due_us <= now_us:
                    self._due_us[what] += PERIOD_US[what]
                    self.meet() if what == MEET else self._send()

    def _advance(self, until_us: int) -> None:
        inners, (kind, robot) = self._inners, self._event
        while loop.run(self.world, until_us) == loop.FOR_PYTHON:
            if kind[0] == CONTROL:
                self._control(int(robot[0]))
            else:
                pybot.handle(self.world, inners)
        assert refused(self.world.queue) == 0, "the event queue overflowed"
        for i in range(len(self.robots)):
            self._move(i)

    def _send(self) -> None:
        """Send the controller's next message; all are repeated in turn, for robots that were out of range."""
        message = self.run.controller[self._sent % len(self.run.controller)]
        packet = np.frombuffer(bytearray(message_packet(STATION_ID, message)), np.uint8)
        self._sent += 1
        loop.transmit(self.world, len(self.robots), packet, len(packet), BROADCAST)

    def meet(self) -> list[tuple[MissionRobot, Proofs]]:
        """Exchange proofs between robots on the same part that see each other; other parts use the same node numbers.

        Returns: the receivers, each with the proofs.
        """
        received: list[tuple[MissionRobot, Proofs]] = []
        for one, other in combinations(self.robots, 2):
            a, b = one.body.wheels.pose[:2], other.body.wheels.pose[:2]
            is_same = one.number % len(self.run.parts) == other.number % len(self.run.parts)
            if is_same and math.dist(a, b) <= self.run.meet_m and self.run.plan.sees(a, b):
                for here, there in ((one, other), (other, one)):
                    received.append((there, here.controller.walker.report(here.controller.memory.walk)))
        for robot, proofs in received:
            memory = robot.controller.memory
            robot.controller.memory = replace(memory, walk=robot.controller.walker.accept_report(memory.walk, proofs))
        return received

    def _move(self, i: int) -> None:
        """Move the robot's body to the current time, and its radio to the body's position."""
        body, safe_us = self.robots[i].body, int(self.world.safe_us[i])
        if safe_us >= 0:
            body.advance(safe_us / US_PER_S)
            body.halt()
        self.building.advance_people(self.now_s)
        body.advance(self.now_s)
        self.world.pos[i] = body.wheels.pose[:2]

    def _control(self, i: int) -> None:
        """Read a robot's sensors, and let its c-node act on the reading. Source: RoboRebound Alg. 1."""
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
                robot.body.execute_command(action.command)
            else:
                pybot.perform(self.world, i, now_ms, [action])
        if not was_over:
            robot.note(self.now_s)

    def _watched(self, robot: MissionRobot) -> list[str]:
        """Return the actions of others that a robot sees in any direction: S_ij. Source: Encoded graphs Fig. 5."""
        if not self._is_watched:
            return []
        at, seen = robot.body.wheels.pose[:2], list[str]()
        for other in self.robots:
            name = self.run.part_of(other.number).name
            if name and other is not robot and (does := other.body.does()):
                place = other.body.wheels.pose[:2]
                if math.dist(at, place) <= WATCH_M and self.run.plan.sees(at, place):
                    seen += [doing(name, action) for action in does]
        return seen

    def compromise(self, i: int, attack: Attack, plan: CheatPlan) -> None:
        """Compromise a robot from now on; the attack has all of the robot's knowledge."""
        robot = self.robots[i]
        assert robot.inner.make_controller is not None, "created by MissionWorld"
        liar = attack.kind(self.world.fleet, i, self.world.work, robot.inner.make_controller, plan=plan)
        liar.take_over(robot.controller)
        robot.inner, robot.attack = liar, attack.name

    def stopped_s(self, i: int) -> float | None:
        """Return the time at which a robot was put in Safe Mode, None if it was not."""
        safe_us = int(self.world.safe_us[i])
        return None if safe_us < 0 else safe_us / US_PER_S

    def new_verdicts(self) -> list[tuple[float, int, int, Refusal]]:
        """Return the audits that ended since the last call: time s, auditor's id, auditee's, refusal or NONE."""
        return self._verdicts.new()

    def finish(self) -> list[Report]:
        """Return the outcome of each robot."""
        counts = self.world.fleet.robot
        return [
            replace(
                robot.finish(self.stopped_s(i)),
                audits_passed=int(counts["audits_passed"][i]),
                audits_refused=int(counts["audits_refused"][i]),
            )
            for i, robot in enumerate(self.robots)
        ]
