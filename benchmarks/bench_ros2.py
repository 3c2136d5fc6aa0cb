"""How much later a robot of ROS 2 does what its planner says, for the guard between them; beside a node that relays.

A robot that stands among two that vouch for it, and a planner that now and then wishes it to drive: ms from that wish
to the first cmd_vel that is not zero. Needs the extra ros2. Its results are in docs/guides/ros2.md.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor

from phalanx.lab.arena.places import free_ports
from phalanx.net.keyring import Keys
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.wire.table import BOARD

ROBOTS, APART_M = 3, 20.0
# As docs/guides/robot.md has it: other programs are not what is measured.
FIRST = ("chrt", "--rr", "1")
MISSION = """robots: 3
formation: line
grid_step_m: 20
controller: guard
guard: {{forget_ms: 3000, speed_mps: 1.0, accel_mps2: 1.0}}
bti: {{f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: {period_ms}, delta_ms: {delta_ms}, skew_ms: 200}}
"""
RELAY = """
import rclpy
from geometry_msgs.msg import Twist
rclpy.init()
node = rclpy.create_node("relay", namespace="r1")
out = node.create_publisher(Twist, "cmd_vel", 1)
node.create_subscription(Twist, "cmd_vel_raw", out.publish, 1)
out.publish(Twist())
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
"""


def guards(folder: Path, period_ms: int) -> list[list[str]]:
    keys, ports = Keys.new("bench"), free_ports(ROBOTS)
    (folder / "mission.yaml").write_text(MISSION.format(period_ms=period_ms, delta_ms=period_ms * 9 // 20))
    commands = []
    for i, port in enumerate(ports):
        board = BOARD.encode(id=i + 1, master=keys.provision(i + 1, "2026-01-01"))
        (folder / f"board-{i}.bin").write_bytes(board)
        peers = [f"127.0.0.1:{other}" for other in ports if other != port]
        said = {
            "robot": i + 1,
            "mission": "mission.yaml",
            "key": "key.json",
            "board": f"board-{i}.bin",
            "trusted": f"process:{i}.flash",
            "driver": "ros2",
            "radio": {"here": f"127.0.0.1:{port}", "peers": peers},
        }
        (folder / f"{i}.yaml").write_text(json.dumps(said))
        words = [*FIRST, sys.executable, "-m", "phalanx", "--log-level", "error", "robot", "ros2"]
        place = ["-p", f"odom_in_map:=[{i * APART_M}, 0.0, 0.0]"]
        commands.append([*words, str(folder / f"{i}.yaml"), "--namespace", f"r{i + 1}", "--", "--ros-args", *place])
    (folder / "key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))
    return commands


class Planner:
    """The bench's own node: robots' odometry, all at rest, and what the first is wished to do."""

    def __init__(self, commands: list[list[str]]) -> None:
        self._node = rclpy.create_node("bench")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._ready: set[int] = set()
        self._came: list[Twist] = []
        self._odometry = Odometry(child_frame_id="base_link")
        self._odometry.header.frame_id, self._odometry.pose.pose.orientation.w = "odom", 1.0
        ids = range(1, ROBOTS + 1)
        self._odoms = [self._node.create_publisher(Odometry, f"r{robot}/odom", 1) for robot in ids]
        for robot in ids:
            heard = lambda _, robot=robot: self._ready.add(robot)
            self._node.create_subscription(Twist, f"r{robot}/cmd_vel", heard, 1)
        self._raw = self._node.create_publisher(Twist, "r1/cmd_vel_raw", 1)
        self._node.create_subscription(Twist, "r1/cmd_vel", self._came.append, 1)
        self._node.create_timer(0.05, self._tell)
        self._processes = [subprocess.Popen(command) for command in commands]

    def _tell(self) -> None:
        if len(self._ready) == len(self._processes):  # missions begin together
            for each in self._odoms:
                each.publish(self._odometry)

    def until(self, mps: float) -> float:
        """Seconds until the robot drives, or for 0 m/s does not; the wish is said again each half second."""
        wish = Twist()
        wish.linear.x = mps
        self._came.clear()
        self._raw.publish(wish)
        began_s = said_s = time.perf_counter()
        while not any((each.linear.x > 0.0) == (mps > 0.0) for each in self._came):
            self._came.clear()
            self._executor.spin_once(timeout_sec=0.1)
            if any(each.poll() is not None for each in self._processes):
                raise SystemExit("what was to be measured has ended")
            if time.perf_counter() - said_s > 0.5:
                said_s = time.perf_counter()
                self._raw.publish(wish)
        return time.perf_counter() - began_s

    def idle(self, wait_s: float) -> None:
        until_s = time.perf_counter() + wait_s
        while (left_s := until_s - time.perf_counter()) > 0:
            self._executor.spin_once(timeout_sec=left_s)

    def close(self) -> None:
        for each in self._processes:
            each.send_signal(signal.SIGINT)
        for each in self._processes:
            each.wait()


def measure(commands: list[list[str]], times: int) -> list[float]:
    rclpy.init()
    planner, took_ms = Planner(commands), []
    try:
        planner.until(0.5)
        for _ in range(times):
            planner.until(0.0)
            planner.idle(random.uniform(0.3, 0.6))
            took_ms.append(1000 * planner.until(0.5))
    finally:
        planner.close()
        rclpy.shutdown()
    return took_ms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    times = parser.parse_args().times
    os.environ |= {"ROS_DOMAIN_ID": str(101 + os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rows = {"relay": measure([[*FIRST, sys.executable, "-c", RELAY]], times)}
    for period_ms in (250, 100):
        with tempfile.TemporaryDirectory() as folder:
            rows[f"guard, t_control_ms {period_ms}"] = measure(guards(Path(folder), period_ms), times)
    for name, took_ms in rows.items():
        p99 = statistics.quantiles(took_ms, n=100)[98]
        print(f"{name:26} p50 {statistics.median(took_ms):6.1f} ms   p99 {p99:6.1f} ms   of {len(took_ms)}")


if __name__ == "__main__":
    main()
