"""A ROS 2 node without an executor: its user polls the topics.

rclpy's executor rebuilds its wait set at each message, and converts each message to Python: that took more of a core
than a daemon's audits (docs/guides/ros2.md). Here a message that is not polled costs nothing, and only the newest is
stored. Source: rclpy.wait_for_message, which waits and takes messages in the same way.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from phalanx.errors import UsageError

from .geometry import Place

NS_PER_S = 1e9
MOST = 100  # messages per call, the depth of the deepest queue
# rclpy's qos_profile_sensor_data with depth 1 instead of 5.
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1)
TRAIL = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
# A map server publishes once, also for later subscribers. Source: nav2_map_server.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Inbox:
    """Thread-safe subscription that stores the newest message. `topic` is the full name, `handle` is for rclpy."""

    def __init__(self, node: Any, kind: Any, topic: str, qos: QoSProfile) -> None:
        self._subscription = node.create_subscription(kind, topic, _nobody, qos)
        self._kind, self._lock = kind, threading.Lock()
        self.topic, self.handle = str(self._subscription.topic_name), self._subscription.handle

    def take(self) -> Any:
        """Return the newest message since the last call, or None."""
        return (self.take_all() or [None])[-1]

    def take_all(self) -> list[Any]:
        """Return the stored messages since the last call, oldest first, at most MOST of them."""
        came = []
        with self._lock:
            for _ in range(MOST):
                if not (taken := self.handle.take_message(self._kind, False)):
                    break
                came.append(taken[0])
        return came


class Graph:
    """A ROS 2 node, until `close`. `said` has the values of `parameters`. Raises: UsageError: invalid ones."""

    def __init__(self, name: str, namespace: str, arguments: Sequence[str], parameters: Mapping[str, Any]) -> None:
        self.context = rclpy.Context()
        with _refused(), contextlib.ExitStack() as undo:
            undo.callback(rclpy.try_shutdown, context=self.context)
            rclpy.init(args=[*arguments], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
            # No parameter services: parameters are read once.
            self.node = rclpy.create_node(
                name, namespace=namespace, context=self.context, start_parameter_services=False
            )
            self.said: dict[str, Any] = {
                key: self.node.declare_parameter(key, value).value for key, value in parameters.items()
            }
            undo.pop_all()
        self.is_open, self._waiting = True, threading.Lock()
        assert self.context.handle, "it was just begun"
        self._waits = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, self.context.handle)

    def inbox(self, kind: Any, topic: str, qos: QoSProfile) -> Inbox:
        """Subscribe to a topic. Raises: UsageError: no such name."""
        with _refused():
            return Inbox(self.node, kind, topic, qos)

    def publisher(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
        """Make a publisher of a topic. Raises: UsageError: no such name."""
        with _refused():
            return self.node.create_publisher(kind, topic, qos)

    def wait(self, inbox: Inbox, most_s: float) -> None:
        """Wait for a message in the inbox, at most so long; one thread at a time."""
        with self._waiting:
            if self.is_open:
                self._waits.clear_entities()
                self._waits.add_subscription(inbox.handle)
                self._waits.wait(int(max(0.0, most_s) * NS_PER_S))

    def place(self, name: str) -> Place:
        """Return the pose of a parameter [x, y, yaw]. Raises: UsageError: it is invalid."""
        said = self.said[name]
        if len(said) != 3 or not all(map(math.isfinite, said)):
            raise UsageError(f"{name} {[*said]}", "[x, y, yaw], finite")
        return Place(x_m=said[0], y_m=said[1], yaw_rad=said[2])

    def check(self, *names: str) -> None:
        """Check that parameters are finite and above 0. Raises: UsageError."""
        if not all(0.0 < self.said[name] < math.inf for name in names):
            raise UsageError(f"{', '.join(names)}: {[self.said[name] for name in names]}", "finite, above 0")

    def now(self) -> Any:
        """Return the current time as a message stamp."""
        return self.node.get_clock().now().to_msg()

    def move(self, out: Any, linear_mps: float, angular_radps: float) -> None:
        """Publish a `Twist`, or a `TwistStamped` if `enable_stamped_cmd_vel`."""
        message = twist = out.msg_type()
        if self.said["enable_stamped_cmd_vel"]:
            message.header.stamp, message.header.frame_id = self.now(), self.said["base_frame_id"]
            twist = message.twist
        twist.linear.x, twist.angular.z = linear_mps, angular_radps
        out.publish(message)

    def close(self) -> None:
        """Destroy the node after the current `wait` has ended."""
        with self._waiting:
            self.is_open = False
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@contextlib.contextmanager
def _refused() -> Iterator[None]:
    """Convert errors of ROS 2 to a UsageError of one line."""
    try:
        yield
    except Exception as error:  # rclpy has a dozen exceptions without a common base
        words = str(error).strip().splitlines()
        raise UsageError(f"ROS 2: {words[0] if words else type(error).__name__}", "phalanx docs guides/ros2") from error


def _nobody(_message: Any) -> None:
    """Do nothing: without an executor, callbacks are not called."""
