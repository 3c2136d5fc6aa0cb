"""Record a run in an MCAP file for Foxglove: scene, coordinate frames and log.

Times are those of the run, from 0, so the same run gives the same bytes. Source: mcap.dev; Foxglove's schemas.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import IO, Any, Self

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from phalanx import __version__
from phalanx.errors import Unavailable, UsageError

NS = 1_000_000_000
WORLD = "world"
TOPICS: dict[str, Any] = {"/scene": SceneUpdate, "/tf": FrameTransforms, "/log": Log}


class Recorder:
    """Context manager that writes an MCAP file.

    Raises: UsageError: the folder does not exist. Unavailable: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[bytes] | None = None
        self._channels: dict[str, int] = {}

    def __enter__(self) -> Self:
        if not self._path.absolute().parent.is_dir():
            raise UsageError(f"no folder {self._path.parent}", "make it first")
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC  # follow no symbolic link
            self._file = os.fdopen(os.open(self._path, flags, 0o666), "wb")
            self._writer: Any = Writer(self._file)
            self._writer.start(profile="", library=f"phalanx {__version__}")
            for topic, kind in TOPICS.items():
                descriptors = build_file_descriptor_set(kind).SerializeToString()
                self._channel(topic, "protobuf", kind.DESCRIPTOR.full_name, "protobuf", descriptors)
            self._begin()
        except OSError as error:
            raise self._unwritable(error) from error
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        assert self._file
        try:
            with self._file:
                self._writer.finish()
        except OSError as failure:
            if error is None:
                raise self._unwritable(failure) from failure

    def _begin(self) -> None:
        """Write the first messages of the file; subclasses override this."""

    def _channel(self, topic: str, encoding: str, name: str, language: str, schema: bytes) -> None:
        number = self._writer.register_schema(name, language, schema)
        self._channels[topic] = int(self._writer.register_channel(topic, encoding, number))

    def put(self, topic: str, t_ns: int, message: Any) -> None:
        """Write a message of the topic's schema; a dict is written as JSON. Raises: Unavailable: writing failed."""
        data = json.dumps(message).encode() if isinstance(message, dict) else message.SerializeToString()
        try:
            self._writer.add_message(self._channels[topic], t_ns, data, t_ns)
        except OSError as error:
            raise self._unwritable(error) from error

    def log(self, t_ns: int, level: Log.Level.ValueType, name: str, message: str) -> None:
        """Write a line of the log."""
        self.put("/log", t_ns, Log(timestamp=time_of(t_ns), level=level, name=name, message=message))

    def _unwritable(self, error: OSError) -> Unavailable:
        return Unavailable(f"cannot write {self._path}: {error.strerror}", "choose another path for --record")


def time_of(t_ns: int) -> Timestamp:
    """Return a time of the run as a protobuf timestamp."""
    return Timestamp(seconds=t_ns // NS, nanos=t_ns % NS)


def pose_at(x_m: float, y_m: float, z_m: float = 0.0) -> Pose:
    """Return a pose with this position and no rotation."""
    return Pose(position=Vector3(x=x_m, y=y_m, z=z_m), orientation=Quaternion(w=1.0))


def cylinder(x_m: float, y_m: float, across_m: float, height_m: float, colour: Color) -> CylinderPrimitive:
    """Return an upright cylinder that stands on the ground."""
    size = Vector3(x=across_m, y=across_m, z=height_m)
    return CylinderPrimitive(pose=pose_at(x_m, y_m), size=size, bottom_scale=1.0, top_scale=1.0, color=colour)


def frame(t_ns: int, name: str, x_m: float, y_m: float, heading_rad: float) -> FrameTransform:
    """Return the transform of a robot's frame, x forward, in the world frame."""
    return FrameTransform(
        timestamp=time_of(t_ns),
        parent_frame_id=WORLD,
        child_frame_id=name,
        translation=Vector3(x=x_m, y=y_m),
        rotation=Quaternion(z=math.sin(heading_rad / 2), w=math.cos(heading_rad / 2)),
    )
