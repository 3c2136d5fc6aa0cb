"""The ROS 2 node of a robot's daemon: receives odometry and advice, and publishes commands that the a-node allowed.

Topics, parameters and QoS are named as in nav2's collision_monitor and velocity_smoother. A separate thread waits for
advice and publishes the commands; the daemon polls what has come, and never blocks.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_system_default

from phalanx.daemon.driver import AdvisedHardware, NoReading
from phalanx.daemon.driver_thread import HUNG_S
from phalanx.errors import PeerError, UsageError
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.planner import Planner
from phalanx.scenarios.scenario import GUARD, Scenario

from .diagnostics import told_of
from .geometry import Pair, Place, place_of, point_of, twist_of, velocity_of
from .graph import RELIABLE, SENSOR, Graph

log = logging.getLogger(__name__)

NAME = "phalanx_guard"
DEFAULTS = {
    "cmd_vel_in_topic": "cmd_vel_raw",
    "cmd_vel_out_topic": "cmd_vel",
    "odom_topic": "odom",
    "map_frame_id": "map",
    "odom_frame_id": "odom",
    "base_frame_id": "base_link",
    "odom_in_map": [0.0, 0.0, 0.0],
    "ahead_m": 0.2,
    "smoothing_frequency": 20.0,
    "source_timeout": 0.5,
    "enable_stamped_cmd_vel": False,
}
PATIENCE_S = 5.0
PACE_S = 0.005
FARTHEST_M = 1e6  # period of a guard's readings


class RosBase(AdvisedHardware):
    """Hardware of a base and a planner on ROS 2 topics. Raises: UsageError: bad arguments, or no advised controller."""

    def __init__(
        self, rob_id: int, scenario: Scenario, declared: Declaration, namespace: str, arguments: Sequence[str]
    ) -> None:
        if scenario.controller != GUARD:
            raise UsageError(
                f"the mission's controller is {scenario.controller}", "use controller: guard, which takes advice"
            )
        self._id, self._reads, self._commands = rob_id, declared.reads, declared.commands
        self._held_s = (scenario.bti.t_control_ms + 3 * scenario.bti.delta_ms) / 1000
        self._graph = Graph(NAME, namespace, arguments, DEFAULTS)
        said = self._said = self._graph.said
        try:
            self._graph.check("ahead_m", "smoothing_frequency", "source_timeout")
            self._odom_in_map = self._graph.place("odom_in_map")
            kind = TwistStamped if said["enable_stamped_cmd_vel"] else Twist
            self._out = self._graph.publisher(kind, said["cmd_vel_out_topic"], RELIABLE)
            self._diagnostics = self._graph.publisher(DiagnosticArray, "/diagnostics", qos_profile_system_default)
            self._wishes = self._graph.inbox(kind, said["cmd_vel_in_topic"], RELIABLE)
            self._odometries = self._graph.inbox(Odometry, said["odom_topic"], SENSOR)
        except UsageError:
            self._graph.close()
            raise
        self._odometry: tuple[float, Place, Pair] | None = None  # arrival time, pose, point velocity
        self._wish: Pair | None = None  # speed and turn rate, not taken yet
        self._told: tuple[float, Pair, Pair] | None = None  # begin, velocity at that time, acceleration
        self._sensed_mps: Pair = (0.0, 0.0)
        self._alive_s = time.monotonic()
        self._strange: str = ""
        self._wake: Callable[[], object] = bool  # no callback yet
        self._speaks = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    # --- the thread ---------------------------------------------------------------------------------------------------

    def _live(self) -> None:
        period_s, move_s = 1.0 / self._said["smoothing_frequency"], time.monotonic()
        while not self._over.is_set():
            self._graph.wait(self._wishes, min(move_s - time.monotonic(), PATIENCE_S))
            if (wish := self._wishes.take()) is not None:
                self._on_wish(wish)
                self._over.wait(PACE_S)  # limits the load of a flood
            if (now_s := time.monotonic()) >= move_s:
                move_s = max(move_s + period_s, now_s)
                self._hear()
                if self._speaks:
                    self._move()

    def _on_wish(self, message: Any) -> None:
        twist = message.twist if self._said["enable_stamped_cmd_vel"] else message
        taken, self._wish = self._wish is None, (twist.linear.x, twist.angular.z)
        if taken:
            self._wake()

    def _hear(self) -> None:
        if (message := self._odometries.take()) is None:
            return
        said, frame, child = self._said, message.header.frame_id, message.child_frame_id
        if frame not in (said["map_frame_id"], said["odom_frame_id"]) or child not in (said["base_frame_id"], ""):
            self._strange = f"it is of {child} in {frame}, not {said['base_frame_id']} in {said['odom_frame_id']}"
            return
        there, twist = place_of(message.pose.pose), message.twist.twist
        base = there if frame == said["map_frame_id"] else self._odom_in_map.of(there)
        moves = velocity_of(twist.linear.x, twist.angular.z, base.yaw_rad, said["ahead_m"])
        if all(abs(number) <= FARTHEST_M for number in (base.x_m, base.y_m, base.yaw_rad, *moves)):  # NaN is not
            self._odometry = time.monotonic(), base, moves
        else:
            self._strange = "it makes no sense"

    def _move(self) -> None:
        """Publish the last command while it is valid and the daemon responds; otherwise publish a stop."""
        told, known = self._told, self._known()
        linear = angular = 0.0
        if told and known and time.monotonic() - self._alive_s <= HUNG_S:
            since_s, from_mps, accel = time.monotonic() - told[0], told[1], told[2]
            if since_s <= self._held_s:
                velocity = from_mps[0] + accel[0] * since_s, from_mps[1] + accel[1] * since_s
                linear, angular = twist_of(velocity, known[0].yaw_rad, self._said["ahead_m"])
        self._graph.move(self._out, linear, angular)

    def _known(self) -> tuple[Place, Pair] | None:
        """Return pose and point velocity of the base; None if the last odometry is too old."""
        odometry = self._odometry
        if odometry is None or time.monotonic() - odometry[0] > self._said["source_timeout"]:
            return None
        return odometry[1], odometry[2]

    # --- calls of the daemon -----------------------------------------------------------------------------------------

    async def ready(self) -> None:
        """Begin to publish commands, at first a stop, and wait for odometry."""
        self._speaks = True
        tell_s = time.monotonic() + PATIENCE_S
        while self._known() is None:
            if time.monotonic() > tell_s:
                log.warning("robot %d is waiting: %s", self._id, self._no_odometry())
                tell_s = math.inf
            await asyncio.sleep(0.05)

    def _no_odometry(self) -> NoReading:
        strange = f": {self._strange}" if self._strange else ""
        return NoReading(f"no odometry on {self._odometries.topic}{strange}", "phalanx docs guides/ros2")

    async def sense(self, now_ms: int, within_s: float) -> bytes:  # noqa: ARG002 - it waits for nothing
        """See `Hardware`: motion of the control point in the map. Raises: NoReading: no recent odometry."""
        self._hear()
        known = self._known()
        if known is None:
            raise self._no_odometry()
        base, self._sensed_mps = known
        x_m, y_m = point_of(base, self._said["ahead_m"])
        vx_mps, vy_mps = self._sensed_mps
        return self._reads.encode(id=self._id, t=now_ms, x_m=x_m, y_m=y_m, vx_mps=vx_mps, vy_mps=vy_mps)

    def drive(self, command: bytes) -> None:
        """See `Hardware`."""
        try:
            said = self._commands.decode(command)
        except PeerError:  # commands for other bodies
            self._told = None
        else:
            self._told = time.monotonic(), self._sensed_mps, (said["ax_mps2"], said["ay_mps2"])

    def stop(self) -> None:
        """See `Hardware`."""
        self._told = None

    def alive(self) -> None:
        """See `Hardware`."""
        self._alive_s = time.monotonic()

    def planner(self, rob_id: int, goal_m: Pair) -> Planner:
        """Return the name of the planner: the publisher of `cmd_vel_in_topic`."""
        return _Advised(rob_id, goal_m, self)

    def on_advice(self, wake: Callable[[], object]) -> None:
        """Call `wake` from now on, from any thread, when new advice has come."""
        self._wake = wake

    def wish(self) -> Pair | None:
        """Return the control point's advised velocity, m/s in the map; None without new advice."""
        wish, known = self._wish, self._known()
        self._wish = None
        return velocity_of(*wish, known[0].yaw_rad, self._said["ahead_m"]) if wish and known else None

    def tell(self, state: dict[str, Any]) -> None:
        """Publish diagnostics of the robot's status (daemon/state.py)."""
        message = DiagnosticArray()
        message.header.stamp = self._graph.now()
        for each in told_of(state, self._odom_in_map):
            status = DiagnosticStatus(
                level=bytes([each.level]),
                name=f"{self._graph.node.get_fully_qualified_name()}: {each.name}",
                message=each.message,
                hardware_id=f"robot {self._id}",
                values=[KeyValue(key=key, value=str(value)) for key, value in each.values.items()],
            )
            message.status.append(status)
        self._diagnostics.publish(message)

    def close(self) -> None:
        """See `Hardware`: publish a stop and destroy the node; a second call does nothing."""
        if self._over.is_set():
            return
        self._told = None
        self._over.set()
        self._thread.join(timeout=PATIENCE_S)
        self._move()  # the last message: the thread has ended
        self._graph.close()


class _Advised(Planner):
    def __init__(self, rob_id: int, goal_m: Pair, base: RosBase) -> None:
        super().__init__(rob_id, goal_m)
        self._base = base

    def advise(self, _t_s: float, _position_m: Pair, _velocity_mps: Pair) -> Sequence[float] | None:
        """Return the topic's advice."""
        return self._base.wish()
