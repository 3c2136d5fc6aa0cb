"""A robot with a lidar in a building, for ROS 2; `docs/guides/ros2.md` has the commands.

It publishes scan and odom ten times a second of simulated time, and follows cmd_vel of the last half second. Its
odometry drifts, and it does not publish its true pose. With --rate, simulated time is faster than real time, as stamps
show. At the end, after Ctrl-C or SIGTERM, it prints its true pose: x, y, heading.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from phalanx.config.lidar import LidarConfig
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.wire.table import DRIVE, KIND_DRIVE
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions.body import Building, MissionBody

STEP_S, COUNTS_S = 0.1, 0.5


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", help="of phalanx, or a file")
    parser.add_argument("--namespace", default="r1")
    parser.add_argument("--lidar", default="360,720,10,0.01")
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--clockwise", action="store_true", help="its lidar counts its beams so, from behind")
    args = parser.parse_args()
    plan, lidar = load_floorplan(args.map), LidarConfig.parse(args.lidar)
    body = MissionBody(1, Building(plan, lidar), Sensors(lidar), plan.start, OdometryNoise(0.03, 0.05), (1, 1))
    chance = np.random.default_rng(1)
    rclpy.init()
    node = rclpy.create_node("building", namespace=args.namespace)
    said = []
    node.create_subscription(Twist, "cmd_vel", said.append, 1)
    scans = node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
    odoms = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    began_s, k, told_s = time.monotonic(), 0, 0.0
    try:
        while True:
            k += 1
            now_s = k * STEP_S
            body.advance(now_s)
            stamp = Time(sec=1_000_000 + int(now_s), nanosec=int(now_s % 1 * 1e9))
            odoms.publish(odometry(stamp, body.odometry.pose))
            scans.publish(swept(stamp, body.building.lidar.sweep(body.wheels.pose, chance), args.clockwise))
            until_s = began_s + now_s / args.rate
            while (left_s := until_s - time.monotonic()) > 0:
                rclpy.spin_once(node, timeout_sec=left_s)
            for twist in said[-1:]:
                told, told_s = (round(1000 * twist.linear.x), round(1000 * twist.angular.z)), now_s
                body.execute_command(DRIVE.form.pack(KIND_DRIVE, 1, 0, *told))
            said.clear()
            if now_s - told_s > COUNTS_S:
                body.halt()
    except (KeyboardInterrupt, SystemExit):
        print(json.dumps(body.wheels.pose), flush=True)


def odometry(stamp, pose):
    told = Odometry(child_frame_id="base_link")
    told.header.frame_id, told.header.stamp = "odom", stamp
    told.pose.pose.position.x, told.pose.pose.position.y = pose[0], pose[1]
    told.pose.pose.orientation.z, told.pose.pose.orientation.w = math.sin(pose[2] / 2), math.cos(pose[2] / 2)
    return told


def swept(stamp, scan, clockwise):
    told = LaserScan(range_min=scan.range_min_m, range_max=scan.range_max_m)
    told.header.frame_id, told.header.stamp = "base_scan", stamp
    ranges, first, step = scan.ranges_m, scan.angle_min_rad, scan.angle_increment_rad
    if clockwise:  # as drivers of lidars that hang upside down
        ranges, first, step = ranges[::-1], first + (len(ranges) - 1) * step, -step
    told.angle_min, told.angle_increment, told.angle_max = first, step, first + (len(ranges) - 1) * step
    told.ranges = ranges.astype(np.float32).tolist()
    return told


if __name__ == "__main__":
    main()
