"""Drivers: how a robot's daemon reads sensors and moves motors.

If the trusted nodes control the motors, a driver's `drive` does nothing. Each call must return within some
milliseconds. While a call hangs the robot has no readings, and its motors stop (driver_thread.py).
"""

from __future__ import annotations

import math
import reprlib
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

from phalanx.config.flock import WheelsConfig
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.robot.planner import Planner
from phalanx.scenarios.own import find_class
from phalanx.wire.record import FLOATS, LARGEST_NUMBER, Record
from phalanx.wire.table import PACKET_MAX

from .driver_thread import DriverThread
from .settings import RobotSettings

TIMEOUT_S = 1.0
PACKET_BYTES = PACKET_MAX  # more than a reading or a command
READY, GO = b"ready", b"go"


class NoReading(Unavailable):
    """The sensors have no reading now, for the given reason. The robot stands still until they do."""


class Driver(ABC):
    """A robot's sensors and motors, to be subclassed in your own file: `driver: python:FILE.py:CLASS`.

    All methods are called from one thread, which is not the main thread; the constructor is not. While a call hangs,
    `stop` is called from another thread.

    Args:
        rob_id: 1..65535.
    """

    def __init__(self, rob_id: int) -> None:
        self.rob_id = rob_id

    @abstractmethod
    def sense(self) -> Mapping[str, float] | bytes:
        """Return the fields of the controller's reading except kind, id and time (`x_m`, …).

        For a controller with other sensors, return the whole reading as bytes.
        Raises: NoReading, OSError: there is no reading now; a NaN means the same. Other exceptions end the robot's
            process.
        """

    def drive(self, command: Mapping[str, float]) -> None:  # noqa: B027 - trusted nodes may control the motors
        """Carry out a command that the a-node forwarded: its fields by name (`ax_mps2`, …)."""

    def stop(self) -> None:  # noqa: B027 - the same
        """Stop the motors until the next `drive`: no reading, Safe Mode, or the daemon ends."""

    def close(self) -> None:  # noqa: B027 - optional
        """Release resources; `stop` was called before."""


class Hardware(ABC):
    """A driver as the daemon uses it, with readings and commands in the bytes that are logged."""

    def begin(self) -> None:  # noqa: B027 - optional
        """Report that this process is ready, and wait until the mission may begin."""

    @abstractmethod
    async def sense(self, now_ms: int, within_s: float) -> bytes:
        """Return a reading taken at `now_ms` of the robot's clock. Raises: NoReading: none within `within_s`."""

    def drive(self, command: bytes) -> None:  # noqa: B027 - trusted nodes may control the motors
        """Move the motors by a command that the a-node forwarded."""

    def stop(self) -> None:  # noqa: B027 - the same
        """Stop the motors until the next command, even if a call hangs."""

    def alive(self) -> None:  # noqa: B027 - the same
        """Note that the daemon does not hang, so the motors may continue. Called every ALIVE_S."""

    @abstractmethod
    def close(self) -> None:
        """Stop the motors and release everything. Idempotent."""


class AdvisedHardware(Hardware):
    """A driver with its own planner, as for ROS 2 (bridges/ros2/node.py)."""

    @abstractmethod
    async def ready(self) -> None:
        """Wait until the base and its planner are available."""

    @abstractmethod
    def planner(self, rob_id: int, goal_m: tuple[float, float]) -> Planner:
        """Return the planner of a robot."""

    @abstractmethod
    def on_advice(self, wake: Callable[[], object]) -> None:
        """Register `wake`, to be called in any thread when there is new advice."""

    @abstractmethod
    def tell(self, state: dict[str, Any]) -> None:
        """Publish the robot's state (daemon/state.py)."""


class OwnDriver(Hardware):
    """Runs a driver from a user's file."""

    def __init__(self, driver: Driver, declared: Declaration) -> None:
        self._driver, self._reads, self._commands = driver, declared.reads, declared.commands
        self._thread = DriverThread(driver.stop)

    async def sense(self, now_ms: int, within_s: float) -> bytes:
        """See `Hardware`. Raises: OwnMistake: an invalid reading; exceptions of the driver's calls."""
        try:
            result = await self._thread.ask("sense", self._driver.sense, within_s)
        except OSError as error:  # a disturbed bus or line, or a time-out
            raise NoReading(str(error) or type(error).__name__) from error
        if isinstance(result, bytes) and 0 < len(result) <= PACKET_MAX:
            return result
        try:
            fields = dict(cast("Mapping[str, float]", result))
            for name, value in fields.items():
                if not isinstance(value, bytes) and not abs(value) <= LARGEST_NUMBER:  # also rejects NaN
                    raise NoReading(f"{name} is {value:g}")
            return self._reads.encode(id=self._driver.rob_id, t=now_ms, **fields)
        except (TypeError, ValueError, KeyError, ArithmeticError, UsageError) as error:
            names = ", ".join(each.name for each in self._reads.fields if each.name not in ("id", "t"))
            hint = f"return numbers for {names}; or 1 to {PACKET_MAX} bytes"
            raise OwnMistake(f"sense returned {reprlib.repr(result)}", hint, self._driver, "sense") from error

    def drive(self, command: bytes) -> None:
        """See `Hardware`."""
        try:
            fields = self._commands.decode(command)
        except PeerError:  # a command for another kind of robot
            self._thread.stop()
        else:
            self._thread.drive(lambda: self._driver.drive(fields))

    def stop(self) -> None:
        """See `Hardware`."""
        self._thread.stop()

    def alive(self) -> None:
        """See `Hardware`."""
        self._thread.alive()

    def close(self) -> None:
        """See `Hardware`."""
        self._thread.close(self._driver.close)


class ArenaDriver(Hardware):
    """Reads the sensors of a body in an arena, over a socket. Its motors obey the trusted nodes only."""

    def __init__(self, folder: Path, rob_id: int) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(str(sense_path(folder, rob_id)))
        except OSError as error:
            raise Unavailable(f"no arena in {folder}: {error.strerror}", "start it: phalanx robot arena") from error

    def begin(self) -> None:
        """See `Hardware`."""
        self._ask(READY)
        self._socket.settimeout(TIMEOUT_S)

    async def sense(self, now_ms: int, within_s: float) -> bytes:  # noqa: ARG002 - its own timeout
        """See `Hardware`. Raises: Unavailable: the arena has ended."""
        return self._ask(b"%d" % now_ms)

    def _ask(self, words: bytes) -> bytes:
        try:
            self._socket.send(words)
            result = self._socket.recv(PACKET_BYTES)
        except OSError as error:
            raise Unavailable("the arena does not answer") from error
        if not result:
            raise Unavailable("the arena has ended")
        return result

    def close(self) -> None:
        """See `Hardware`."""
        self._socket.close()


def no_reading(reads: Record, rob_id: int, now_ms: int) -> bytes:
    """Return the reading to log when there is none: its numbers are NaN, as from broken sensors.

    Controllers reject it: wheels stop, a point mass coasts, and nothing is sent. Auditors refuse a robot that does
    anything else. Source: docs/spec/rebound.md (no reading).
    """
    known = {"tag": reads.tag, "id": rob_id, "t": now_ms}
    rest = {each.name: math.nan if each.type in FLOATS else 0 for each in reads.fields}
    return reads.form.pack(*({**rest, **known}[each.name] for each in reads.all_fields))


def sense_path(folder: Path, rob_id: int) -> Path:
    """Return the path of the socket of a body's sensors."""
    return folder / f"sense-{rob_id}"


def wheels_path(folder: Path, rob_id: int) -> Path:
    """Return the path of the socket of a body's motors."""
    return folder / f"wheels-{rob_id}"


def make_driver(settings: RobotSettings, declared: Declaration) -> Hardware:
    """Return the driver that the robot's file names. Raises: UsageError: invalid; Unavailable: no arena."""
    kind, _, where = settings.said.driver.partition(":")
    if kind == "ros2":
        raise UsageError("its driver is ros2", "run it with phalanx robot ros2")
    if kind == "arena":
        return ArenaDriver(settings.path(where), settings.said.robot)
    if kind == "dotbot":
        if declared.config is not WheelsConfig:
            raise UsageError("a driver for DotBots without wheels", "use a mission with controller: wheels")
        (point,) = entry_points(group="phalanx.drivers", name=kind)  # loaded by name, as bridges are a higher layer
        return OwnDriver(point.load()(settings.said.robot, settings.said.driver), declared)
    path, _, name = where.partition(":")
    made: Any = find_class(f"{settings.path(path)}{name and ':'}{name}", Driver)
    if made.drive is not Driver.drive and made.stop is Driver.stop:
        raise UsageError(
            f"{made.__name__} in {path} has a method drive, but no method stop",
            "add stop: nothing else stops its motors",
        )
    return OwnDriver(made(settings.said.robot), declared)
