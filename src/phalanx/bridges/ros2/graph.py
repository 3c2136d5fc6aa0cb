"""A node of ROS 2 without an executor: whoever has it takes what its topics say when he wants it.

rclpy's executor makes all that it waits for anew at each message, and turns each message into Python: it took a daemon
more of a core than its audits do (docs/guides/ros2.md). Here a message that nobody takes costs nothing,
and the newest is the only one that is kept. Source: rclpy.wait_for_message, which waits and takes as this does.
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
MOST = 100  # messages that are taken at a time, as many as the deepest queue keeps
# As rclpy's qos_profile_sensor_data, but for its depth of 5.
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1)
TRAIL = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
# What a map server says once, for who comes later too. Source: nav2_map_server.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Inbox:
    """A topic's newest message; for any thread. `topic` is its whole name, `handle` is for rclpy."""

    def __init__(self, node: Any, kind: Any, topic: str, qos: QoSProfile) -> None:
        self._subscription = node.create_subscription(kind, topic, _nobody, qos)
        self._kind, self._lock = kind, threading.Lock()
        self.topic, self.handle = str(self._subscription.topic_name), self._subscription.handle

    def take(self) -> Any:
        """The message that came since the last call, the newest of several; None if there was none."""
        return (self.take_all() or [None])[-1]

    def take_all(self) -> list[Any]:
        """What came since the last call and was kept, the oldest first: so many that no flood keeps us here."""
        came = []
        with self._lock:
            for _ in range(MOST):
                if not (taken := self.handle.take_message(self._kind, False)):
                    break
                came.append(taken[0])
        return came


class Graph:
    """A node of ROS 2, until `close`. `said` holds `parameters` as they were set. Raises: UsageError: wrong ones."""

    def __init__(self, name: str, namespace: str, arguments: Sequence[str], parameters: Mapping[str, Any]) -> None:
        self.context = rclpy.Context()
        with _refused(), contextlib.ExitStack() as undo:
            undo.callback(rclpy.try_shutdown, context=self.context)
            rclpy.init(args=[*arguments], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
            # Services that nobody would answer are none: parameters are read once.
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
        """A message waits there, or so much time is over; one thread alone waits."""
        with self._waiting:
            if self.is_open:
                self._waits.clear_entities()
                self._waits.add_subscription(inbox.handle)
                self._waits.wait(int(max(0.0, most_s) * NS_PER_S))

    def place(self, name: str) -> Place:
        """Return the place that a parameter names as [x, y, yaw]. Raises: UsageError: it names none."""
        said = self.said[name]
        if len(said) != 3 or not all(map(math.isfinite, said)):
            raise UsageError(f"{name} {[*said]}", "[x, y, yaw], finite")
        return Place(x_m=said[0], y_m=said[1], yaw_rad=said[2])

    def check(self, *names: str) -> None:
        """Refuse parameters that are no numbers above 0. Raises: UsageError."""
        if not all(0.0 < self.said[name] < math.inf for name in names):
            raise UsageError(f"{', '.join(names)}: {[self.said[name] for name in names]}", "finite, above 0")

    def now(self) -> Any:
        """The time, as a message's stamp."""
        return self.node.get_clock().now().to_msg()

    def move(self, out: Any, linear_mps: float, angular_radps: float) -> None:
        """A publisher of `Twist`, or `TwistStamped` if `enable_stamped_cmd_vel`, tells a base to move."""
        message = twist = out.msg_type()
        if self.said["enable_stamped_cmd_vel"]:
            message.header.stamp, message.header.frame_id = self.now(), self.said["base_frame_id"]
            twist = message.twist
        twist.linear.x, twist.angular.z = linear_mps, angular_radps
        out.publish(message)

    def close(self) -> None:
        """The node is gone, when nobody waits any more."""
        with self._waiting:
            self.is_open = False
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@contextlib.contextmanager
def _refused() -> Iterator[None]:
    """Raise what ROS 2 refuses as one line."""
    try:
        yield
    except Exception as error:  # rclpy has a dozen kinds, with no common one
        words = str(error).strip().splitlines()
        raise UsageError(f"ROS 2: {words[0] if words else type(error).__name__}", "phalanx docs guides/ros2") from error


def _nobody(_message: Any) -> None:
    """Without an executor nobody calls this."""
