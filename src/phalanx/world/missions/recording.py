"""Record a mission's run as MCAP for Foxglove: walls, true and estimated poses, decoded landmarks.

    /scene    foxglove.SceneUpdate      walls from the start; each landmark from its first decoding
    /tf       foxglove.FrameTransforms  world → robot-1 (true pose), world → robot-1-believes (estimate)
    /log      foxglove.Log              decoded, done, not validated, and finally the estimated odometry error
    /drift    phalanx.Drift             a robot's estimate of its odometry error, whenever it changes

The file contains only landmarks that were decoded.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from phalanx.mission.landmarks import FloorPlan
from phalanx.recording.recorder import NS, WORLD, Recorder, cylinder, frame, pose_at, time_of

from .report import Report, format_drift

GREY, GREEN = Color(r=0.4, g=0.4, b=0.4, a=1.0), Color(r=0.0, g=0.62, b=0.45, a=0.8)
MARK_M, MARK_HEIGHT_M = 0.5, 0.3
DRIFT = {
    "type": "object",
    "title": "phalanx.Drift",
    "description": "A robot's estimate of what its odometry misses: shares of distances and turns, turn to the left",
    "properties": {
        "robot": {"type": "integer"},
        **{key: {"type": "number"} for key in ("way", "turn", "curve_radpm")},
    },
}
Entry = tuple[float, str, Any]  # time, topic, message


class _Recorder(Recorder):
    def _begin(self) -> None:
        self._channel("/drift", "json", "phalanx.Drift", "jsonschema", json.dumps(DRIFT).encode())


def write_recording(path: Path, plan: FloorPlan, reports: list[Report]) -> None:
    """Write a run whose traces were kept to a new file.

    Raises: UsageError: no such folder. Unavailable: it cannot be written.
    """
    entries = [
        (0.0, "/scene", _walls(plan)),
        *_landmarks(reports),
        *_frames(reports),
        *_drifts(reports),
        *_log(reports),
    ]
    with _Recorder(path) as file:
        for t_s, topic, message in sorted(entries, key=lambda entry: entry[:2]):
            file.put(topic, _ns(t_s), message)


def _ns(t_s: float) -> int:
    return round(t_s * NS)


def _walls(plan: FloorPlan) -> SceneUpdate:
    points = [Point3(x=x, y=y) for wall in plan.walls.tolist() for x, y in (wall[:2], wall[2:])]
    lines = LinePrimitive(
        type=LinePrimitive.LINE_LIST, pose=pose_at(0.0, 0.0), thickness=0.08, points=points, color=GREY
    )
    return SceneUpdate(entities=[SceneEntity(timestamp=time_of(0), frame_id=WORLD, id="walls", lines=[lines])])


def _landmarks(reports: list[Report]) -> Iterator[Entry]:
    first: dict[tuple[float, float], float] = {}
    for report in reports:
        for t_s, node in report.decoded:
            if node in report.places:
                at = report.places[node]
                first[at] = min(t_s, first.get(at, t_s))
    for (x_m, y_m), t_s in first.items():
        mark = cylinder(x_m, y_m, MARK_M, MARK_HEIGHT_M, GREEN)
        name = f"landmark {x_m:.3f} {y_m:.3f}"
        entity = SceneEntity(timestamp=time_of(_ns(t_s)), frame_id=WORLD, id=name, cylinders=[mark])
        yield t_s, "/scene", SceneUpdate(entities=[entity])


def _frames(reports: list[Report]) -> Iterator[Entry]:
    for report in reports:
        name = f"robot-{report.robot + 1}"
        for t_s, true, estimate, _ in report.trace:
            frames = [frame(_ns(t_s), name, *true), frame(_ns(t_s), f"{name}-believes", *estimate)]
            yield t_s, "/tf", FrameTransforms(transforms=frames)


def _drifts(reports: list[Report]) -> Iterator[Entry]:
    for report in reports:
        for t_s, (way, turn, curve) in report.drifts:
            yield t_s, "/drift", {"robot": report.robot + 1, "way": way, "turn": turn, "curve_radpm": curve}


def _log(reports: list[Report]) -> Iterator[Entry]:
    for report in reports:
        lines = [(t_s, Log.INFO, f"decoded node {node}") for t_s, node in report.decoded]
        lines += [(t_s, Log.WARNING, f"not validated: {reason}") for t_s, reason in report.not_validated]
        lines += [(t_s, Log.INFO, f"did {action}") for t_s, action in report.actions]
        lines.append((report.t_s, Log.INFO, f"odometry error   {format_drift(report.drift)}"))
        lines.append((report.t_s, Log.INFO if report.done else Log.ERROR, "done" if report.done else "not completed"))
        for t_s, level, message in lines:
            log = Log(timestamp=time_of(_ns(t_s)), level=level, name=f"robot-{report.robot + 1}", message=message)
            yield t_s, "/log", log
