"""Report a robot's mission by ground truth, for evaluation only."""

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

_REPORTED = {Reason.DRIFT, Reason.CONTRADICTED, Reason.ALTERED}


@dataclass(slots=True)
class Report:
    """Outcome of one robot's mission."""

    robot: int
    done: bool = False
    t_s: float = 0.0
    # (t_s, node) in order of decoding; first times only
    decoded: list[tuple[float, int]] = field(default_factory=list)
    places: dict[int, tuple[float, float]] = field(default_factory=dict)  # of decoded nodes, map frame, metres
    hashes_tried: int = 0  # includes KDFs
    false_fixes: int = 0  # fixes with a larger error than `truth` allows
    # search_ms, extraction_ms: wall-clock time of each step with a search or an extraction; not part of the digest
    # (shorter if another robot of this process has searched before)
    search_ms: list[float] = field(default_factory=list)
    extraction_ms: list[float] = field(default_factory=list)
    pose_error_m: list[float] = field(default_factory=list)  # at each step, with fixes
    odometry_error_m: list[float] = field(default_factory=list)  # at each step, without fixes
    not_validated: list[tuple[float, str]] = field(default_factory=list)  # (t_s, reason)
    actions: list[tuple[float, str]] = field(default_factory=list)
    # (t_s, true pose, estimate, odometry alone) at each step, if the trace is kept
    trace: list[tuple[float, Pose, Pose, Pose]] = field(default_factory=list)
    # (t_s, estimated odometry error: see `drift`) at each change, if the trace is kept
    drifts: list[tuple[float, tuple[float, float, float]]] = field(default_factory=list)
    digest: str = ""
    lacks: tuple[str, ...] = ()  # kinds of observations that undecoded nodes need and the building lacks
    safe_mode_s: float | None = None  # time at which its auditors stopped it, or None
    # Its estimate of what its odometry misses: share of distances and of turns, and radians per metre
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    audits_passed: int = 0  # audits of other robots by this one
    audits_refused: int = 0  # likewise
    false_decodes: int = 0  # nodes decoded by a landmark that was hidden, or in another place
    # (t_s, "fix" or the node, kind of the error), for diagnosis
    denied: list[tuple[float, str, str]] = field(default_factory=list)
    heading_error_rad: list[float] = field(default_factory=list)  # at each step, with fixes


class TimedController(MissionController):
    """Mission controller that also measures its computing time, without effect on its behaviour.

    Attributes:
        search_ms, extraction_ms: of each step with a search or an extraction.
    """

    def __init__(self, rob_id: int, missions: Missions, walker: Walker) -> None:
        super().__init__(rob_id, missions, walker)
        self.search_ms: list[float] = []
        self.extraction_ms: list[float] = []

    def landmarks(self, scan: bytes, pose: Pose) -> Sequence[Landmark]:
        """Extract landmarks as the controller does, and record the time."""
        began = time.perf_counter()
        found = super().landmarks(scan, pose)
        self.extraction_ms.append(1e3 * (time.perf_counter() - began))
        return found

    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """Process a reading as the controller does, and record the time."""
        self.tries, began = 0, time.perf_counter()
        kept = super().keep(step, t_ms, reading, raw)
        if self.tries:
            self.search_ms.append(1e3 * (time.perf_counter() - began))
        return kept

    def walk(self, seen: Experience, claim: Claim | None) -> tuple[State, Outcome]:
        """Advance the mission as the controller does, and record the time."""
        began = time.perf_counter()
        walk, outcome = super().walk(seen, claim)
        if outcome.trials:
            self.search_ms.append(1e3 * (time.perf_counter() - began))
        return walk, outcome


class ReportRecorder:
    """Recorder of a robot's report; the run's seed and the robot's number determine its random draws."""

    def __init__(self, number: int, body: MissionBody, controller: TimedController, *, keep_trace: bool) -> None:
        self.number, self.body, self.controller = number, body, controller
        self.report = Report(number, search_ms=controller.search_ms, extraction_ms=controller.extraction_ms)
        self._keep_trace = keep_trace
        self._digest = hashlib.sha256()
        self._truth = Truth(body.building.plan, body.building.lidar.config)

    def note(self, t_s: float) -> None:
        """Record the outcome of a step."""
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
        if outcome.fix is not None and (
            wrong := pose_error(true, estimate, self.controller.memory.belief.pose_covariance)
        ):
            report.false_fixes += 1
            report.denied.append((t_s, "fix", wrong))
        why = self._why_not(outcome, phase)
        if why:
            report.not_validated.append((t_s, why))
        if outcome.decoded is not None:
            self._decoded(t_s, outcome)

    def _decoded(self, t_s: float, outcome: Outcome) -> None:
        report, opened = self.report, outcome.decoded
        assert opened is not None, "called only after a decoding"
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
        """Return the reason if a step fell back, stopped or rejected a match, else ""."""
        reported = self.report.not_validated
        if outcome.reason is Reason.STOPPED:
            return ""
        if phase is Phase.HELD:
            return Reason.TIMED_OUT.value if outcome.event is Event.TIMED_OUT else Reason.NO_WAY.value
        if outcome.event in (Event.TIMED_OUT, Event.BLOCKED):
            return str(outcome.event.value)
        if outcome.reason in _REPORTED and (not reported or reported[-1][1] != outcome.reason.value):
            return str(outcome.reason.value)
        return ""

    def finish(self, safe_mode_s: float | None = None) -> Report:
        """Return the robot's report; `safe_mode_s` is the time at which its auditors stopped it, if they did."""
        reported = self.report.not_validated
        if safe_mode_s is not None:
            reported = [*reported, (safe_mode_s, "Safe Mode")]
        elif not self.controller.over:
            reported = [*reported, (self.report.t_s, "out of time")]
        return replace(
            self.report,
            not_validated=reported,
            digest=self._digest.hexdigest(),
            lacks=self._lacks(),
            drift=self.controller.memory.belief.drift,
            safe_mode_s=safe_mode_s,
        )

    def _lacks(self) -> tuple[str, ...]:
        # A paper file contains the shapes of all nodes; in a sealed one a gate contains that of the next node.
        walk, mission = self.controller.memory.walk, self.controller.given.mission
        gates = [gate for (_, node), gate in walk.keys.gates.items() if node not in walk.opened]
        shapes = [*mission.header.shapes, *(hint.shape for gate in gates for hint in gate.hints)]
        building = self.body.building
        wanted = (
            ("codes on the walls", "text", building.camera),
            ("actions that robots can do", "action", self.controller.given.pool),
            ("beacons or other sources of sensor readings", "sensors", building.plan.sources),
        )
        lacks = (what for what, kind, has in wanted if not has and any(getattr(shape, kind) for shape in shapes))
        return () if self.report.done else tuple(lacks)


def digest_of(reports: list[Report]) -> str:
    """Return a digest of everything deterministic in a run: poses, decoded nodes, hashes tried and actions."""

    def outcome_of(report: Report) -> str:
        totals = (report.robot, report.done, report.t_s, report.hashes_tried, report.false_fixes, report.safe_mode_s)
        return repr((report.digest, *totals, report.decoded, report.not_validated, report.actions))

    return hashlib.sha256("\n".join(map(outcome_of, reports)).encode()).hexdigest()


def format_drift(drift: tuple[float, float, float]) -> str:
    """Format the estimated odometry error for display; see `Report.drift`."""
    way, turn, curve = drift
    return f"way {100 * way:+.1f} %   turns {100 * turn:+.1f} %   {math.degrees(curve):+.2f}° a metre"


def quantile(reports: list[Report], name: str, share: float) -> float | None:
    """Return a quantile of a per-step value over all reports; None without steps."""
    values = np.concatenate([np.array(getattr(report, name), np.float64) for report in reports])
    return round(float(np.quantile(values, share)), 4) if len(values) else None


def summary(run: MissionRun, reports: list[Report]) -> dict[str, Any]:
    """Return the run's summary, as `phalanx mission run --json` prints it."""
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
