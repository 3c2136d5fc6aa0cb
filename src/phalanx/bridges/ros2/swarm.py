"""Robots of ROS 2 as a `phalanx.robot.Swarm`: the gateway's node.

Each namespace with odometry is a robot: `r1` exists if /r1/odom does. Commands go to its guard's `cmd_vel_raw`, or to
`cmd_vel`, unprotected, if it has no guard. Topics are not authenticated, so no shields are shown.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import qos_profile_system_default
from sensor_msgs.msg import BatteryState

from phalanx.errors import Held, Unavailable, Unknown, UsageError
from phalanx.robot import Point, Robot
from phalanx.robot.roster import HISTORY_STEP_MM, Roster, member

from .diagnostics import ODOM_IN_MAP, place_in
from .geometry import Area, Pair, Place, place_of, pose_of, steered, twist_of
from .graph import LATCHED, RELIABLE, SENSOR, Graph

log = logging.getLogger(__name__)

NAME = "phalanx_gateway"
TURN_S, LOOK_S, JOIN_S = 0.05, 1.0, 2.0
ODOM, RAW, DIRECT = "odom", "cmd_vel_raw", "cmd_vel"
KIND = "nav_msgs/msg/Odometry"
FARTHEST_M = 1e6
# Speeds of wheels at 100 %: roughly a TurtleBot's. Guards and bases have their own limits.
DRIVE_MPS, TURN_RADPS, AHEAD_M = 0.5, 1.5, 0.2
OLD_S = 0.5  # lifetime of a command
LAST_TIMES = 5  # a stop is published so often; then others may drive the robot
MOST_ROBOTS = 100
STANDS: Pair = (0.0, 0.0)


class _Body:
    """State of one robot, from its topics."""

    def __init__(self, graph: Graph, name: str) -> None:
        self.name = name
        self.odometry = graph.inbox(Odometry, f"{name}/{ODOM}", SENSOR)
        self.battery = graph.inbox(BatteryState, f"{name}/battery_state", SENSOR)
        self.out: Any = None
        self.at = Place()
        self.heard_at_s = self.battery_v = 0.0
        self.wish: tuple[float, Pair] = (0.0, STANDS)  # end of its validity
        self.zeros = 0


class RosSwarm(Roster):
    """Robots of a ROS domain, in a context that stops them at its end. Raises: UsageError; Unavailable: no robot."""

    unprotected = (
        "what topics of ROS 2 say is checked by nobody, so pages show no shields; whoever is on the domain drives"
        " robots past us; lights stay as they are, and routes end with us"
    )

    def __init__(self, wait_s: float) -> None:
        super().__init__(())
        self._wait_s = wait_s
        self._bodies: list[_Body] = []
        self._nobodies: set[str] = set()
        self._area = Area()
        self._held = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, name="ros2", daemon=True)

    def __enter__(self) -> Self:
        self._graph = Graph(NAME, "", (), {})
        self._maps = self._graph.inbox(OccupancyGrid, "map", LATCHED)
        self._diagnostics = self._graph.inbox(DiagnosticArray, "/diagnostics", qos_profile_system_default)
        self._odom_in_map: dict[str, Place] = {}
        self._thread.start()
        until_s = time.monotonic() + self._wait_s
        while not self.robots():
            if time.monotonic() > until_s:
                self.__exit__(None, None, None)
                raise Unavailable(
                    f"no ROS 2 robot publishes {ODOM}", "use the robots' ROS_DOMAIN_ID; phalanx docs guides/ros2"
                )
            time.sleep(TURN_S)
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join(JOIN_S)
        self._graph.close()

    # --- the thread ---------------------------------------------------------------------------------------------------

    def _live(self) -> None:
        look_s, left = 0.0, LAST_TIMES
        while left:
            now_s = time.monotonic()
            try:
                if now_s >= look_s:
                    look_s = now_s + LOOK_S
                    self._look()
                for i, body in enumerate(self._bodies):
                    self._hear(i, body)
                    self._tell(i, body, now_s)
            except Exception:  # after any error, stops must still be published
                log.exception("robots of ROS 2")
            left -= self._over.is_set()
            time.sleep(TURN_S)

    def _look(self) -> None:
        """Update the list of robots, the map and the poses of odometry frames in it."""
        for topic, kinds in self._graph.node.get_topic_names_and_types():
            name, _, last = topic.rpartition("/")
            is_new = last == ODOM and KIND in kinds and all(body.name != name for body in self._bodies)
            if is_new and name not in self._nobodies and len(self._bodies) + len(self._nobodies) < MOST_ROBOTS:
                known = member(len(self._bodies))
                try:
                    body = _Body(self._graph, name)
                except UsageError:  # the name is too long for another topic in its namespace
                    self._nobodies.add(name)
                    continue
                self._members.append(replace(known, name=name.strip("/") or known.name))
                self._bodies.append(body)
                self._number_rows()
        for body in self._bodies:
            self._look_at(body)
        if (grid := self._maps.take()) is not None:
            self._area = Area.of(grid.info.width, grid.info.height, grid.info.resolution, place_of(grid.info.origin))
        for message in self._diagnostics.take_all():
            for status in message.status:
                values = {each.key: each.value for each in status.values}
                if (place := place_in(values.get(ODOM_IN_MAP, ""))) is not None:
                    name = status.name.rpartition("/")[0]
                    if any(body.name == name for body in self._bodies):
                        self._odom_in_map[name] = place

    def _look_at(self, body: _Body) -> None:
        """Update a robot's subscribers and battery."""
        for topic in (RAW, DIRECT):
            # Permanent: when a guard restarts, commands must not bypass it.
            if body.out is None and self._graph.node.count_subscribers(f"{body.name}/{topic}"):
                body.out = self._graph.publisher(Twist, f"{body.name}/{topic}", RELIABLE)
                if topic == DIRECT:
                    log.warning("%s has no guard: visitors' commands reach it unchecked", body.name or "/")
        if (battery := body.battery.take()) is not None and 0 <= battery.voltage <= FARTHEST_M:
            body.battery_v = battery.voltage

    def _hear(self, i: int, body: _Body) -> None:
        if (said := body.odometry.take()) is None:
            return
        there = place_of(said.pose.pose)
        if not all(abs(number) <= FARTHEST_M for number in (there.x_m, there.y_m, there.yaw_rad)):  # NaN is not
            return
        if said.header.frame_id != "map":
            there = self._odom_in_map.get(body.name, Place()).of(there)
        body.at, body.heard_at_s = there, time.time()
        point, _ = pose_of(self._area, there)
        self._members[i].append_position(point.x_mm, point.y_mm, HISTORY_STEP_MM)

    def _tell(self, i: int, body: _Body, now_s: float) -> None:
        if body.out is None:
            return
        until_s, moves = body.wish
        if self._held or self._over.is_set():
            moves, self._members[i].route = STANDS, ()
            body.zeros = max(body.zeros, 1) if self._held else body.zeros
        elif self._members[i].route:
            moves = self._steer(i, body)
        elif now_s > until_s:
            moves = STANDS
        if moves != STANDS:
            body.zeros = LAST_TIMES
        elif body.zeros == 0:
            return
        else:
            body.zeros -= 1
        twist = Twist()
        twist.linear.x, twist.angular.z = moves
        body.out.publish(twist)

    def _steer(self, i: int, body: _Body) -> Pair:
        """Steer a robot along its route, which begins at its position when the route was sent."""
        each = self._members[i]
        route = each.route  # another thread may end the route meanwhile
        here, _ = pose_of(self._area, body.at)
        if len(route) < 2:
            return STANDS
        goal = route[1]
        if math.dist((here.x_mm, here.y_mm), (goal.x_mm, goal.y_mm)) <= each.threshold_mm:
            if each.route is route:
                each.route = (route[0], *route[2:]) if len(route) > 2 else ()
            return STANDS
        if time.time() - body.heard_at_s > OLD_S:
            return STANDS
        velocity = steered(body.at, self._area.place_of(goal), DRIVE_MPS)
        linear, angular = twist_of(velocity, body.at.yaw_rad, AHEAD_M)
        return linear, max(-TURN_RADPS, min(TURN_RADPS, angular))

    # --- the swarm ----------------------------------------------------------------------------------------------------

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return the size of the map server's map, mm, or 20 by 20 m."""
        return self._area.size_mm

    def robots(self) -> Sequence[Robot]:
        """Return all robots heard so far, at their odometry's positions."""
        return [
            each.snapshot(*pose_of(self._area, body.at), body.battery_v, body.heard_at_s)
            for each, body in zip(self._members, self._bodies, strict=False)
            if body.heard_at_s
        ]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels for at most half a second; end a route. Raises: Held; Unknown: no subscriber."""
        i = self._driven(address)
        self._members[i].route = ()
        left, right = (max(-100, min(100, pct)) / 100 for pct in (left_pct, right_pct))
        moves = DRIVE_MPS * (left + right) / 2, TURN_RADPS * (right - left) / 2
        self._bodies[i].wish = time.monotonic() + OLD_S, moves

    def stop(self, address: str) -> None:
        """Stop the robot and end its route."""
        i = self._find(address)
        self._members[i].route = ()
        self._bodies[i].wish, self._bodies[i].zeros = (0.0, STANDS), LAST_TIMES

    def hold(self) -> None:
        """Stop all robots until `release`: publish stops twenty times a second."""
        self._held = True

    def release(self) -> None:
        """Allow commands again."""
        self._held = False

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Visit these points in order, in straight lines; an empty route stops the robot. Raises: Held; Unknown."""
        if not route:
            self.stop(address)
            return
        i = self._driven(address)
        here, _ = pose_of(self._area, self._bodies[i].at)
        self._members[i].threshold_mm = threshold_mm
        self._members[i].route = (here, *route)

    def _driven(self, address: str) -> int:
        i = self._find(address)
        if self._held:
            raise Held("the operator has stopped all robots")
        if self._bodies[i].out is None:
            raise Unknown(f"nobody listens on {RAW} or {DIRECT} there")
        return i
