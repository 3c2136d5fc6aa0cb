"""A run as MCAP, which opens in Foxglove: where everybody is, every verdict, every shield.

    /scene    foxglove.SceneUpdate      goal and obstacles, and each robot in the colour of what it is
    /tf       foxglove.FrameTransforms  world → robot-1 …, x forward
    /log      foxglove.Log              verdicts of audits, and who went into Safe Mode
    /shields  JSON                      of each robot, the tokens that keep it alive

Times are the run's own, from 0: the same scenario and seed give the same bytes. Written while the run goes on; a file
that was cut short is read up to there.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from phalanx import __version__
from phalanx.bti.refusal import Refusal
from phalanx.config.flock import Disc
from phalanx.errors import Unavailable, UsageError

from .run import Run
from .scenario import Scenario

NS = 1_000_000_000
WORLD = "world"
# Okabe and Ito's: told apart by every kind of eye. Honest, compromised, stopped, the goal, an obstacle.
HONEST, LIAR, STOPPED, GOAL, WALL = (
    Color(r=red / 255, g=green / 255, b=blue / 255, a=alpha)
    for red, green, blue, alpha in (
        (0, 114, 178, 1.0),
        (213, 94, 0, 1.0),
        (130, 130, 130, 1.0),
        (0, 158, 115, 0.6),
        (90, 90, 90, 0.8),
    )
)
SHIELDS_SCHEMA = {
    "title": "phalanx.Shields",
    "type": "object",
    "properties": {
        "t_s": {"type": "number"},
        "robots": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "id": {"type": "integer"},
                    "safe_mode": {"type": "boolean"},
                    "tokens": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "properties": {"auditor": {"type": "integer"}, "left_s": {"type": "number"}},
                        },
                    },
                },
            },
        },
    },
}


class Recording:
    """An MCAP file that grows. Use as `with`; at its end, however that comes, the file gets its index.

    Raises: on entering, UsageError: no such folder. Unavailable: it cannot be written, then or later.
    Source: mcap.dev; Foxglove's schemas.
    """

    def __init__(self, path: Path, scenario: Scenario) -> None:
        self._path = path
        self._scenario = scenario
        self._file: IO[bytes] | None = None
        self._stopped: set[int] = set()
        self._heading_rad = np.zeros(scenario.robots)

    def __enter__(self) -> Self:
        if not self._path.absolute().parent.is_dir():
            raise UsageError(f"no folder {self._path.parent}", "make it first")
        try:
            self._file = self._path.open("wb")
            self._writer: Any = Writer(self._file)
            self._writer.start(profile="", library=f"phalanx {__version__}")
            self._channels = {
                topic: self._protobuf_channel(topic, kind)
                for topic, kind in (("/scene", SceneUpdate), ("/tf", FrameTransforms), ("/log", Log))
            }
            schema = self._writer.register_schema(
                str(SHIELDS_SCHEMA["title"]), "jsonschema", json.dumps(SHIELDS_SCHEMA).encode()
            )
            self._channels["/shields"] = self._writer.register_channel("/shields", "json", schema)
            scenario = self._scenario
            words = {"name": scenario.name, "seed": scenario.seed, "defence": scenario.defence}
            self._writer.add_metadata("scenario", {key: str(value) for key, value in words.items()})
            self._put("/scene", 0, self._ground())
        except OSError as error:
            raise self._unwritable(error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._file
        try:
            with self._file:
                self._writer.finish()
        except OSError as failure:
            if error is None:
                raise self._unwritable(failure) from failure

    def write(self, run: Run, verdicts: list[tuple[float, int, int, Refusal]]) -> None:
        """The run as it is now, and the verdicts since the last time.

        Raises: Unavailable: the disk is full.
        """
        now_ns = round(run.now_s * NS)
        safe = run.in_safe_mode
        shields = run.shields()
        try:
            for t_s, auditor, auditee, refusal in verdicts:
                said = f"refuses a token to robot {auditee}: {_words(refusal)}"
                if refusal == Refusal.NONE:
                    said = f"gives a token to robot {auditee}"
                level = Log.DEBUG if refusal == Refusal.NONE else Log.WARNING
                self._log(round(t_s * NS), level, f"robot-{auditor}", said)
            for rob_id in run.ids[safe].tolist():
                if rob_id not in self._stopped:
                    self._stopped.add(rob_id)
                    self._log(now_ns, Log.ERROR, f"robot-{rob_id}", "in Safe Mode")
            self._put("/scene", now_ns, self._robots(run, shields, now_ns))
            self._put("/tf", now_ns, self._frames(run, now_ns))
            self._put("/shields", now_ns, _shields(run, shields))
        except OSError as error:
            raise self._unwritable(error) from error

    def _ground(self) -> SceneUpdate:
        scenario = self._scenario
        entity = SceneEntity(timestamp=_time(0), frame_id=WORLD, id="ground")
        size_m = scenario.d_m / 4
        entity.cylinders.append(_cylinder(*scenario.goal_m, size_m, size_m / 10, GOAL))
        for obstacle in scenario.obstacles:
            if isinstance(obstacle, Disc):
                entity.cylinders.append(_cylinder(obstacle.x_m, obstacle.y_m, 2 * obstacle.radius_m, size_m, WALL))
            else:
                width_m, height_m = obstacle.right_m - obstacle.left_m, obstacle.top_m - obstacle.bottom_m
                pose = _pose(obstacle.left_m + width_m / 2, obstacle.bottom_m + height_m / 2)
                entity.cubes.append(CubePrimitive(pose=pose, size=Vector3(x=width_m, y=height_m, z=size_m), color=WALL))
        return SceneUpdate(entities=[entity])

    def _robots(self, run: Run, shields: list[list[tuple[int, float]]], now_ns: int) -> SceneUpdate:
        compromised, safe = run.compromised, run.in_safe_mode
        size_m = max(self._scenario.contact_m, self._scenario.d_m / 5)
        update = SceneUpdate()
        for i, (rob_id, (x_m, y_m)) in enumerate(zip(run.ids.tolist(), run.positions_m.tolist(), strict=True)):
            colour = STOPPED if safe[i] else LIAR if rob_id in compromised else HONEST
            tokens = ", ".join(f"{auditor} ({left_s:.1f} s)" for auditor, left_s in shields[i])
            said = {"attack": compromised.get(rob_id, ""), "safe mode": "yes" if safe[i] else "no", "tokens": tokens}
            update.entities.append(
                SceneEntity(
                    timestamp=_time(now_ns),
                    frame_id=WORLD,
                    id=f"robot-{rob_id}",
                    metadata=[KeyValuePair(key=key, value=value) for key, value in said.items()],
                    cylinders=[_cylinder(x_m, y_m, size_m, size_m / 2, colour)],
                    texts=[
                        TextPrimitive(
                            pose=_pose(x_m, y_m, size_m),
                            billboard=True,
                            font_size=size_m,
                            color=colour,
                            text=str(rob_id),
                        )
                    ],
                )
            )
        return update

    def _frames(self, run: Run, now_ns: int) -> FrameTransforms:
        transforms = []
        for i, (rob_id, (x_m, y_m), (vx_mps, vy_mps)) in enumerate(
            zip(run.ids.tolist(), run.positions_m.tolist(), run.velocities_mps.tolist(), strict=True)
        ):
            if vx_mps or vy_mps:  # who stands looks where it last went
                self._heading_rad[i] = math.atan2(vy_mps, vx_mps)
            half_rad = self._heading_rad[i] / 2
            transforms.append(
                FrameTransform(
                    timestamp=_time(now_ns),
                    parent_frame_id=WORLD,
                    child_frame_id=f"robot-{rob_id}",
                    translation=Vector3(x=x_m, y=y_m),
                    rotation=Quaternion(z=math.sin(half_rad), w=math.cos(half_rad)),
                )
            )
        return FrameTransforms(transforms=transforms)

    def _log(self, t_ns: int, level: Log.Level.ValueType, name: str, message: str) -> None:
        self._put("/log", t_ns, Log(timestamp=_time(t_ns), level=level, name=name, message=message))

    def _put(self, topic: str, t_ns: int, message: Any) -> None:
        data = json.dumps(message).encode() if isinstance(message, dict) else message.SerializeToString()
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns)

    def _protobuf_channel(self, topic: str, kind: Any) -> int:
        schema = self._writer.register_schema(
            kind.DESCRIPTOR.full_name, "protobuf", build_file_descriptor_set(kind).SerializeToString()
        )
        return int(self._writer.register_channel(topic, "protobuf", schema))

    def _unwritable(self, error: OSError) -> Unavailable:
        return Unavailable(f"cannot write {self._path}: {error.strerror}", "another place for --record")


def _shields(run: Run, shields: list[list[tuple[int, float]]]) -> dict[str, Any]:
    return {
        "t_s": run.now_s,
        "robots": [
            {
                "id": rob_id,
                "safe_mode": stopped,
                "tokens": [{"auditor": auditor, "left_s": round(left_s, 3)} for auditor, left_s in shield],
            }
            for rob_id, stopped, shield in zip(run.ids.tolist(), run.in_safe_mode.tolist(), shields, strict=True)
        ],
    }


def _words(refusal: Refusal) -> str:
    return refusal.name.lower().replace("_", " ")


def _time(t_ns: int) -> Timestamp:
    return Timestamp(seconds=t_ns // NS, nanos=t_ns % NS)


def _pose(x_m: float, y_m: float, z_m: float = 0.0) -> Pose:
    return Pose(position=Vector3(x=x_m, y=y_m, z=z_m), orientation=Quaternion(w=1.0))


def _cylinder(x_m: float, y_m: float, across_m: float, height_m: float, colour: Color) -> CylinderPrimitive:
    size = Vector3(x=across_m, y=across_m, z=height_m)
    return CylinderPrimitive(pose=_pose(x_m, y_m), size=size, bottom_scale=1.0, top_scale=1.0, color=colour)
