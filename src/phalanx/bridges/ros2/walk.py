"""Run a mission on a ROS 2 robot: receives scans and odometry, publishes cmd_vel and the believed pose.

It has the encoded file, its start key and the start pose, but no map. The time is that of the scans' stamps, so that
faster simulators and recordings work. Names are nav2's, frames those of REP 105.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from phalanx.config.lidar import ExtractionConfig
from phalanx.config.mission import MissionConfig
from phalanx.errors import Unavailable, UsageError
from phalanx.mission import EncodedMission, Phase, StartKey, Walker
from phalanx.mission.file.canonical import parse_action
from phalanx.robot.controllers.mission.controller import Assignment, MissionController, Missions
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.robot.controllers.python_controller import Act
from phalanx.wire.table import ACTION, DRIVE, KIND_DRIVE

from .geometry import Place, place_of
from .graph import RELIABLE, SENSOR, TRAIL, Graph
from .sweep import Beams, Track, beams_of

log = logging.getLogger(__name__)

NAME = "phalanx_mission"
DEFAULTS = {
    "cmd_vel_topic": "cmd_vel",
    "enable_stamped_cmd_vel": False,
    "odom_topic": "odom",
    "scan_topic": "scan",
    "pose_topic": "amcl_pose",
    "action_topic": "mission_action",
    "map_frame_id": "map",
    "odom_frame_id": "odom",
    "base_frame_id": "base_link",
    "laser_in_base": [0.0, 0.0, 0.0],
    "range_noise": 0.01,
    "source_timeout": 0.5,
}
STEP_S = 0.09  # least time between two processed scans: the pilot assumes 0.1 s
BACK_S = 1.0  # a clock that goes back by more was restarted
WAIT_S, PATIENCE_S = 0.1, 5.0
MILLI = 1000
NS = 1e-9
# Indices of x, y and yaw in a 6 x 6 covariance. Source: geometry_msgs/PoseWithCovariance.
X, Y, YAW = 0, 7, 35


@dataclass(frozen=True, slots=True, kw_only=True)
class Errand:
    """A mission, its start key and the start of one robot."""

    mission: EncodedMission
    key: StartKey | None
    robot: int
    start: Place  # of base_link, in the map
    begin_s: float  # mission clock at the start
    extraction: ExtractionConfig


@dataclass(slots=True)
class Lived:
    """Progress and result of a mission."""

    done: bool = False
    t_s: float = 0.0
    decoded: list[tuple[float, int, str]] = field(default_factory=list)  # time, node, name
    not_validated: list[tuple[float, str]] = field(default_factory=list)
    actions: list[tuple[float, str]] = field(default_factory=list)
    pose: Place | None = None  # believed pose of base_link in the map


class RosWalk:
    """Runs a robot's mission until `close`; reports events with their time, s, to `on_event`. Raises: UsageError."""

    def __init__(
        self, errand: Errand, namespace: str, arguments: Sequence[str], on_event: Callable[[float, str], None]
    ) -> None:
        self._errand, self.lived, self._on_event = errand, Lived(), on_event
        self._graph = Graph(NAME, namespace, arguments, DEFAULTS)
        said = self._said = self._graph.said
        try:
            self._graph.check("source_timeout")
            self._mounted = self._graph.place("laser_in_base")
            kind = TwistStamped if said["enable_stamped_cmd_vel"] else Twist
            self._out = self._graph.publisher(kind, said["cmd_vel_topic"], RELIABLE)
            self._pose = self._graph.publisher(PoseWithCovarianceStamped, said["pose_topic"], RELIABLE)
            self._does = self._graph.publisher(String, said["action_topic"], RELIABLE)
            self._scans = self._graph.inbox(LaserScan, said["scan_topic"], SENSOR)
            self._odometries = self._graph.inbox(Odometry, said["odom_topic"], TRAIL)
        except UsageError:
            self._graph.close()
            raise
        self._beams: Beams | None = None
        self._track: Track | None = None
        self._controller: MissionController | None = None
        self._sensors = Sensors()
        self._first_s = self._last_s = -math.inf
        self._strange = ""
        self._steps = 0

    async def live(self) -> None:
        """Run the mission to its end. Raises: UsageError: the lidar does not fit; Unavailable: stamps went back."""
        heard_s, said = time.monotonic(), False
        while not (self._controller and self._controller.over):
            await asyncio.to_thread(self._graph.wait, self._scans, WAIT_S)
            scan = self._scans.take()
            if scan is not None and self._step(scan):
                heard_s, said = time.monotonic(), False
                continue
            silent_s = time.monotonic() - heard_s
            if silent_s > self._said["source_timeout"]:
                self._graph.move(self._out, 0.0, 0.0)
            if silent_s > PATIENCE_S and not said:
                said = True
                missing = self._odometries if self._track is None and self._beams else self._scans
                log.warning("the robot is waiting: %s", self._strange or f"no messages on {missing.topic}")

    def _step(self, scan: Any) -> bool:
        """Process a scan; return whether it was used."""
        t_s = _seconds(scan.header.stamp)
        if t_s < self._last_s - BACK_S:
            raise Unavailable("time stamps of scans went back", "start the mission again")
        if t_s < self._last_s + STEP_S:
            self._strange = f"time stamps on {self._scans.topic} do not advance" if t_s == self._last_s else ""
            return False
        if self._beams is None:
            limits = scan.range_min, scan.range_max
            self._beams = beams_of(
                len(scan.ranges), scan.angle_min, scan.angle_increment, limits, self._said["range_noise"], self._mounted
            )
        self._hear(self._beams, t_s)
        if self._track and t_s > self._track.newest_s + self._said["source_timeout"]:
            self._strange = f"no new messages on {self._odometries.topic}"
            return False
        place = self._track.at(t_s) if self._track else None
        if place is None or self._track is None:
            return False
        if self._controller is None:
            self._controller = self._begin(self._beams)
            self._first_s = t_s
        self._last_s, self._strange = t_s, ""
        t_ms = 1 + round((t_s - self._first_s) * MILLI)
        raw = self._sensors.raw_of(self._beams.scan_of(scan.ranges))
        pose = place.x_m, place.y_m, place.yaw_rad
        reading = self._sensors.make(self._errand.robot, t_ms, pose, self._track.travelled_m, raw)
        self._obey(self._controller, t_ms, reading, raw)
        self._tell_pose(scan.header.stamp, self._controller, self._beams)
        return True

    def _begin(self, beams: Beams) -> MissionController:
        errand = self._errand
        eye = errand.start.of(beams.eye)
        given = Assignment(errand.mission, (eye.x_m, eye.y_m, eye.yaw_rad), begin_s=errand.begin_s)
        self._sensors = Sensors(beams.lidar, errand.extraction)
        config = MissionConfig().seen_by(beams.lidar)
        missions = Missions({errand.robot: given}, self._sensors, config, audited=False)
        return MissionController(errand.robot, missions, Walker(errand.mission, errand.key, config))

    def _hear(self, beams: Beams, scanned_s: float) -> None:
        """Process the odometry that came since the last scan."""
        said = self._said
        for message in self._odometries.take_all():
            frames = message.header.frame_id, message.child_frame_id
            if frames[0] != said["odom_frame_id"] or frames[1] not in (said["base_frame_id"], ""):
                self._strange = f"odometry of {frames[1]} in {frames[0]} does not match odom_frame_id and base_frame_id"
                continue
            base = place_of(message.pose.pose)
            if not all(map(math.isfinite, (base.x_m, base.y_m, base.yaw_rad))):
                self._strange = "odometry has numbers that are not finite"
                continue
            if self._track is None:
                self._track = Track(beams.eye)
            t_s = _seconds(message.header.stamp)
            if not self._track.add(t_s, base, scanned_s + said["source_timeout"]):
                self._strange = f"odometry is dated {t_s - scanned_s:.1f} s ahead of scans"

    def _obey(self, controller: MissionController, t_ms: int, reading: bytes, raw: bytes) -> None:
        self._steps += 1
        controller.keep(self._steps, t_ms, reading, raw)
        for output in controller.on_evidence(self._steps, t_ms, reading, b""):
            if isinstance(output, Act) and output.payload[0] == KIND_DRIVE:
                *_, speed, turn = DRIVE.form.unpack(output.payload)
                self._graph.move(self._out, speed / MILLI, turn / MILLI)
            elif isinstance(output, Act):
                action = parse_action(output.payload[ACTION.size :])
                self._does.publish(String(data=action.name))
                self.lived.actions.append((t_ms / MILLI, action.name))
                self._on_event(t_ms / MILLI, f"does {action.name}")
        self._note(controller, t_ms / MILLI)

    def _note(self, controller: MissionController, t_s: float) -> None:
        lived, outcome, phase = self.lived, controller.outcome, controller.memory.walk.phase
        lived.t_s, lived.done = t_s, phase is Phase.DONE
        if outcome is None:
            return
        if outcome.decoded and all(node != outcome.decoded.node for _, node, _ in lived.decoded):
            lived.decoded.append((t_s, outcome.decoded.node, outcome.decoded.name))
            self._on_event(t_s, f"decoded {outcome.decoded.name}")
        if outcome.event is not None and not outcome.decoded:
            lived.not_validated.append((t_s, outcome.event.value))
            self._on_event(t_s, f"did not find the next landmark: {outcome.event.value}")

    def _tell_pose(self, stamp: Any, controller: MissionController, beams: Beams) -> None:
        x_m, y_m, yaw_rad = controller.memory.belief.pose
        base = Place(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad).of(beams.eye.sees(Place()))
        self.lived.pose = base
        told = PoseWithCovarianceStamped()
        told.header.stamp, told.header.frame_id = stamp, self._said["map_frame_id"]
        told.pose.pose.position.x, told.pose.pose.position.y = base.x_m, base.y_m
        told.pose.pose.orientation.z = math.sin(base.yaw_rad / 2)
        told.pose.pose.orientation.w = math.cos(base.yaw_rad / 2)
        spread = controller.memory.belief.pose_covariance
        for where, share in ((X, spread[0]), (Y, spread[3]), (YAW, spread[-1])):
            told.pose.covariance[where] = share
        self._pose.publish(told)

    def close(self) -> None:
        """Publish a stop and destroy the node."""
        self._graph.move(self._out, 0.0, 0.0)
        self._graph.close()


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * NS)
