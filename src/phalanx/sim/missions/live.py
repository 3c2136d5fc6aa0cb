"""Robots on a mission in real time, in a process of their own: a search for landmarks takes a core for a tenth of a
second, and whoever shows the robots to visitors must not wait for it.

The process is told what to live (a `MissionRun`), and tells ten times a second what became of it (a `Moment`). When a
tick takes longer than it should, the robots' time goes slower: nobody is hurled through a wall.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

from phalanx.mission import BuildOptions, Draft, Landmark, Phase, Position, Profile, Walker, build
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot.on_mission import Completed, Decoded, News, NotValidated

from .orders import start_of
from .robot import TICK_S, MissionRobot, World, meet
from .run import MissionRun, Part

WAITING = "waiting"  # to begin, before any phase of the walk
NICE = 5
# One of each part after the other: together they would be one dot on the map, all in search of the same.
APART_TICKS = 60
MEET_EVERY_TICKS = 5
REHEARSED_TICKS = 3


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a robot truly is (map frame), and how far its mission has got."""

    x_m: float
    y_m: float
    heading_rad: float
    phase: str
    why: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A tick: all robots, and what is new since the one before."""

    robots: tuple[Standing, ...]
    news: tuple[News, ...]


class Crew:
    """The robots of a run, tick by tick."""

    def __init__(self, run: MissionRun) -> None:
        self._run = run
        world = World(run.plan)
        walkers = [Walker(part.mission, part.key) for part in run.parts]
        count = len(run.parts)
        self._robots = [
            MissionRobot(
                number,
                world,
                walkers[number % count],
                run.parts[number % count].start,
                run.noise,
                run.seed,
                run.pool,
                begin_s=run.begin_s + number // count * APART_TICKS * TICK_S,
            )
            for number in range(run.robots)
        ]
        self._inbox: list[tuple[bytes, ...]] = [run.controller] * run.robots
        self._tick = 0
        self._told = [(0, 0, False)] * run.robots

    def tick(self) -> Moment:
        """What a tenth of a second later is."""
        for i, robot in enumerate(self._robots):
            if robot.over or not self._has_begun(i):
                continue
            heard, self._inbox[i] = self._inbox[i], ()
            said = robot.step(heard)
            self._inbox = [(*waiting, *said) for waiting in self._inbox]
        if self._run.meet_m and self._tick % MEET_EVERY_TICKS == 0:
            # Only those on the same file: another part's nodes have the same numbers.
            for part in range(len(self._run.parts)):
                meet(self._robots[part :: len(self._run.parts)], self._run.plan, self._run.meet_m)
        moment = Moment(
            tuple(self._standing(i) for i in range(len(self._robots))),
            tuple(news for i in range(len(self._robots)) for news in self._news(i)),
        )
        self._tick += 1
        return moment

    def _has_begun(self, i: int) -> bool:
        return self._tick >= i // len(self._run.parts) * APART_TICKS

    def _standing(self, i: int) -> Standing:
        robot = self._robots[i]
        phase, told = robot.state.phase, robot.report.not_validated
        why = told[-1][1] if told and phase in (Phase.HELD, Phase.RETURNING) else ""
        return Standing(*robot.body.pose, phase.value if self._has_begun(i) else WAITING, why)

    def _news(self, i: int) -> list[News]:
        robot = self._robots[i]
        report, opened = robot.report, robot.state.opened
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


def live(pipe: Connection, plan: FloorPlan) -> None:
    """Lives what it is told until the pipe is closed: the body of the process.

    Args:
        pipe: takes (number, MissionRun), gives (number, Moment or None): a moment of that run, None before the first.
        plan: the building, for a rehearsal: what is to be compiled is, before the first word.
    """
    os.nice(NICE)
    _rehearse(plan)
    number, crew = 0, None
    due_s = time.monotonic()
    try:
        while True:
            pipe.send((number, crew.tick() if crew else None))
            due_s = max(due_s + TICK_S, time.monotonic())
            while pipe.poll(max(0.0, due_s - time.monotonic())):
                number, run = pipe.recv()
                crew = Crew(run)
    except (EOFError, OSError):
        return


def _rehearse(plan: FloorPlan) -> None:
    x_m, y_m, heading_rad = start_of(plan)
    draft = Draft("rehearsal")
    draft.node("start", Position(x_m, y_m), start=True)
    draft.node("end", Landmark("doorway", x_m, y_m + 1, 0.0), Landmark("corner_concave", x_m, y_m, 0.0), final=True)
    draft.way("start", "end")
    (built,) = build(draft.mission(), BuildOptions(profile=Profile.PAPER), bytes)
    crew = Crew(MissionRun(plan=plan, parts=(Part(built.mission, built.key, (x_m, y_m, heading_rad)),)))
    for _ in range(REHEARSED_TICKS):
        crew.tick()
