"""Settings file of a gateway for robots in processes of their own: mission, addresses, signers."""

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
    """Address at which a robot listens. Raises: UsageError: a value is out of range."""

    robot: int = field(metadata={"within": (1, 0xFFFF), **description("its number")})
    at: str = field(metadata=description("its radio's ADDRESS:PORT, as `here` in its own file"))

    def __post_init__(self) -> None:
        check_limits(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SwarmFile:
    """A gateway's robots. Paths are relative to the file's folder. Raises: UsageError: a value is out of range."""

    mission: str = field(metadata=description("the robots' scenario, the same file"))
    key: str = field(metadata=description("the mission's key, the same file as the robots'"))
    gateway: str = field(metadata=description("signs visitors' orders: PEM, of phalanx keys export"))
    operator: str = field(metadata=description("signs the operator's stop: the same"))
    here: str = field(metadata=description("where the gateway's radio listens, ADDRESS:PORT; a peer of each robot's"))
    robots: tuple[RobotAt, ...] = field(metadata=description("all that visitors may drive"))
    trusted: str = field(
        default="", metadata=description(f"where trusted nodes of the gateway's own are, which check tokens: {TRUSTED}")
    )
    number: int = field(default=0, metadata={"within": (0, 0xFFFF), **description("that these have, and no robot")})
    board: str = field(default="", metadata=description("what phalanx keys provision wrote for that number"))
    packets: Literal["plain", "sealed"] = field(default="plain", metadata=description("as the robots' radios have it"))

    def __post_init__(self) -> None:
        check_limits(self)
        numbers = [each.robot for each in self.robots]
        if not numbers or len(set(numbers)) < len(numbers):
            raise UsageError("robots are none, or one is there twice", "each robot once")
        if bool(self.trusted) != bool(self.number) or self.number in numbers:
            raise UsageError(f"trusted nodes of number {self.number}", "trusted with a number that no robot has")
        if self.packets == "sealed" and not self.trusted:
            raise UsageError("packets: sealed, without trusted", "a gateway's own nodes seal what it says")


@dataclass(frozen=True, slots=True)
class SwarmSettings:
    """A swarm's file as it was read, where it lies, and what it names."""

    said: SwarmFile
    path: Path
    scenario: Scenario
    mission: int

    @property
    def own(self) -> RobotSettings | None:
        """The gateway as if it were a robot, if it has trusted nodes."""
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

    def signer(self, key: Ed25519PrivateKey, who: int) -> Signer:
        """Load the signer with that key. Raises: UsageError: the mission names another key."""
        name = ("gateway_key", "operator_key")[who]
        signer = Signer(key, self.mission, who)
        if signer.public.hex() != getattr(self.scenario, name).lower():
            raise UsageError(
                f"{self.said.mission} names another {name} than {signer.public.hex()}", "phalanx keys list"
            )
        return signer


def read_swarm(path: Path) -> SwarmSettings:
    """The swarm in a file. Raises: UsageError: none, or with a mistake in a line; Unavailable: it cannot be read."""
    said: SwarmFile = Reader(str(path), HINT).root(SwarmFile, read_at_most(path, MOST_BYTES, HINT), "swarm file")
    scenario = mission_in(path.parent, said.mission)
    if scenario.controller != WHEELS:
        raise UsageError(f"{said.mission} has controller: {scenario.controller}", "wheels: the others obey no orders")
    if said.packets == "sealed":
        scenario = with_room_for_seals(scenario)
    signed_for(path.parent / said.key, scenario, said.mission)
    mission = {read_mission_key(path.parent / said.key, each.robot).seq for each in said.robots}
    return SwarmSettings(said, path, scenario, mission.pop())
