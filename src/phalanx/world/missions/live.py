"""Robots on a mission in real time, in a process of their own.

A search for landmarks takes a core for a tenth of a second. Whoever shows the robots to visitors must not wait for it.

The process receives what to live (a `MissionRun`), and sends ten times a second what became of it (a `Moment`). When
a tick takes longer than it should, the robots' time goes slower: nobody is hurled through a wall.
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

WAITING = "waiting"  # to begin, before any phase of the walk
TICK_S = 0.1
NICE = 5
# A compromised robot that wants to be elsewhere wants to be so far from the building's edge.
EDGE_M = 1.0


@dataclass(frozen=True, slots=True)
class RobotTruth:
    """True pose of a robot (map frame), its mission's progress, and its vouchers."""

    x_m: float
    y_m: float
    heading_rad: float
    phase: str
    why: str
    # Numbers of its auditors, each with the seconds for which its token still counts, the longest first
    vouchers: tuple[tuple[int, float], ...] = ()
    safe_mode: bool = False
    attack: str = ""  # that it runs, or ""
    drift: Drift = (0, 0, 0)  # that it has learnt of its wheels


@dataclass(frozen=True, slots=True)
class Moment:
    """A tick: all robots, and what is new since the one before."""

    robots: tuple[RobotTruth, ...]
    news: tuple[News, ...]
    audits: tuple[tuple[int, int, str], ...] = ()  # that ended: auditor, auditee, why there was no token or ""


@dataclass(frozen=True, slots=True)
class CompromiseRequest:
    """Request to compromise a robot: its number, and the attack's name."""

    robot: int
    attack: str


class Crew:
    """The robots of a run, tick by tick."""

    def __init__(self, run: MissionRun) -> None:
        self._run = run
        self._world = MissionWorld(run)
        self._tick = 0
        self._told = [(0, 0, False)] * run.robots

    def tick(self, held: bool = False) -> Moment:
        """Advance by a tenth of a second; for held robots no time passes."""
        if not held:
            self._tick += 1
            self._world.advance(self._tick * TICK_S)
        verdicts = self._world.new_verdicts()
        return Moment(
            tuple(self._standing(i, robot) for i, robot in enumerate(self._world.robots)),
            tuple(news for i, robot in enumerate(self._world.robots) for news in self._news(i, robot)),
            tuple(
                (auditor - 1, auditee - 1, why.name.lower().replace("_", " ") if why else "")
                for _, auditor, auditee, why in verdicts
            ),
        )

    def compromise(self, lie: CompromiseRequest) -> None:
        """The robot lies from now on: it makes for the corner of the building that is farthest from it."""
        robot = self._world.robots[lie.robot]
        x0, y0, x1, y1 = self._run.plan.bounds
        corners = [(x, y) for x in (x0 + EDGE_M, x1 - EDGE_M) for y in (y0 + EDGE_M, y1 - EDGE_M)]
        toward_m = max(corners, key=lambda corner: math.dist(corner, robot.body.wheels.pose[:2]))
        self._world.compromise(lie.robot, attacks()[lie.attack], CheatPlan(after_ms=0, toward_m=toward_m))

    def _standing(self, i: int, robot: MissionRobot) -> RobotTruth:
        phase, told = robot.controller.memory.walk.phase, robot.report.not_validated
        is_stopped = bool(self._world.world.safe[i])
        why = told[-1][1] if told and phase in (Phase.HELD, Phase.RETURNING) else ""
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
        decoded, refused, done = self._told[i]
        news: list[News] = []
        for _, node in report.decoded[decoded:]:
            landmark = opened[node].landmark
            news.append(Decoded(i, node, opened[node].name, opened[node].place_m, landmark.type if landmark else ""))
        news += [NotValidated(i, why) for _, why in report.not_validated[refused:]]
        if report.done and not done:
            news.append(Completed(i))
        self._told[i] = len(report.decoded), len(report.not_validated), report.done
        return news


def live(pipe: Connection, held: c_byte) -> None:
    """Lives what it is told until the pipe is closed: the body of the process.

    Args:
        pipe: takes (number, MissionRun or CompromiseRequest), gives (number, Moment or None before the first).
        held: other than 0 while robots are to stand still.
    """
    os.nice(NICE)
    number: int = 0
    crew: Crew | None = None
    try:
        due_s = time.monotonic()
        while True:
            pipe.send((number, crew.tick(bool(held.value)) if crew else None))
            due_s = max(due_s + TICK_S, time.monotonic())
            while pipe.poll(max(0.0, due_s - time.monotonic())):
                number, told = pipe.recv()
                if isinstance(told, MissionRun):
                    crew = Crew(told)
                elif crew is not None:
                    crew.compromise(told)
    except (EOFError, OSError):
        return
