"""Attacks on missions by a robot whose peers replay its log: false progress, false paths, false scans."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

from phalanx.mission import OpenWay
from phalanx.mission.angles import wrap
from phalanx.mission.walk.opening import Known
from phalanx.robot.adversary.mission_cheat import MissionCheat
from phalanx.robot.controllers.mission.evidence import pack_evidence, unpack_evidence
from phalanx.robot.controllers.mission.readings import with_hash_of
from phalanx.robot.controllers.python_controller import Act, Output
from phalanx.wire.table import DRIVE, KIND_DRIVE

FULL_MMPS, MOST_MRADPS = 500, 1200


class SkipNode(MissionCheat):
    """Skip a node: mark it as decoded in the mission's memory after a checkpoint."""

    def lie(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """Move the mission's state past the node once, and continue from there."""
        walk, node = self.mission.memory.walk, self.plan.node
        if node not in walk.opened:
            x_m, y_m, _ = self.mission.pose(reading)
            onward = math.atan2(self.plan.toward_m[1] - y_m, self.plan.toward_m[0] - x_m)
            known = Known(0, (x_m, y_m), None, (OpenWay(self.plan.onward, onward),))
            opened = MappingProxyType({**walk.opened, node: known})
            walk = replace(walk, at=node, target=self.plan.onward, opened=opened, keys=self.plan.keys)
            self.mission.memory = replace(self.mission.memory, walk=walk)
        return super().lie(step, t_ms, reading)


class DriveDark(MissionCheat):
    """Drive to a place that no decoded node leads to."""

    def lie(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        x_m, y_m, heading = self.mission.pose(reading)
        bearing = wrap(math.atan2(self.plan.toward_m[1] - y_m, self.plan.toward_m[0] - x_m) - heading)
        turn = max(-MOST_MRADPS, min(MOST_MRADPS, round(1500 * bearing)))
        command = DRIVE.form.pack(KIND_DRIVE, self.id, t_ms, FULL_MMPS if abs(bearing) < 1.0 else 0, turn)
        outputs = super().lie(step, t_ms, reading)
        return [Act(command) if output.payload[:1] == bytes([KIND_DRIVE]) else output for output in outputs]


class ShowUnsensed(MissionCheat):
    """Present a scan to auditors that its lidar never made."""

    def lie(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        raw = self.plan.imagine(self.mission.pose(reading))
        told = with_hash_of(reading, raw)
        evidence = self.mission.keep(step, t_ms, told, raw)
        if evidence:
            self.keep_evidence(self.shown(evidence))
        return self.mission.on_evidence(step, t_ms, told, evidence)

    def shown(self, evidence: bytes) -> bytes:
        """Return the evidence to log in place of this one."""
        return evidence


class ForgeClaim(ShowUnsensed):
    """Present the true scan, and claim that it shows the node."""

    def shown(self, evidence: bytes) -> bytes:
        sensors = self.mission.missions.sensors
        claim, _ = unpack_evidence(evidence, sensors.lidar.beams)
        return pack_evidence(claim, self.raw[: sensors.scan_bytes], self.raw[sensors.scan_bytes :])
