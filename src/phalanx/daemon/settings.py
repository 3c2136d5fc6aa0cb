"""Settings file of one robot: its id, its mission, its trusted nodes, radio, sensors and motors."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from phalanx.config.parameter import check_limits, description, within
from phalanx.config.reader import Reader, schema_of
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError, did_you_mean
from phalanx.net.udp_radio import parse_address

MOST_BYTES = 1 << 16
HINT = "see the example: phalanx docs guides/robot"
NODES = ("process", "serial", "unix", "tcp")
TRUSTED = "process:FLASH_FILE, serial:DEVICE[@BAUD], unix:PATH or tcp:HOST:PORT"
BASES = ("python", "arena", "ros2", "dotbot")
PLANNER = "FILE.py:CLASS, or the address of phalanx robot advise: unix:PATH or udp:ADDRESS:PORT"
DRIVERS = "python:FILE.py:CLASS, arena:FOLDER, dotbot://HOST:PORT/ADDRESS, or ros2 for phalanx robot ros2"


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioFile:
    """Addresses of the robot's radio over UDP. Raises: UsageError: there is no peer."""

    here: str = field(metadata=description("the robot's own ADDRESS:PORT"))
    peers: tuple[str, ...] = field(metadata=description("the others' ADDRESS:PORT; other senders are ignored"))
    packets: Literal["plain", "sealed"] = field(
        default="plain", metadata=description("sealed: with the a-node's seal; the same for all robots")
    )
    group: str = field(
        default="", metadata=description("a multicast group to send to, ADDRESS:PORT, instead of each peer")
    )

    def __post_init__(self) -> None:
        if not self.peers:
            raise UsageError("peers is empty", "list the other robots' addresses")

    @property
    def sealed(self) -> bool:
        """Return whether packets carry seals."""
        return self.packets == "sealed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotFile:
    """One robot. Paths are relative to the file's folder. Raises: UsageError: a value is out of range."""

    robot: int = field(metadata={"within": (1, 0xFFFF), **description("its id, as on its board")})
    mission: str = field(metadata=description("a bundled scenario, or the file of one: the same for all robots"))
    key: str = field(metadata=description("file of the mission's key, from phalanx keys issue"))
    board: str = field(
        default="", metadata=description("file of phalanx keys provision, for nodes without a master key")
    )
    trusted: str = field(default="process:trusted.flash", metadata=description(f"its trusted nodes: {TRUSTED}"))
    wheels: str = field(default="", metadata=description("Unix socket of motors that obey only the trusted process"))
    clock_ppm: int = within(0, -1000, 1000, "ppm by which the trusted process's clock runs fast, for experiments")
    clock_speed: float = within(1.0, 0.05, 1.0, "its speed as a share of real time, in a slow arena")
    clock_ahead_ms: int = within(0, 0, 1 << 31, "its value at the start, ms")
    controller: str = field(
        default="", metadata=description("your own FILE.py:CLASS instead of the mission's: the same for all robots")
    )
    planner: str = field(
        default="", metadata=description(f"planner of a robot with controller guard: {PLANNER}; default: ToGoal")
    )
    driver: str = field(metadata=description(f"driver of its sensors and motors: {DRIVERS}"))
    radio: RadioFile = field(metadata=description("its radio, over UDP"))
    folder: str = field(default=".", metadata=description("folder of its log and its state file"))

    def __post_init__(self) -> None:
        check_limits(self)
        for name, kinds, allowed in (("trusted", NODES, TRUSTED), ("driver", BASES, DRIVERS)):
            value = getattr(self, name)
            kind = value.partition(":")[0]
            if kind not in kinds:
                raise UsageError(f"{name} is {value!r}", did_you_mean(kind, kinds) + allowed)
        kind, _, where = self.planner.partition(":")
        if kind == "udp":
            parse_address(where)
        elif self.planner and not kind.endswith(".py") and (kind != "unix" or not where):
            raise UsageError(f"planner is {self.planner!r}", did_you_mean(kind, ("unix", "udp")) + PLANNER)


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """A robot's file after parsing, and its folder."""

    said: RobotFile
    base: Path

    def path(self, words: str) -> Path:
        """Return a path from the file, relative to its folder."""
        return self.base / words

    @property
    def own_files(self) -> tuple[str, ...]:
        """Return the FILE.py:CLASS that the file names: its driver, planner and controller."""
        own = (self.said.driver.removeprefix("python:"), self.said.planner, self.said.controller)
        return tuple(str(self.path(each)) for each in own if each)

    @property
    def state_file(self) -> Path:
        """Return the path of the robot's state file, JSON."""
        return self.path(self.said.folder) / f"robot-{self.said.robot}.json"

    @property
    def log_file(self) -> Path:
        """Return the path of the robot's kept log."""
        return self.path(self.said.folder) / f"robot-{self.said.robot}.log"


def read_robot(path: Path) -> RobotSettings:
    """Return the robot in a file. Raises: UsageError: invalid, with the line; Unavailable: it cannot be read."""
    data = read_at_most(path, MOST_BYTES, HINT)
    value: RobotFile = Reader(str(path), HINT).root(RobotFile, data, "robot file")
    return RobotSettings(value, path.parent)


def robot_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of ROBOT.yaml files. Source: json-schema.org."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "phalanx robot",
        **schema_of(RobotFile),
    }
