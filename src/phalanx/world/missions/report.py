"""Report a robot's mission by ground truth; no decision uses it."""

from __future__ import annotations

import hashlib
import math
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from phalanx.mission import Experience, Landmark, Outcome, Phase, State, Walker
from phalanx.mission.observable import MM_PER_M
from phalanx.mission.walk.claims import Claim
from phalanx.mission.walk.state import Event, Kind, Reason
from phalanx.robot.controllers.mission.controller import MissionController, Missions
from phalanx.world.building.odometry import Pose

from .body import MissionBody
from .setup import MissionRun
from .truth import Truth, pose_error

_TOLD = {Reason.DRIFT, Reason.CONTRADICTED, Reason.ALTERED}


@dataclass(slots=True)
class Report:
    """Outcome of one robot."""

    robot: int
    done: bool = False
    t_s: float = 0.0
    # (t_s, node), in the order in which they were decoded; first times alone
    decoded: list[tuple[float, int]] = field(default_factory=list)
    places: dict[int, tuple[float, float]] = field(default_factory=dict)  # of decoded nodes, map frame, metres
    hashes_tried: int = 0  # hashes or KDFs
    false_fixes: int = 0  # fixes that left it further off than `truth` allows
    # search_ms, extraction_ms: of each step in which something was tried or seen; by the clock, so not in the digest
    # (shorter where another robot of this process has searched before)
    search_ms: list[float] = field(default_factory=list)
    extraction_ms: list[float] = field(default_factory=list)
    pose_error_m: list[float] = field(default_factory=list)  # of each step, with fixes
    odometry_error_m: list[float] = field(default_factory=list)  # without
    not_validated: list[tuple[float, str]] = field(default_factory=list)  # (t_s, reason)
    actions: list[tuple[float, str]] = field(default_factory=list)
    # (t_s, true pose, estimate, odometry alone) of each step, if it is kept
    trace: list[tuple[float, Pose, Pose, Pose]] = field(default_factory=list)
    # (t_s, what it had learnt that its odometry leaves out: see `drift`) whenever that changed, if the trace is kept
    drifts: list[tuple[float, tuple[float, float, float]]] = field(default_factory=list)
    digest: str = ""
    lacks: tuple[str, ...] = ()  # what nodes that it could have decoded next are made of, and its world does not have
    safe_mode_s: float | None = None  # when it was stopped by those who audit it, or None
    # What it has learnt that its odometry leaves out: of the way, of turns, and radians per metre
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    audits_passed: int = 0  # of others, by it
    audits_refused: int = 0  # likewise
    false_decodes: int = 0  # nodes decoded by a landmark that was not in sight, or in another place
    # (t_s, what was false: "fix" or a node, what was wrong with it), for whoever looks for the cause
    denied: list[tuple[float, str, str]] = field(default_factory=list)
    heading_error_rad: list[float] = field(default_factory=list)  # of each step, with fixes


class TimedController(MissionController):
    """The robot's own controller, with a stopwatch on which nothing depends.

    Attributes:
        search_ms, extraction_ms: of each step in which something was tried or seen.
    """

    def __init__(self, rob_id: int, missions: Missions, walker: Walker) -> None:
        super().__init__(rob_id, missions, walker)
        self.search_ms: list[float] = []
        self.extraction_ms: list[float] = []

    def landmarks(self, scan: bytes, pose: Pose) -> Sequence[Landmark]:
        """As the robot's."""
        began = time.perf_counter()
        found = super().landmarks(scan, pose)
        self.extraction_ms.append(1e3 * (time.perf_counter() - began))
        return found

    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """As the robot's."""
        self.tries, began = 0, time.perf_counter()
        kept = super().keep(step, t_ms, reading, raw)
        if self.tries:
            self.search_ms.append(1e3 * (time.perf_counter() - began))
        return kept

    def walk(self, seen: Experience, claim: Claim | None) -> tuple[State, Outcome]:
        """As the robot's."""
        began = time.perf_counter()
        walk, outcome = super().walk(seen, claim)
        if outcome.trials:
            self.search_ms.append(1e3 * (time.perf_counter() - began))
        return walk, outcome


class Logbook:
    """Keeps a robot's report; with its number the seed decides all that is drawn for it."""

    def __init__(self, number: int, body: MissionBody, controller: TimedController, *, keep_trace: bool) -> None:
        self.number, self.body, self.controller = number, body, controller
        self.report = Report(number, search_ms=controller.search_ms, extraction_ms=controller.extraction_ms)
        self._keep_trace = keep_trace
        self._digest = hashlib.sha256()
        self._truth = Truth(body.building.plan, body.building.lidar.config)

    def note(self, t_s: float) -> None:
        """Writes down what came of a step."""
        report, true = self.report, self.body.wheels.pose
        estimate, uncorrected = self.controller.memory.belief.pose, self.controller.uncorrected_pose()
        outcome, phase = self.controller.outcome, self.controller.memory.walk.phase
        report.t_s = t_s
        report.done = phase is Phase.DONE
        report.pose_error_m.append(math.dist(true[:2], estimate[:2]))
        report.heading_error_rad.append(abs(math.remainder(estimate[2] - true[2], math.tau)))
        report.odometry_error_m.append(math.dist(true[:2], uncorrected[:2]))
        if self._keep_trace:
            report.trace.append((t_s, true, estimate, uncorrected))
            drift = self.controller.memory.belief.drift
            if drift != (report.drifts[-1][1] if report.drifts else None):
                report.drifts.append((t_s, drift))
        self._digest.update(struct.pack("<3q", *(round(value * 1e6) for value in true)))
        if outcome is None:
            return
        report.hashes_tried += outcome.trials
        if outcome.fix is not None and (wrong := pose_error(true, estimate, self.controller.memory.belief.doubt)):
            report.false_fixes += 1
            report.denied.append((t_s, "fix", wrong))
        why = self._why_not(outcome, phase)
        if why:
            report.not_validated.append((t_s, why))
        if outcome.decoded is not None:
            self._decoded(t_s, outcome)

    def _decoded(self, t_s: float, outcome: Outcome) -> None:
        report, opened = self.report, outcome.decoded
        assert opened is not None, "called when there is one"
        self._digest.update(struct.pack("<i", opened.node))
        cell_m = self.controller.given.mission.header.coding.delta_mm / MM_PER_M
        if wrong := self._truth.decoding_error(self.body.wheels.pose, opened, self.controller.seen, cell_m):
            report.false_decodes += 1
            report.denied.append((t_s, f"node {opened.node}", wrong))
        if all(opened.node != node for _, node in report.decoded):
            report.decoded.append((t_s, opened.node))
            if opened.place_m is not None:
                report.places[opened.node] = opened.place_m
        for action in (opened.do, outcome.order.do if outcome.order.kind is Kind.DO else None):
            if action is not None:
                report.actions.append((t_s, action.name))

    def _why_not(self, outcome: Outcome, phase: Phase) -> str:
        """The reason, if this step brought one that is worth telling: fallen back, stopped, or a match not believed."""
        told = self.report.not_validated
        if outcome.reason is Reason.STOPPED:
            return ""
        if phase is Phase.HELD:
            return Reason.TIMED_OUT.value if outcome.event is Event.TIMED_OUT else Reason.NO_WAY.value
        if outcome.event in (Event.TIMED_OUT, Event.BLOCKED):
            return str(outcome.event.value)
        if outcome.reason in _TOLD and (not told or told[-1][1] != outcome.reason.value):
            return str(outcome.reason.value)
        return ""

    def finish(self, safe_mode_s: float | None = None) -> Report:
        """Return the outcome of the robot, and when its auditors stopped it, if they did."""
        told = self.report.not_validated
        if safe_mode_s is not None:
            told = [*told, (safe_mode_s, "Safe Mode")]
        elif not self.controller.over:
            told = [*told, (self.report.t_s, "out of time")]
        return replace(
            self.report,
            not_validated=told,
            digest=self._digest.hexdigest(),
            lacks=self._lacks(),
            drift=self.controller.memory.belief.drift,
            safe_mode_s=safe_mode_s,
        )

    def _lacks(self) -> tuple[str, ...]:
        # A paper file tells what nodes are made of; in a sealed one a gate tells it of the node behind.
        walk, mission = self.controller.memory.walk, self.controller.given.mission
        gates = [gate for (_, node), gate in walk.keys.gates.items() if node not in walk.opened]
        shapes = [*mission.header.shapes, *(hint.shape for gate in gates for hint in gate.hints)]
        building = self.body.building
        wanted = (
            ("codes on the walls", "text", building.camera),
            ("actions that robots can do", "action", self.controller.given.pool),
            ("beacons, or what else other sensors tell of", "sensors", building.plan.sources),
        )
        lacks = (what for what, kind, has in wanted if not has and any(getattr(shape, kind) for shape in shapes))
        return () if self.report.done else tuple(lacks)


def digest_of(reports: list[Report]) -> str:
    """Of all that a run decides, and no clock: where robots were at each step, what they decoded, tried and did."""

    def lived(report: Report) -> str:
        told = (report.robot, report.done, report.t_s, report.hashes_tried, report.false_fixes, report.safe_mode_s)
        return repr((report.digest, *told, report.decoded, report.not_validated, report.actions))

    return hashlib.sha256("\n".join(map(lived, reports)).encode()).hexdigest()


def format_drift(drift: tuple[float, float, float]) -> str:
    """Format the estimated odometry drift for people, see `Report.drift`."""
    way, turn, curve = drift
    return f"way {100 * way:+.1f} %   turns {100 * turn:+.1f} %   {math.degrees(curve):+.2f}° a metre"


def quantile(reports: list[Report], name: str, share: float) -> float | None:
    """Of a figure that reports have for each step; None if there was no step."""
    values = np.concatenate([np.array(getattr(report, name), np.float64) for report in reports])
    return round(float(np.quantile(values, share)), 4) if len(values) else None


def summary(run: MissionRun, reports: list[Report]) -> dict[str, Any]:
    """Return a run in figures, as `phalanx mission run --json` prints them."""
    return {
        "robots": len(reports),
        "nodes": sum(len(run.part_of(report.robot).mission.nodes) for report in reports),
        "decoded": sum(len(report.decoded) for report in reports),
        "completed": sum(report.done for report in reports),
        "hashes_tried": sum(report.hashes_tried for report in reports),
        "search_ms_p50": quantile(reports, "search_ms", 0.5),
        "search_ms_max": quantile(reports, "search_ms", 1.0),
        "extraction_ms_p50": quantile(reports, "extraction_ms", 0.5),
        "pose_error_m_p50": quantile(reports, "pose_error_m", 0.5),
        "pose_error_m_max": quantile(reports, "pose_error_m", 1.0),
        "odometry_error_m_max": quantile(reports, "odometry_error_m", 1.0),
        "false_fixes": sum(report.false_fixes for report in reports),
        "false_decodes": sum(report.false_decodes for report in reports),
        "in_safe_mode": [report.robot + 1 for report in reports if report.safe_mode_s is not None],
        "not_validated": [
            {"robot": report.robot + 1, "t_s": round(t_s, 1), "reason": reason}
            for report in reports
            for t_s, reason in report.not_validated
        ],
        "drift": [
            dict(zip(("robot", "way", "turn", "curve_radpm"), (report.robot + 1, *report.drift), strict=True))
            for report in reports
        ],
        "actions": [
            {"robot": report.robot + 1, "t_s": round(t_s, 1), "action": action}
            for report in reports
            for t_s, action in report.actions
        ],
        "t_s": round(max(report.t_s for report in reports), 1),
        "digest": digest_of(reports),
        "defence": run.defence,
        "f_max": run.f_max if run.audited else None,
        "audits": {
            "passed": sum(report.audits_passed for report in reports),
            "refused": sum(report.audits_refused for report in reports),
        },
    }
