"""A mission's run as MCAP, which opens in Foxglove: the walls, where robots are and believe to be, what they decoded.

    /scene    foxglove.SceneUpdate      walls from the start; each landmark from when somebody decoded it
    /tf       foxglove.FrameTransforms  world → robot-1, and robot-1-believes: where it takes itself to be
    /log      foxglove.Log              decoded, done, not validated

Times are the run's own, from 0: the same run gives the same bytes. What nobody decoded is not in the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as Place
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from phalanx import __version__
from phalanx.errors import Unavailable, UsageError
from phalanx.mission.landmarks import FloorPlan
from phalanx.sim.building.odometry import Pose

from .report import Report

NS = 1_000_000_000
WORLD = "world"
GREY, GREEN = Color(r=0.4, g=0.4, b=0.4, a=1.0), Color(r=0.0, g=0.62, b=0.45, a=0.8)
MARK_M, MARK_HEIGHT_M = 0.5, 0.3
Entry = tuple[float, str, Any]  # when, topic, message


def write_recording(path: Path, plan: FloorPlan, reports: list[Report]) -> None:
    """Put a run into a file.

    Args:
        reports: with their traces.
    Raises: UsageError: no such folder. Unavailable: it cannot be written.
    Source: mcap.dev; Foxglove's schemas.
    """
    if not path.absolute().parent.is_dir():
        raise UsageError(f"no folder {path.parent}", "make it first")
    entries = [(0.0, "/scene", _walls(plan)), *_landmarks(reports), *_frames(reports), *_log(reports)]
    try:
        with path.open("wb") as file:
            writer: Any = Writer(file)
            writer.start(profile="", library=f"phalanx {__version__}")
            channels = {
                topic: _channel(writer, topic, kind)
                for topic, kind in (("/scene", SceneUpdate), ("/tf", FrameTransforms), ("/log", Log))
            }
            for t_s, topic, message in sorted(entries, key=lambda entry: entry[:2]):
                writer.add_message(channels[topic], round(t_s * NS), message.SerializeToString(), round(t_s * NS))
            writer.finish()
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}", "another place for --record") from error


def _channel(writer: Any, topic: str, kind: Any) -> int:
    schema = writer.register_schema(
        kind.DESCRIPTOR.full_name, "protobuf", build_file_descriptor_set(kind).SerializeToString()
    )
    return int(writer.register_channel(topic, "protobuf", schema))


def _walls(plan: FloorPlan) -> SceneUpdate:
    points = [Point3(x=x, y=y) for wall in plan.walls.tolist() for x, y in (wall[:2], wall[2:])]
    lines = LinePrimitive(
        type=LinePrimitive.LINE_LIST, pose=_place(0.0, 0.0), thickness=0.08, points=points, color=GREY
    )
    return SceneUpdate(entities=[SceneEntity(timestamp=_time(0.0), frame_id=WORLD, id="walls", lines=[lines])])


def _landmarks(reports: list[Report]) -> Iterator[Entry]:
    first: dict[tuple[float, float], float] = {}
    for report in reports:
        for t_s, node in report.decoded:
            if node in report.places:
                at = report.places[node]
                first[at] = min(t_s, first.get(at, t_s))
    for (x_m, y_m), t_s in first.items():
        mark = CylinderPrimitive(
            pose=_place(x_m, y_m),
            size=Vector3(x=MARK_M, y=MARK_M, z=MARK_HEIGHT_M),
            bottom_scale=1.0,
            top_scale=1.0,
            color=GREEN,
        )
        name = f"landmark {x_m:.3f} {y_m:.3f}"
        entity = SceneEntity(timestamp=_time(t_s), frame_id=WORLD, id=name, cylinders=[mark])
        yield t_s, "/scene", SceneUpdate(entities=[entity])


def _frames(reports: list[Report]) -> Iterator[Entry]:
    for report in reports:
        name = f"robot-{report.robot + 1}"
        for t_s, true, estimate, _ in report.trace:
            frames = [_frame(t_s, name, true), _frame(t_s, f"{name}-believes", estimate)]
            yield t_s, "/tf", FrameTransforms(transforms=frames)


def _log(reports: list[Report]) -> Iterator[Entry]:
    for report in reports:
        said = [(t_s, Log.INFO, f"decoded node {node}") for t_s, node in report.decoded]
        said += [(t_s, Log.WARNING, f"not validated: {reason}") for t_s, reason in report.not_validated]
        said += [(t_s, Log.INFO, f"did {action}") for t_s, action in report.actions]
        said.append((report.t_s, Log.INFO if report.done else Log.ERROR, "done" if report.done else "not completed"))
        for t_s, level, message in said:
            log = Log(timestamp=_time(t_s), level=level, name=f"robot-{report.robot + 1}", message=message)
            yield t_s, "/log", log


def _frame(t_s: float, name: str, pose: Pose) -> FrameTransform:
    x_m, y_m, heading_rad = pose
    return FrameTransform(
        timestamp=_time(t_s),
        parent_frame_id=WORLD,
        child_frame_id=name,
        translation=Vector3(x=x_m, y=y_m),
        rotation=Quaternion(z=math.sin(heading_rad / 2), w=math.cos(heading_rad / 2)),
    )


def _time(t_s: float) -> Timestamp:
    t_ns = round(t_s * NS)
    return Timestamp(seconds=t_ns // NS, nanos=t_ns % NS)


def _place(x_m: float, y_m: float) -> Place:
    return Place(position=Vector3(x=x_m, y=y_m), orientation=Quaternion(w=1.0))
