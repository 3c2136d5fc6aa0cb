"""A mission run in a world: robots that know only the encoded graph, from their start until done, held or out of time.

Robots do not hinder each other (each sees the building and who walks there, not the others), and what is drawn for one
depends on the seed and its number alone. So a run's digest is the same however many processes share the work. It covers
all that no clock decides: where robots were at each step, what they decoded and when, hashes tried, false fixes,
actions and reasons.
"""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from phalanx.errors import UsageError
from phalanx.mission import Action, EncodedMission, Mission, StartKey, Walker
from phalanx.mission.graph import Node
from phalanx.mission.landmarks import FloorPlan
from phalanx.sim.building.odometry import OdometryNoise, Pose
from phalanx.sim.building.walkers import PEOPLE_MAX, Walkers

from .robot import TICK_S, MissionRobot, Report, World, meet

ROBOTS_MAX = 1000
PROGRESS_TICKS = 20
PEOPLE_DRAW = 1 << 32  # no robot's number: what is drawn for people is drawn for nobody else


@dataclass(frozen=True, slots=True)
class Part:
    """What one robot is given: an encoded mission, the key that starts it, the pose it is put at."""

    mission: EncodedMission
    key: StartKey | None
    start: Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRun:
    """All that decides a run.

    Args:
        plan: the world.
        parts: of the mission; robot i gets part i modulo their number.
        robots: how many.
        noise: of their odometry.
        seed: of all that is drawn.
        begin_s: the mission's clock when it starts.
        duration_s: robots that are not done by then have not completed.
        pool: actions that the robots can do.
        controller: messages that a controller has sent when the robots start.
        meet_m: robots so near that see each other exchange what they decoded; 0 is never.
        keep_trace: keep where robots were at every step.
        people: who walk about, are seen by lidars and hide codes; robots stop when they touch one.
    Raises: UsageError: a value is out of range.
    """

    plan: FloorPlan
    parts: tuple[Part, ...]
    robots: int = 1
    noise: OdometryNoise = OdometryNoise()  # noqa: RUF009  # frozen
    seed: int = 0
    begin_s: float = 0.0
    duration_s: float = 1800.0
    pool: tuple[Action, ...] = ()
    controller: tuple[bytes, ...] = ()
    meet_m: float = 0.0
    keep_trace: bool = False
    people: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.robots <= ROBOTS_MAX:
            raise UsageError(f"{self.robots} robots", f"1 to {ROBOTS_MAX}")
        if not 0 < self.duration_s <= 86_400:
            raise UsageError(f"a run of {self.duration_s} s", "up to a day")
        if self.seed < 0:
            raise UsageError(f"seed {self.seed}", "0 or more")
        if not 0 <= self.people <= PEOPLE_MAX:
            raise UsageError(f"{self.people} people", f"0 to {PEOPLE_MAX}")

    @property
    def alone(self) -> bool:
        """Whether no robot can hear another."""
        return not self.meet_m and not any(node.sends for part in self.parts for node in part.mission.nodes)


def pool_of(plain: Mission) -> tuple[Action, ...]:
    """The actions that a mission's author counts on: what robots must be capable of, without where or when."""

    def of(node: Node) -> list[Action]:
        said = [thing for alias in node.see for thing in alias if isinstance(thing, Action)]
        return [*said, node.do] if node.do else said

    actions = [action for node in plain.nodes for action in of(node)]
    return tuple(dict.fromkeys([*actions, *(way.do for way in plain.ways if way.do)]))


def run_mission(
    run: MissionRun, workers: int = 1, on_progress: Callable[[float], None] = lambda _share: None
) -> list[Report]:
    """What became of each robot.

    Args:
        run: what to run.
        workers: processes that share robots which cannot hear each other.
        on_progress: called with the share of the simulated time that has gone by; of the first process's robots.
    """
    workers = max(1, min(workers, run.robots)) if run.alone else 1
    if workers == 1:
        return _live(run, range(run.robots), on_progress)
    shares = [range(k, run.robots, workers) for k in range(workers)]
    # Ctrl-C is for whoever called; leaving the block ends the others.
    with get_context("spawn").Pool(workers - 1, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        others = [pool.apply_async(_live, (run, share)) for share in shares[1:]]
        reports = _live(run, shares[0], on_progress)
        for other in others:
            reports += other.get()
    return sorted(reports, key=lambda report: report.robot)


def _live(run: MissionRun, numbers: range, on_progress: Callable[[float], None] = lambda _share: None) -> list[Report]:
    """The reports of these robots, all of which live tick by tick."""
    world = World(run.plan)
    walkers = [Walker(part.mission, part.key) for part in run.parts]
    robots = [
        MissionRobot(
            number,
            world,
            walkers[number % len(walkers)],
            run.parts[number % len(walkers)].start,
            run.noise,
            run.seed,
            run.pool,
            begin_s=run.begin_s,
            keep_trace=run.keep_trace,
        )
        for number in numbers
    ]
    # From the seed alone: all processes see the same people.
    people = Walkers(run.plan, run.people, np.random.default_rng([run.seed, PEOPLE_DRAW]))
    said = run.controller
    ticks = round(run.duration_s / TICK_S)
    for tick in range(ticks):
        alive = [robot for robot in robots if not robot.over]
        if not alive:
            break
        heard, said = said, ()
        people.step(TICK_S)
        world.people = people.discs
        for robot in alive:
            said += robot.step(heard)
        if run.meet_m:
            meet(robots, run.plan, run.meet_m)
        if not tick % PROGRESS_TICKS:
            on_progress(tick / ticks)
    on_progress(1.0)
    return [robot.finish() for robot in robots]


def summary(run: MissionRun, reports: list[Report]) -> dict[str, Any]:
    """A run in figures, as `phalanx mission run --json` prints them."""
    search, extraction = _all(reports, "search_ms"), _all(reports, "extraction_ms")
    pose, odometry = _all(reports, "pose_error_m"), _all(reports, "odometry_error_m")
    sizes = [len(part.mission.nodes) for part in run.parts]
    return {
        "robots": run.robots,
        "nodes": sum(sizes[report.robot % len(sizes)] for report in reports),
        "decoded": sum(len(report.decoded) for report in reports),
        "completed": sum(report.done for report in reports),
        "hashes_tried": sum(report.hashes_tried for report in reports),
        "search_ms_p50": _quantile(search, 0.5),
        "search_ms_max": _quantile(search, 1.0),
        "extraction_ms_p50": _quantile(extraction, 0.5),
        "pose_error_m_p50": _quantile(pose, 0.5),
        "pose_error_m_max": _quantile(pose, 1.0),
        "odometry_error_m_max": _quantile(odometry, 1.0),
        "false_fixes": sum(report.false_fixes for report in reports),
        "not_validated": [
            {"robot": report.robot + 1, "t_s": round(t_s, 1), "reason": reason}
            for report in reports
            for t_s, reason in report.not_validated
        ],
        "actions": [
            {"robot": report.robot + 1, "t_s": round(t_s, 1), "action": action}
            for report in reports
            for t_s, action in report.actions
        ],
        "t_s": round(max(report.t_s for report in reports), 1),
        "digest": hashlib.sha256("\n".join(map(_lived, reports)).encode()).hexdigest(),
    }


def _lived(report: Report) -> str:
    """All of a report that the run decides, and no clock; its own digest is of the way, step by step."""
    told = (report.robot, report.done, report.t_s, report.hashes_tried, report.false_fixes)
    return repr((report.digest, *told, report.decoded, report.not_validated, report.actions))


def _all(reports: list[Report], name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.concatenate([np.array(getattr(report, name), np.float64) for report in reports])


def _quantile(values: np.ndarray[Any, np.dtype[np.float64]], share: float) -> float | None:
    return round(float(np.quantile(values, share)), 4) if len(values) else None
