"""Set up a mission run: building, each robot's part, sensors, and audits."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field

from phalanx.bti.fleet import Fleet
from phalanx.bti.work import Work
from phalanx.config.bti import tokens_of
from phalanx.config.defence import DEFENCES
from phalanx.config.lidar import LidarConfig
from phalanx.config.mission import MissionConfig
from phalanx.errors import UsageError
from phalanx.mission import Action, EncodedMission, Mission, StartKey
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.robot import Robot
from phalanx.world.building.odometry import OdometryNoise, Pose
from phalanx.world.building.walkers import PEOPLE_MAX

ROBOTS_MAX, IN_HEARING_MAX = 1000, 300
AUDITED_MAX = 32  # in one radio range, each with a lidar of its own

DOES = " does "

MakeLiar = Callable[[Fleet, int, Work, Callable[[int], Controller]], Robot]


@dataclass(frozen=True, slots=True)
class Part:
    """Part of a mission for one robot: encoded mission, start key and start pose."""

    mission: EncodedMission
    key: StartKey | None
    start: Pose
    name: str = ""  # name in sensor readings of other robots that see its actions; "" if none does


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRun:
    """Settings that determine a run.

    Raises: UsageError: a value is out of range, or the mission needs something that cannot be audited.
    """

    plan: FloorPlan  # the building; its walls do not stop radio
    parts: tuple[Part, ...]  # robot i gets part i modulo their number
    robots: int = 1
    defence: str = "none"  # "none", "paper" or "hardened": the protocol by which robots audit each other
    f_max: int = 1  # largest number of compromised robots that audits tolerate
    # Error of the robots' odometry
    noise: OdometryNoise = OdometryNoise()  # noqa: RUF009  # frozen
    seed: int = 0
    begin_s: float = 0.0  # mission time at the start
    apart_s: float = 0.0  # time between the starts of two robots on the same part
    duration_s: float = 1800.0  # end of the run
    pool: tuple[Action, ...] = ()
    # Messages that a controller sends from a station in the middle when the robots start
    controller: tuple[bytes, ...] = ()
    meet_m: float = 0.0  # distance within which robots that see each other exchange proofs of decoded nodes; 0: never
    keep_trace: bool = False  # record the poses at every step
    # Lidar of the robots
    lidar: LidarConfig = LidarConfig()  # noqa: RUF009  # frozen
    people: int = 0  # walking people, who occlude walls and codes; robots stop on contact with them
    # Search effort of the robots
    config: MissionConfig = MissionConfig()  # noqa: RUF009  # frozen
    liars: Mapping[int, MakeLiar] = field(default_factory=dict)  # constructors of compromised robots, by number

    def __post_init__(self) -> None:
        if not 1 <= self.robots <= ROBOTS_MAX:
            raise UsageError(f"{self.robots} robots", f"use 1 to {ROBOTS_MAX}")
        if not 0 < self.duration_s <= 86_400:
            raise UsageError(f"a run of {self.duration_s} s", "use up to a day")
        if self.seed < 0:
            raise UsageError(f"seed {self.seed}", "use 0 or more")
        if not 0 <= self.people <= PEOPLE_MAX:
            raise UsageError(f"{self.people} people", f"use 0 to {PEOPLE_MAX}")
        if self.defence not in DEFENCES:
            raise UsageError(f"no defence {self.defence!r}", f"use one of {', '.join(DEFENCES)}")
        if not self.alone and self.robots > IN_HEARING_MAX:
            raise UsageError(f"{self.robots} robots in range of each other", f"use up to {IN_HEARING_MAX}")
        if self.audited:
            check_count(self.robots, self.f_max)
            if self.meet_m:
                raise UsageError("exchanges between robots that meet cannot be audited yet", "use --defence none")

    @property
    def audited(self) -> bool:
        """Return whether robots audit each other."""
        return self.defence != "none"

    @property
    def alone(self) -> bool:
        """Return whether all robots are independent: none communicates with others or sees their actions."""
        says = any(node.sends for part in self.parts for node in part.mission.nodes)
        sees = any(part.name for part in self.parts)
        return not (self.audited or self.meet_m or says or sees)

    def part_of(self, number: int) -> Part:
        """Return the part of a robot."""
        return self.parts[number % len(self.parts)]


def doing(part: str, action: str) -> str:
    """Return the sensor reading for another robot, on this part, that does an action: S_ij.

    Source: Encoded graphs Fig. 5 (sensor data at robot i, describing robot j's actions).
    """
    return f"{part}{DOES}{action}"


def check_count(robots: int, f_max: int) -> None:
    """Check that this number of robots can get enough tokens from each other on missions.

    Raises: UsageError: there are too few robots for each to get its tokens from the others, or too many.
    """
    least = tokens_of(f_max) + 1
    if robots < least:
        count = "1 robot" if robots == 1 else f"{robots} robots"
        hint = f"use at least {least}, or --defence none"
        raise UsageError(f"{count} cannot audit each other with f_max {f_max}", hint)
    if robots > AUDITED_MAX:
        hint = f"use at most {AUDITED_MAX}, or --defence none"
        raise UsageError(f"{robots} robots on missions cannot audit each other in time", hint)


def pool_of(plain: Mission) -> tuple[Action, ...]:
    """Return the actions that robots must be capable of for a mission, without place and time."""
    return tuple(dict.fromkeys(actions_of(plain, plain.parts)))


def actions_of(plain: Mission, parts: Container[str]) -> list[Action]:
    """Return the actions that a mission requires on some of its parts."""
    nodes = {node.name: node for node in plain.nodes if node.part in parts}
    done: list[Action] = []
    for node in nodes.values():
        done += [thing for alias in node.see for thing in alias if isinstance(thing, Action)]
        done += [node.do] if node.do else []
    return [*done, *(way.do for way in plain.ways if way.do and way.source in nodes)]
