"""Settings file of one robot: its id, its mission, and where its trusted nodes, radio, sensors and motors are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from phalanx.config.parameter import check_limits, description, within
from phalanx.config.reader import Reader, schema_of
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError, did_you_mean
from phalanx.net.udp_radio import parsed

MOST_BYTES = 1 << 16
HINT = "phalanx docs guides/robot has an example"
NODES = ("process", "serial", "unix", "tcp")
TRUSTED = "process:FLASH_FILE, serial:DEVICE[@BAUD], unix:PATH or tcp:HOST:PORT"
BASES = ("python", "arena", "ros2", "dotbot")
PLANNER = "FILE.py:CLASS, or where phalanx robot advise listens: unix:PATH or udp:ADDRESS:PORT"
DRIVERS = "python:FILE.py:CLASS, arena:FOLDER, dotbot://HOST:PORT/ADDRESS, or ros2 for phalanx robot ros2"


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioFile:
    """Addresses where the radio sends and listens. Raises: UsageError: there is no peer."""

    here: str = field(metadata=description("where this robot listens, ADDRESS:PORT"))
    peers: tuple[str, ...] = field(metadata=description("the others' ADDRESS:PORT; from nobody else it hears anything"))
    packets: Literal["plain", "sealed"] = field(
        default="plain", metadata=description("sealed: each carries its a-node's seal; the same for all robots")
    )
    group: str = field(
        default="", metadata=description("a multicast group to speak to, ADDRESS:PORT, instead of each peer")
    )

    def __post_init__(self) -> None:
        if not self.peers:
            raise UsageError("peers are none", "the other robots' addresses")

    @property
    def sealed(self) -> bool:
        """Return whether packets carry seals."""
        return self.packets == "sealed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotFile:
    """One robot. Paths are relative to the file's folder. Raises: UsageError: a value is out of range."""

    robot: int = field(metadata={"within": (1, 0xFFFF), **description("its number, as its board has it")})
    mission: str = field(
        metadata=description("a scenario that comes with phalanx, or its file: the same for all robots")
    )
    key: str = field(metadata=description("the mission's key, as phalanx keys issue wrote it"))
    board: str = field(
        default="", metadata=description("what phalanx keys provision wrote, for nodes without a master key")
    )
    trusted: str = field(
        default="process:trusted.flash", metadata=description(f"where its trusted nodes are: {TRUSTED}")
    )
    wheels: str = field(default="", metadata=description("Unix socket of motors that obey the trusted process alone"))
    clock_ppm: int = within(0, -1000, 1000, "the trusted process's clock runs fast by so much; to try things with")
    clock_speed: float = within(1.0, 0.05, 1.0, "and at so much of true time; in a slow arena")
    clock_ahead_ms: int = within(0, 0, 1 << 31, "what it shows at its start, ms")
    controller: str = field(
        default="", metadata=description("FILE.py:CLASS of your own instead of the mission's: the same for all robots")
    )
    planner: str = field(
        default="", metadata=description(f"who advises it if a guard drives it: {PLANNER}; else ToGoal")
    )
    driver: str = field(metadata=description(f"what reads its sensors and drives its motors: {DRIVERS}"))
    radio: RadioFile = field(metadata=description("over UDP"))
    folder: str = field(default=".", metadata=description("where it keeps its log and tells of its state"))

    def __post_init__(self) -> None:
        check_limits(self)
        for name, kinds, allowed in (("trusted", NODES, TRUSTED), ("driver", BASES, DRIVERS)):
            said = getattr(self, name)
            kind = said.partition(":")[0]
            if kind not in kinds:
                raise UsageError(f"{name} is {said!r}", did_you_mean(kind, kinds) + allowed)
        kind, _, where = self.planner.partition(":")
        if kind == "udp":
            parsed(where)
        elif self.planner and not kind.endswith(".py") and (kind != "unix" or not where):
            raise UsageError(f"planner is {self.planner!r}", did_you_mean(kind, ("unix", "udp")) + PLANNER)


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """A robot's file as it was read, and where it lies."""

    said: RobotFile
    base: Path

    def path(self, words: str) -> Path:
        """A path of the file's."""
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
    """The robot in a file. Raises: UsageError: none, or with a mistake in a line; Unavailable: it cannot be read."""
    data = read_at_most(path, MOST_BYTES, HINT)
    said: RobotFile = Reader(str(path), HINT).root(RobotFile, data, "robot file")
    return RobotSettings(said, path.parent)


def robot_schema() -> dict[str, Any]:
    """A JSON schema (draft 2020-12) of robots' files. Source: json-schema.org."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "phalanx robot",
        **schema_of(RobotFile),
    }
