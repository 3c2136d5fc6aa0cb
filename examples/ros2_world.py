"""Small robots on two wheels for ROS 2, and planners for them; `docs/guides/ros2.md` has the commands.

`bases` simulates robots: each receives cmd_vel and publishes odom in its own namespace r1, r2, …. They begin together
after all have received a command, and at the end a summary of their paths is printed as JSON.
`planners` drives each robot straight to its goal, over cmd_vel_raw, and a compromised one to the nearest other robot.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import time

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor

APART_M, WAY_M = 8.0, 6.0  # from start to start, all heading north; to the goal
NORTH = math.pi / 2
RATE_HZ, SLOWEST_HZ = 20.0, 2.0
MOST_MPS, MOST_RADPS, MOST_MPS2, MOST_RADPS2 = 1.0, 2.0, 2.0, 6.0


def start_m(robot):
    return APART_M * (robot - 1), 0.0


class Base:
    """Simulated differential drive; commands are valid for half a second, as in ros2_control."""

    def __init__(self, node, robot):
        self.robot, self.node = robot, node
        self.x, self.y = start_m(robot)
        self.yaw, self.speed, self.turn = NORTH, 0.0, 0.0
        self.told, self.told_s = Twist(), 0.0
        self.moved_s, self.reached_s = 0.0, None
        self.out = node.create_publisher(Odometry, f"/r{robot}/odom", 1)
        node.create_subscription(Twist, f"/r{robot}/cmd_vel", self.on_told, 1)

    def on_told(self, twist):
        self.told, self.told_s = twist, time.monotonic()

    def step(self, dt_s, now_s):
        fresh = time.monotonic() - self.told_s < 1.0 / SLOWEST_HZ
        wants = (self.told.linear.x, self.told.angular.z) if fresh else (0.0, 0.0)
        self.speed = towards(self.speed, wants[0], MOST_MPS, MOST_MPS2 * dt_s)
        self.turn = towards(self.turn, wants[1], MOST_RADPS, MOST_RADPS2 * dt_s)
        self.yaw += self.turn * dt_s
        self.x += self.speed * math.cos(self.yaw) * dt_s
        self.y += self.speed * math.sin(self.yaw) * dt_s
        if abs(self.speed) > 0.02:
            self.moved_s = now_s
        x, y = start_m(self.robot)
        if self.reached_s is None and math.dist((self.x, self.y), (x, y + WAY_M)) < 0.7:
            self.reached_s = now_s

    def tell(self):
        """Publish odometry that begins at the start pose: REP 105 guarantees no other pose of `odom` in `map`."""
        x, y = start_m(self.robot)
        told = Odometry(child_frame_id="base_link")
        told.header.frame_id = "odom"
        told.header.stamp = self.node.get_clock().now().to_msg()
        told.pose.pose.position.x, told.pose.pose.position.y = self.y - y, -(self.x - x)
        half = (self.yaw - NORTH) / 2
        told.pose.pose.orientation.z, told.pose.pose.orientation.w = math.sin(half), math.cos(half)
        told.twist.twist.linear.x, told.twist.twist.angular.z = self.speed, self.turn
        self.out.publish(told)


def towards(now, wanted, most, step):
    wanted = max(-most, min(most, wanted)) if math.isfinite(wanted) else 0.0
    return now + max(-step, min(step, wanted - now))


def bases(node, spin, args):
    robots = [Base(node, robot) for robot in range(1, args.robots + 1)]
    while not (args.at_once or all(each.told_s for each in robots)):
        spin(0.05)
    began_s = then_s = time.monotonic()
    nearest_m = math.inf
    while (now_s := time.monotonic()) < began_s + args.duration:
        for each in robots:
            each.step(min(now_s - then_s, 0.1), now_s - began_s)
            each.tell()
        then_s = now_s
        for a, b in itertools.combinations(robots, 2):
            nearest_m = min(nearest_m, math.dist((a.x, a.y), (b.x, b.y)))
        until_s = now_s + 1.0 / RATE_HZ
        while (left_s := until_s - time.monotonic()) > 0:
            spin(left_s)
    summed_up = {
        "nearest_m": nearest_m,
        "robots": {
            each.robot: {"moved_s": each.moved_s, "reached_s": each.reached_s, "at_m": (each.x, each.y)}
            for each in robots
        },
    }
    print(json.dumps(summed_up), flush=True)


class Planner:
    """Planner that reads its robot's odometry and controls a point half a metre ahead of the axle."""

    def __init__(self, node, robot, topic):
        self.robot, self.at = robot, None
        self.out = node.create_publisher(Twist, f"/r{robot}/{topic}", 1)
        node.create_subscription(Odometry, f"/r{robot}/odom", self.on_odometry, 1)

    def on_odometry(self, told):
        (x, y), at = start_m(self.robot), told.pose.pose.position
        q = told.pose.pose.orientation
        self.at = x - at.y, y + at.x, NORTH + 2 * math.atan2(q.z, q.w)

    def steer(self, goal, gain):
        """Drive to the goal with gain 1 per second, at most at the robot's speed."""
        wanted = Twist()
        if self.at and goal:
            x, y, yaw = self.at
            dx, dy = gain * (goal[0] - x), gain * (goal[1] - y)
            share = min(1.0, MOST_MPS / max(math.hypot(dx, dy), 1e-9))
            wanted.linear.x = share * (dx * math.cos(yaw) + dy * math.sin(yaw))
            wanted.angular.z = share * (dy * math.cos(yaw) - dx * math.sin(yaw)) / 0.5
        self.out.publish(wanted)


def planners(node, spin, args):
    all_of_them = [Planner(node, robot, args.topic) for robot in range(1, args.robots + 1)]
    began_s = None
    while True:
        until_s = time.monotonic() + 0.1
        began_s = began_s or (until_s if all(each.at for each in all_of_them) else None)
        for each in all_of_them:
            x, y = start_m(each.robot)
            goal, gain = (x, y + WAY_M), 0.7
            if each.robot == args.hijacked and began_s and until_s > began_s + args.at:
                others = [other.at[:2] for other in all_of_them if other is not each]
                goal, gain = min(others, key=lambda other, me=each.at[:2]: math.dist(me, other)), 10.0
            each.steer(goal, gain)
        while (left_s := until_s - time.monotonic()) > 0:
            spin(left_s)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["bases", "planners"])
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--duration", type=float, default=30.0, help="seconds, of the bases")
    parser.add_argument("--at-once", action="store_true", help="bases do not wait for commands")
    parser.add_argument("--topic", default="cmd_vel_raw", help="what planners publish; cmd_vel: past the guard")
    parser.add_argument("--hijacked", type=int, default=0, help="id of the robot with a compromised planner")
    parser.add_argument("--at", type=float, default=3.0, help="when, seconds from the first odometry")
    args = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node(f"example_{args.what}")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        {"bases": bases, "planners": planners}[args.what](node, lambda s: executor.spin_once(timeout_sec=s), args)


if __name__ == "__main__":
    main()
