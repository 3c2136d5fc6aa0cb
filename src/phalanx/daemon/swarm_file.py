"""Settings file of a gateway for robots in separate processes: mission, addresses, signing keys."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.config.parameter import check_limits, description
from phalanx.config.reader import Reader
from phalanx.config.written import read_at_most
from phalanx.errors import UsageError
from phalanx.net.mission_key import read_mission_key
from phalanx.robot.signer import Signer
from phalanx.scenarios.scenario import WHEELS, Scenario

from .run import mission_in
from .sealed_air import with_room_for_seals
from .settings import HINT, MOST_BYTES, TRUSTED, RadioFile, RobotFile, RobotSettings
from .signed_mission import signed_for


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotAt:
    """Address of a robot's radio. Raises: UsageError: a value is out of range."""

    robot: int = field(metadata={"within": (1, 0xFFFF), **description("its id")})
    at: str = field(metadata=description("its radio's ADDRESS:PORT, as `here` in its own file"))

    def __post_init__(self) -> None:
        check_limits(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SwarmFile:
    """A gateway's robots. Paths are relative to the file's folder. Raises: UsageError: a value is out of range."""

    mission: str = field(metadata=description("the robots' scenario, the same file"))
    key: str = field(metadata=description("the mission's key, the same file as the robots'"))
    gateway: str = field(metadata=description("key that signs visitors' orders: PEM, of phalanx keys export"))
    operator: str = field(metadata=description("key that signs the operator's stop: PEM, of phalanx keys export"))
    here: str = field(metadata=description("the gateway's own ADDRESS:PORT; a peer of each robot"))
    robots: tuple[RobotAt, ...] = field(metadata=description("the robots that visitors can drive"))
    trusted: str = field(
        default="", metadata=description(f"the gateway's own trusted nodes, which check tokens: {TRUSTED}")
    )
    number: int = field(default=0, metadata={"within": (0, 0xFFFF), **description("id of these nodes, not a robot's")})
    board: str = field(default="", metadata=description("file of phalanx keys provision for that id"))
    packets: Literal["plain", "sealed"] = field(default="plain", metadata=description("as in the robots' files"))

    def __post_init__(self) -> None:
        check_limits(self)
        numbers = [each.robot for each in self.robots]
        if not numbers or len(set(numbers)) < len(numbers):
            raise UsageError("robots is empty, or contains a robot twice", "list each robot once")
        if bool(self.trusted) != bool(self.number) or self.number in numbers:
            raise UsageError(f"trusted nodes with number {self.number}", "give trusted and a number that no robot has")
        if self.packets == "sealed" and not self.trusted:
            raise UsageError("packets: sealed, without trusted", "add trusted: a gateway's own nodes seal its packets")


@dataclass(frozen=True, slots=True)
class SwarmSettings:
    """A swarm's file after parsing, its path, and its mission."""

    said: SwarmFile
    path: Path
    scenario: Scenario
    mission: int

    @property
    def own(self) -> RobotSettings | None:
        """Return the gateway's trusted nodes as a robot's settings, or None without such nodes."""
        said = self.said
        if not said.trusted:
            return None
        as_robot = RobotFile(
            robot=said.number,
            mission=said.mission,
            key=said.key,
            board=said.board,
            trusted=said.trusted,
            driver="python:",
            radio=RadioFile(here=said.here, peers=tuple(each.at for each in said.robots), packets=said.packets),
        )
        return RobotSettings(as_robot, self.path.parent)

    def signer(self, key: Ed25519PrivateKey, purpose: int) -> Signer:
        """Load the signer with that key. Raises: UsageError: the mission names another key."""
        name = ("gateway_key", "operator_key")[purpose]
        signer = Signer(key, self.mission, purpose)
        if signer.public.hex() != getattr(self.scenario, name).lower():
            raise UsageError(
                f"{self.said.mission} names another {name} than {signer.public.hex()}", "compare with phalanx keys list"
            )
        return signer


def read_swarm(path: Path) -> SwarmSettings:
    """Return the swarm in a file. Raises: UsageError: invalid, with the line; Unavailable: it cannot be read."""
    said: SwarmFile = Reader(str(path), HINT).root(SwarmFile, read_at_most(path, MOST_BYTES, HINT), "swarm file")
    scenario = mission_in(path.parent, said.mission)
    if scenario.controller != WHEELS:
        hint = "use wheels: other controllers obey no orders"
        raise UsageError(f"{said.mission} has controller: {scenario.controller}", hint)
    if said.packets == "sealed":
        scenario = with_room_for_seals(scenario)
    signed_for(path.parent / said.key, scenario, said.mission)
    mission = {read_mission_key(path.parent / said.key, each.robot).seq for each in said.robots}
    return SwarmSettings(said, path, scenario, mission.pop())
