"""Record a run as MCAP for Foxglove: positions, verdicts of audits, and tokens of each robot.

/scene    foxglove.SceneUpdate      goal and obstacles, and each robot in the colour of its state
/tf       foxglove.FrameTransforms  world → robot-1 …, x forward
/log      foxglove.Log              verdicts of audits, and robots entering Safe Mode
/shields  JSON                      for each robot, the valid tokens that it holds
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from phalanx.bti.refusal import Refusal
from phalanx.config.flock import Disc
from phalanx.recording.recorder import NS, WORLD, Recorder, cylinder, frame, pose_at, time_of
from phalanx.scenarios.scenario import Scenario

from .run import Run

# Okabe and Ito's palette, for colour-blind readers: honest, compromised, stopped, goal, obstacle.
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


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _array(items: Any) -> dict[str, Any]:
    return {"type": "array", "items": items}


_INTEGER, _NUMBER, _BOOLEAN = ({"type": name} for name in ("integer", "number", "boolean"))
_TOKENS = _array(_object(auditor=_INTEGER, left_s=_NUMBER))
SHIELDS_SCHEMA = {
    "title": "phalanx.Shields",
    **_object(t_s=_NUMBER, robots=_array(_object(id=_INTEGER, safe_mode=_BOOLEAN, tokens=_TOKENS))),
}


class Recording(Recorder):
    """Recording of a scenario's run, written during the run."""

    def __init__(self, path: Path, scenario: Scenario) -> None:
        super().__init__(path)
        self._scenario = scenario
        self._stopped: set[int] = set()
        self._heading_rad = np.zeros(scenario.robots)

    def _begin(self) -> None:
        schema = json.dumps(SHIELDS_SCHEMA).encode()
        self._channel("/shields", "json", str(SHIELDS_SCHEMA["title"]), "jsonschema", schema)
        self._writer.add_metadata("scenario", self.about())
        self.put("/scene", 0, self._ground())

    def about(self) -> dict[str, str]:
        """Return the metadata of the whole run."""
        scenario, bti = self._scenario, self._scenario.bti
        metadata = {"name": scenario.name, "seed": scenario.seed, "defence": scenario.defence}
        metadata |= {"duration_s": scenario.duration_s, "tokens_needed": bti.tokens_needed, "t_val_ms": bti.t_val_ms}
        return {key: str(value) for key, value in metadata.items()}

    def write(self, run: Run, verdicts: list[tuple[float, int, int, Refusal]]) -> None:
        """Write the run's current state, and verdicts since the last call. Raises: Unavailable: the disk is full."""
        now_ns = round(run.now_s * NS)
        safe = run.in_safe_mode
        shields = run.shields()
        for t_s, auditor, auditee, refusal in verdicts:
            message = f"refuses a token to robot {auditee}: {refusal.name.lower().replace('_', ' ')}"
            if refusal == Refusal.NONE:
                message = f"gives a token to robot {auditee}"
            level = Log.DEBUG if refusal == Refusal.NONE else Log.WARNING
            self.log(round(t_s * NS), level, f"robot-{auditor}", message)
        for rob_id in run.ids[safe].tolist():
            if rob_id not in self._stopped:
                self._stopped.add(rob_id)
                self.log(now_ns, Log.ERROR, f"robot-{rob_id}", "in Safe Mode")
        self.put("/scene", now_ns, self._robots(run, shields, now_ns))
        self.put("/tf", now_ns, self._frames(run, now_ns))
        robots = [
            {
                "id": rob_id,
                "safe_mode": stopped,
                "tokens": [{"auditor": auditor, "left_s": round(left_s, 3)} for auditor, left_s in shield],
            }
            for rob_id, stopped, shield in zip(run.ids.tolist(), safe.tolist(), shields, strict=True)
        ]
        self.put("/shields", now_ns, {"t_s": run.now_s, "robots": robots})

    def _ground(self) -> SceneUpdate:
        scenario = self._scenario
        entity = SceneEntity(timestamp=time_of(0), frame_id=WORLD, id="ground")
        size_m = scenario.d_m / 4
        entity.cylinders.append(cylinder(*scenario.goal_m, size_m, size_m / 10, GOAL))
        for obstacle in scenario.obstacles:
            if isinstance(obstacle, Disc):
                entity.cylinders.append(cylinder(obstacle.x_m, obstacle.y_m, 2 * obstacle.radius_m, size_m, WALL))
            else:
                width_m, height_m = obstacle.right_m - obstacle.left_m, obstacle.top_m - obstacle.bottom_m
                pose = pose_at(obstacle.left_m + width_m / 2, obstacle.bottom_m + height_m / 2)
                entity.cubes.append(CubePrimitive(pose=pose, size=Vector3(x=width_m, y=height_m, z=size_m), color=WALL))
        return SceneUpdate(entities=[entity])

    def _robots(self, run: Run, shields: list[list[tuple[int, float]]], now_ns: int) -> SceneUpdate:
        compromised, safe = run.compromised, run.in_safe_mode
        size_m = max(self._scenario.contact_m, self._scenario.d_m / 5)
        update = SceneUpdate()
        for i, (rob_id, (x_m, y_m)) in enumerate(zip(run.ids.tolist(), run.positions_m.tolist(), strict=True)):
            colour = STOPPED if safe[i] else LIAR if rob_id in compromised else HONEST
            tokens = ", ".join(f"{auditor} ({left_s:.1f} s)" for auditor, left_s in shields[i])
            details = {"attack": compromised.get(rob_id, ""), "safe mode": "yes" if safe[i] else "no", "tokens": tokens}
            update.entities.append(
                SceneEntity(
                    timestamp=time_of(now_ns),
                    frame_id=WORLD,
                    id=f"robot-{rob_id}",
                    metadata=[KeyValuePair(key=key, value=value) for key, value in details.items()],
                    cylinders=[cylinder(x_m, y_m, size_m, size_m / 2, colour)],
                    texts=[
                        TextPrimitive(
                            pose=pose_at(x_m, y_m, size_m),
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
            if vx_mps or vy_mps:  # a standing robot keeps its last heading
                self._heading_rad[i] = math.atan2(vy_mps, vx_mps)
            transforms.append(frame(now_ns, f"robot-{rob_id}", x_m, y_m, self._heading_rad[i]))
        return FrameTransforms(transforms=transforms)
