"""Robots on a mission in real time, in a separate process.

A search for landmarks takes a core for a tenth of a second, and the gateway must not wait for it.

The process receives a `MissionRun`, and sends a `Moment` with the robots' state ten times per second. If a tick takes
too long, simulated time slows down, so that no robot jumps through a wall.
"""

from __future__ import annotations

import math
import os
import time
from ctypes import c_byte
from dataclasses import dataclass
from multiprocessing.connection import Connection

from phalanx.mission import Phase
from phalanx.robot.adversary.mission_cheat import CheatPlan
from phalanx.robot.adversary.registry import attacks
from phalanx.robot.on_mission import Completed, Decoded, Drift, News, NotValidated, drift_of
from phalanx.world.audited.world import shields

from .setup import MissionRun
from .world import MissionRobot, MissionWorld

WAITING = "waiting"  # for its start, before any phase of the mission
TICK_S = 0.1
NICE = 5
# Distance from the building's edge of the point that a compromised robot drives to.
EDGE_M = 1.0


@dataclass(frozen=True, slots=True)
class RobotTruth:
    """True pose of a robot (map frame), its mission's progress, and its tokens."""

    x_m: float
    y_m: float
    heading_rad: float
    phase: str
    why: str
    # Numbers of its auditors, each with the seconds for which its token remains valid, longest first
    vouchers: tuple[tuple[int, float], ...] = ()
    safe_mode: bool = False
    attack: str = ""  # name of the attack that it runs, or ""
    drift: Drift = (0, 0, 0)  # estimated odometry error


@dataclass(frozen=True, slots=True)
class Moment:
    """State of all robots after a tick, and events since the tick before."""

    robots: tuple[RobotTruth, ...]
    news: tuple[News, ...]
    audits: tuple[tuple[int, int, str], ...] = ()  # completed: auditor, auditee, reason of refusal or ""


@dataclass(frozen=True, slots=True)
class CompromiseRequest:
    """Request to compromise a robot, with the attack's name."""

    robot: int
    attack: str


class TickedMission:
    """Robots of a run, advanced tick by tick."""

    def __init__(self, run: MissionRun) -> None:
        self._run = run
        self._world = MissionWorld(run)
        self._tick = 0
        self._reported = [(0, 0, False)] * run.robots

    def tick(self, held: bool = False) -> Moment:
        """Advance by a tenth of a second, or not at all while `held`."""
        if not held:
            self._tick += 1
            self._world.advance(self._tick * TICK_S)
        verdicts = self._world.new_verdicts()
        return Moment(
            tuple(self._state_of(i, robot) for i, robot in enumerate(self._world.robots)),
            tuple(news for i, robot in enumerate(self._world.robots) for news in self._news(i, robot)),
            tuple(
                (auditor - 1, auditee - 1, why.name.lower().replace("_", " ") if why else "")
                for _, auditor, auditee, why in verdicts
            ),
        )

    def compromise(self, lie: CompromiseRequest) -> None:
        """Compromise a robot: from now on it drives to the corner of the building that is farthest from it."""
        robot = self._world.robots[lie.robot]
        x0, y0, x1, y1 = self._run.plan.bounds
        corners = [(x, y) for x in (x0 + EDGE_M, x1 - EDGE_M) for y in (y0 + EDGE_M, y1 - EDGE_M)]
        toward_m = max(corners, key=lambda corner: math.dist(corner, robot.body.wheels.pose[:2]))
        self._world.compromise(lie.robot, attacks()[lie.attack], CheatPlan(after_ms=0, toward_m=toward_m))

    def _state_of(self, i: int, robot: MissionRobot) -> RobotTruth:
        phase, refusals = robot.controller.memory.walk.phase, robot.report.not_validated
        is_stopped = bool(self._world.world.safe[i])
        why = refusals[-1][1] if refusals and phase in (Phase.HELD, Phase.RETURNING) else ""
        begun = self._world.now_s >= robot.controller.given.wait_s
        return RobotTruth(
            *robot.body.wheels.pose,
            Phase.HELD.value if is_stopped else phase.value if begun else WAITING,
            "Safe Mode" if is_stopped else why,
            tuple((auditor - 1, left_s) for auditor, left_s in shields(self._world.world, i))
            if self._run.audited
            else (),
            is_stopped,
            robot.attack,
            drift_of(*robot.controller.memory.belief.drift),
        )

    def _news(self, i: int, robot: MissionRobot) -> list[News]:
        report, opened = robot.report, robot.controller.memory.walk.opened
        decoded, refused, done = self._reported[i]
        news: list[News] = []
        for _, node in report.decoded[decoded:]:
            landmark = opened[node].landmark
            news.append(Decoded(i, node, opened[node].name, opened[node].place_m, landmark.type if landmark else ""))
        news += [NotValidated(i, why) for _, why in report.not_validated[refused:]]
        if report.done and not done:
            news.append(Completed(i))
        self._reported[i] = len(report.decoded), len(report.not_validated), report.done
        return news


def live(pipe: Connection, held: c_byte) -> None:
    """Run the process: advance robots and send their state until the pipe is closed.

    Args:
        pipe: receives (number, MissionRun or CompromiseRequest), sends (number, Moment or None before the first run).
        held: nonzero to pause the robots.
    """
    os.nice(NICE)
    number: int = 0
    crew: TickedMission | None = None
    try:
        due_s = time.monotonic()
        while True:
            pipe.send((number, crew.tick(bool(held.value)) if crew else None))
            due_s = max(due_s + TICK_S, time.monotonic())
            while pipe.poll(max(0.0, due_s - time.monotonic())):
                number, request = pipe.recv()
                if isinstance(request, MissionRun):
                    crew = TickedMission(request)
                elif crew is not None:
                    crew.compromise(request)
    except (EOFError, OSError):
        return
