"""One robot on an encoded mission: wheels, odometry, lidar and camera below; the walker and the pilot above.

What it knows is its encoded mission, the pose it was put at, and what its sensors say. The world knows the truth, and
so do the figures that are kept here: no decision looks at them.
"""

from __future__ import annotations

import hashlib
import math
import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.mission import Action, Experience, Landmark, Outcome, Phase, State, Walker
from phalanx.mission.landmarks import FloorPlan, extract
from phalanx.mission.walk.fix import Fix
from phalanx.mission.walk.outcome import Kind, Reason
from phalanx.mission.walk.table import Event
from phalanx.sim.building.camera import Camera
from phalanx.sim.building.diffdrive import DiffDrive
from phalanx.sim.building.lidar import Lidar
from phalanx.sim.building.odometry import Odometry, OdometryNoise, Pose

from .pilot import Pilot

TICK_S = 0.1
# Landmarks farther off are left alone: what a robot decodes it must be able to reach.
SEE_M = 10.0
CAMERA_EVERY = 5  # ticks from one picture to the next
# A fix that leaves the robot further off than this took one thing for another: cells are 0.1 m, the search 0.5 m.
FALSE_FIX_M = 0.3
FALSE_FIX_RAD = math.radians(6)
_TOLD = {Reason.DRIFT, Reason.CONTRADICTED, Reason.ALTERED}


class World:
    """What all robots of a run share: the building and its sensors' models."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig | None = None) -> None:
        self.plan = plan
        self.lidar = Lidar(plan.walls, lidar)
        self.camera = Camera(plan) if plan.codes else None
        self.extraction = ExtractionConfig(feature_range_m=SEE_M).for_noise(self.lidar.config.noise_m)
        # (m, 3) centre and radius of those who walk about, metres; whoever lets them walk puts them here.
        self.people: NDArray[np.float64] = np.zeros((0, 3))


@dataclass(slots=True)
class Report:
    """What became of a robot.

    Args:
        done: its mission is completed.
        decoded: (t_s, node), in the order in which they were decoded; first times alone.
        places: of decoded nodes, map frame, metres.
        hashes_tried: hashes or KDFs.
        false_fixes: fixes that left it more than FALSE_FIX_M or FALSE_FIX_RAD off.
        search_ms, extraction_ms: of each step in which something was tried or seen; by the clock, so not in the digest.
        pose_error_m, odometry_error_m: of each step, with fixes and without.
        not_validated: (t_s, reason).
        actions: (t_s, action) that it carried out.
        trace: (t_s, true pose, estimate, odometry alone) of each step, if it is kept.
        lacks: what nodes that it could have decoded next are made of, and its world does not have.
    """

    robot: int
    done: bool = False
    t_s: float = 0.0
    decoded: list[tuple[float, int]] = field(default_factory=list)
    places: dict[int, tuple[float, float]] = field(default_factory=dict)
    hashes_tried: int = 0
    false_fixes: int = 0
    search_ms: list[float] = field(default_factory=list)
    extraction_ms: list[float] = field(default_factory=list)
    pose_error_m: list[float] = field(default_factory=list)
    odometry_error_m: list[float] = field(default_factory=list)
    not_validated: list[tuple[float, str]] = field(default_factory=list)
    actions: list[tuple[float, str]] = field(default_factory=list)
    trace: list[tuple[float, Pose, Pose, Pose]] = field(default_factory=list)
    digest: str = ""
    lacks: tuple[str, ...] = ()


class MissionRobot:
    """A robot that lives its mission.

    Args:
        number: of the robot; with the seed it decides all that is drawn for it.
        world: where it lives.
        walker: its mission.
        start: the pose it is put at, and told.
        noise: of its odometry.
        seed: of the run.
        pool: actions it can do.
        begin_s: the mission's clock at its first step.
        keep_trace: keep where it was at every step.
    """

    def __init__(
        self,
        number: int,
        world: World,
        walker: Walker,
        start: Pose,
        noise: OdometryNoise,
        seed: int,
        pool: tuple[Action, ...] = (),
        *,
        begin_s: float = 0.0,
        keep_trace: bool = False,
    ) -> None:
        self.report = Report(number)
        self.walker = walker
        self.state = State()
        self.body = DiffDrive(world.plan, start)
        self._world = world
        self._random = np.random.default_rng([seed, number, 0])
        # The same draws: what odometry would say had nobody ever corrected it.
        self.odometry = Odometry(start, noise, np.random.default_rng([seed, number, 1]))
        self._uncorrected = Odometry(start, noise, np.random.default_rng([seed, number, 1]))
        self._pilot = Pilot()
        self._pool = pool
        self._blocked = False
        self._turn_radps = 0.0
        self._tick = 0
        self._begin_s = begin_s
        self._keep_trace = keep_trace
        self._digest = hashlib.sha256()

    @property
    def over(self) -> bool:
        """Whether it has stopped for good."""
        return self.state.phase in (Phase.DONE, Phase.HELD)

    def step(self, messages: tuple[bytes, ...] = ()) -> tuple[bytes, ...]:
        """Lives for one tick: senses, searches, drives.

        Args:
            messages: that came since the last one.
        Returns: messages that it gives out.
        """
        t_s = self._tick * TICK_S
        scan = self._world.lidar.sweep(self.body.pose, self._random, self._world.people)
        started = time.perf_counter()
        landmarks = extract(scan, self._world.extraction).landmarks(*self.odometry.pose)
        self.report.extraction_ms.append(1e3 * (time.perf_counter() - started))
        x_m, y_m, heading_rad = self.odometry.pose
        seen = Experience(
            self._begin_s + t_s,
            x_m,
            y_m,
            heading_rad,
            self.odometry.travelled_m,
            landmarks + self._read_codes(),
            actions=self._pool,
            messages=messages,
            blocked=self._blocked,
        )
        started = time.perf_counter()
        self.state, outcome = self.walker.step(self.state, seen)
        if outcome.trials:
            self.report.search_ms.append(1e3 * (time.perf_counter() - started))
        if outcome.fix is not None:
            self._correct(outcome.fix)
        sent = self._note(t_s, outcome)
        speed, turn, self._blocked = self._pilot.step(outcome.order, self.odometry.pose, scan, t_s)
        self._turn_radps = turn
        self._drive(speed, turn)
        self._tick += 1
        return sent

    def _read_codes(self) -> tuple[Landmark, ...]:
        camera = self._world.camera
        if camera is None or self._tick % CAMERA_EVERY:
            return ()
        picture = camera.picture(self.body.pose, self._random, self._world.people, self._turn_radps)
        return camera.landmarks(camera.read(picture), self.odometry.pose)

    def _correct(self, fix: Fix) -> None:
        self.odometry.correct((fix.x_m, fix.y_m, fix.heading_rad))
        x, y, heading = self.body.pose
        turned = abs(math.remainder(fix.heading_rad - heading, math.tau))
        if math.hypot(fix.x_m - x, fix.y_m - y) > FALSE_FIX_M or turned > FALSE_FIX_RAD:
            self.report.false_fixes += 1

    def _note(self, t_s: float, outcome: Outcome) -> tuple[bytes, ...]:
        """Writes down what came of a step; the messages of a node that was decoded."""
        report, true, estimate, uncorrected = self.report, self.body.pose, self.odometry.pose, self._uncorrected.pose
        report.t_s = t_s
        report.done = self.state.phase is Phase.DONE
        report.hashes_tried += outcome.trials
        report.pose_error_m.append(math.dist(true[:2], estimate[:2]))
        report.odometry_error_m.append(math.dist(true[:2], uncorrected[:2]))
        if self._keep_trace:
            report.trace.append((t_s, true, estimate, uncorrected))
        self._digest.update(struct.pack("<3q", *(round(value * 1e6) for value in true)))
        why = self._why_not(outcome)
        if why:
            report.not_validated.append((t_s, why))
        opened = outcome.decoded
        if opened is None:
            return ()
        self._digest.update(struct.pack("<i", opened.node))
        if all(opened.node != node for _, node in report.decoded):
            report.decoded.append((t_s, opened.node))
            if opened.place_m is not None:
                report.places[opened.node] = opened.place_m
        for action in (opened.do, outcome.order.do if outcome.order.kind is Kind.DO else None):
            if action is not None:
                report.actions.append((t_s, action.name))
        return opened.sends

    def _why_not(self, outcome: Outcome) -> str:
        """The reason, if this step brought one that is worth telling: fallen back, stopped, or a match not believed."""
        if self.state.phase is Phase.HELD:
            return Reason.TIMED_OUT.value if outcome.event is Event.TIMED_OUT else Reason.NO_WAY.value
        if outcome.event in (Event.TIMED_OUT, Event.BLOCKED):
            return str(outcome.event.value)
        told = self.report.not_validated
        if outcome.reason in _TOLD and (not told or told[-1][1] != outcome.reason.value):
            return outcome.reason.value
        return ""

    def _drive(self, speed_mps: float, turn_radps: float) -> None:
        speed_mps = 0.0 if self._runs_into_somebody(speed_mps * TICK_S) else speed_mps
        way, turn = self.body.step(*self.body.wheels(speed_mps, turn_radps), TICK_S)
        self.odometry.step(way, turn)
        self._uncorrected.step(way, turn)

    def _runs_into_somebody(self, way_m: float) -> bool:
        """Whether a person whom it touches then is nearer after so much way: its bumper stops the wheels."""
        x, y, heading = self.body.pose
        after = x + way_m * math.cos(heading), y + way_m * math.sin(heading)
        for *person, radius in self._world.people.tolist():
            away = math.dist(after, person)
            if away < radius + self.body.config.radius_m and away < math.dist((x, y), person):
                return True
        return False

    def finish(self) -> Report:
        """What became of it."""
        told = [*self.report.not_validated, *([] if self.over else [(self.report.t_s, "out of time")])]
        return replace(self.report, not_validated=told, digest=self._digest.hexdigest(), lacks=self._lacks())

    def _lacks(self) -> tuple[str, ...]:
        # A paper file tells what nodes are made of; in a sealed one a gate tells it of the node behind.
        gates = [gate for (_, node), gate in self.state.keys.gates.items() if node not in self.state.opened]
        shapes = [*self.walker.mission.header.shapes, *(hint.shape for gate in gates for hint in gate.hints)]
        wanted = (
            ("codes on the walls", self._world.camera is None and any(shape.text for shape in shapes)),
            ("actions that robots can do", not self._pool and any(shape.action for shape in shapes)),
            ("a sensor that simulated robots do not have", any(shape.sensors for shape in shapes)),
        )
        return () if self.report.done else tuple(what for what, is_wanted in wanted if is_wanted)


def meet(robots: Iterable[MissionRobot], plan: FloorPlan, near_m: float) -> None:
    """Robots that see each other exchange which nodes they decoded: proofs, never raw data.

    Source: Encoded graphs §VI-C.
    """
    alive = list(robots)
    for i, one in enumerate(alive):
        for other in alive[i + 1 :]:
            a, b = one.body.pose[:2], other.body.pose[:2]
            if math.dist(a, b) <= near_m and plan.sees(a, b):
                told, heard = one.walker.report(one.state), other.walker.report(other.state)
                one.state = one.walker.hear_report(one.state, heard)
                other.state = other.walker.hear_report(other.state, told)
