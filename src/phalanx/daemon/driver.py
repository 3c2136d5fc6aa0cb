"""Between a robot's daemon and what the robot has: sensors that are read, motors that are told.

Where motors obey the trusted nodes alone, a driver's `drive` has nothing to do. Each call must come back within some
milliseconds: the daemon does nothing else meanwhile.
"""

from __future__ import annotations

import reprlib
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, cast

from phalanx.config.wheels import WheelsConfig
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.python_controller import OwnMistake
from phalanx.robot.planner import Planner
from phalanx.scenarios.own import find_class
from phalanx.wire.table import FRAME_MAX

from .settings import RobotSettings

TIMEOUT_S = 1.0
PACKET_BYTES = FRAME_MAX  # more than a reading or a command
READY, GO = b"ready", b"go"


class Driver(ABC):
    """A robot's sensors and motors, for a file of your own: `driver: python:FILE.py:CLASS`.

    Args:
        rob_id: 1..65535.
    """

    def __init__(self, rob_id: int) -> None:
        self.rob_id = rob_id

    @abstractmethod
    def sense(self) -> Mapping[str, float] | bytes:
        """What the sensors say: the fields of the controller's reading but for kind, id and time (`x_m`, …).

        Or the whole reading as bytes, for a controller of your own with sensors of its own, or one that sees things.
        """

    def drive(self, command: Mapping[str, float]) -> None:  # noqa: B027 - where the trusted nodes have the motors
        """The a-node let this command through: its fields by name (`ax_mps2`, …)."""

    def stop(self) -> None:  # noqa: B027 - the same
        """The robot is to stand still, now and until it is started again."""

    def close(self) -> None:  # noqa: B027 - where nothing is open
        """The daemon ends."""


class Hardware(Protocol):
    """What the daemon sees of a driver: bytes as they are chained."""

    def begin(self) -> None:
        """All is ready, and the mission may begin when this returns."""
        ...

    def sense(self, now_ms: int) -> bytes:
        """A reading, at this time of the robot's clock."""
        ...

    def drive(self, command: bytes) -> None:
        """A command went out."""
        ...

    def stop(self) -> None:
        """The robot is to stand still."""
        ...

    def close(self) -> None:
        """It is not needed any more."""
        ...


class Base(Hardware, Protocol):
    """Hardware that brings its planner along, and tells others of the robot."""

    async def ready(self) -> None:
        """Its sensors tell something; that may take as long as it takes."""
        ...

    def planner(self, rob_id: int, goal_m: tuple[float, float]) -> Planner:
        """Who advises the guard."""
        ...

    def on_advice(self, wake: Callable[[], object]) -> None:
        """From now on `wake` is called, in any thread, when there is advice that was not taken yet."""
        ...

    def tell(self, state: dict[str, Any]) -> None:
        """What the robot told of itself just now (state.py)."""
        ...


class OwnDriver:
    """A researcher's, in bytes."""

    def __init__(self, driver: Driver, declared: Declaration) -> None:
        self._driver, self._reads, self._commands = driver, declared.reads, declared.commands

    def begin(self) -> None:
        """See `Hardware`."""

    def sense(self, now_ms: int) -> bytes:
        """See `Hardware`. Raises: OwnMistake: it said what is no reading."""
        said = self._driver.sense()
        if isinstance(said, bytes) and 0 < len(said) <= FRAME_MAX:
            return said
        try:
            fields = {"id": self._driver.rob_id, "t": now_ms, **cast("Mapping[str, float]", said)}
            return self._reads.encode(**fields)
        except (TypeError, ValueError, KeyError, UsageError) as error:
            names = ", ".join(each.name for each in self._reads.fields if each.name not in ("id", "t"))
            hint = f"{names}: numbers; or 1 to {FRAME_MAX} bytes"
            raise OwnMistake(f"sense returned {reprlib.repr(said)}", hint, self._driver, "sense") from error

    def drive(self, command: bytes) -> None:
        """See `Hardware`."""
        try:
            self._driver.drive(self._commands.decode(command))
        except PeerError:  # what no body of this kind obeys
            self._driver.stop()

    def stop(self) -> None:
        """See `Hardware`."""
        self._driver.stop()

    def close(self) -> None:
        """See `Hardware`."""
        self._driver.close()


class ArenaDriver:
    """A body in an arena: sensors over a socket; its motors obey the trusted process, past this one."""

    def __init__(self, folder: Path, rob_id: int) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(str(sense_path(folder, rob_id)))
        except OSError as error:
            raise Unavailable(f"no arena in {folder}: {error.strerror}", "phalanx robot arena") from error

    def begin(self) -> None:
        """See `Hardware`."""
        self._ask(READY)
        self._socket.settimeout(TIMEOUT_S)

    def sense(self, now_ms: int) -> bytes:
        """See `Hardware`. Raises: Unavailable: the arena is gone."""
        return self._ask(b"%d" % now_ms)

    def _ask(self, words: bytes) -> bytes:
        try:
            self._socket.send(words)
            said = self._socket.recv(PACKET_BYTES)
        except OSError as error:
            raise Unavailable("the arena does not answer") from error
        if not said:
            raise Unavailable("the arena is gone")
        return said

    def drive(self, command: bytes) -> None:
        """See `Hardware`."""

    def stop(self) -> None:
        """See `Hardware`."""

    def close(self) -> None:
        """See `Hardware`."""
        self._socket.close()


def sense_path(folder: Path, rob_id: int) -> Path:
    """The socket of a body's sensors."""
    return folder / f"sense-{rob_id}"


def wheels_path(folder: Path, rob_id: int) -> Path:
    """The socket of a body's motors."""
    return folder / f"wheels-{rob_id}"


def make_driver(settings: RobotSettings, declared: Declaration) -> Hardware:
    """The driver that the file names. Raises: UsageError: there is none; Unavailable: no arena."""
    kind, _, where = settings.said.driver.partition(":")
    if kind == "ros2":
        raise UsageError("its driver is ros2", "phalanx robot ros2 runs it")
    if kind == "arena":
        return ArenaDriver(settings.path(where), settings.said.robot)
    if kind == "dotbot":
        if declared.config is not WheelsConfig:
            raise UsageError("a driver for DotBots", "a mission with controller: wheels")
        from .dotbot import DotbotDriver  # noqa: PLC0415 - aiohttp, which no other driver needs

        return OwnDriver(DotbotDriver(settings.said.robot, settings.said.driver), declared)
    path, _, name = where.partition(":")
    made: Any = find_class(f"{settings.path(path)}{name and ':'}{name}", Driver)
    return OwnDriver(made(settings.said.robot), declared)
