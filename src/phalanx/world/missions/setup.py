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
    """Part of one robot: an encoded mission, its start key and the start pose."""

    mission: EncodedMission
    key: StartKey | None
    start: Pose
    name: str = ""  # by which other robots know one on this part when they see what it does; "" if none looks


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRun:
    """All that decides a run.

    Raises: UsageError: a value is out of range, or audits cannot show what the mission needs.
    """

    plan: FloorPlan  # the building; its walls do not stop radio
    parts: tuple[Part, ...]  # of the mission; robot i gets part i modulo their number
    robots: int = 1
    defence: str = "none"  # "none", "paper" or "hardened": whether, and by which protocol, robots audit each other
    f_max: int = 1  # the most compromised robots that audits tolerate
    # Of their odometry
    noise: OdometryNoise = OdometryNoise()  # noqa: RUF009  # frozen
    seed: int = 0
    begin_s: float = 0.0  # the mission's clock when it starts
    apart_s: float = 0.0  # from one robot's setting out to the next's, on the same part
    duration_s: float = 1800.0  # robots that are not done by then have not completed
    pool: tuple[Action, ...] = ()
    # Messages that a controller sends when the robots start, from a station in the middle
    controller: tuple[bytes, ...] = ()
    meet_m: float = 0.0  # robots so near that see each other exchange what they decoded; 0 is never
    keep_trace: bool = False  # keep where robots were at every step
    # How robots see
    lidar: LidarConfig = LidarConfig()  # noqa: RUF009  # frozen
    people: int = 0  # who walk about, are seen by lidars and hide codes; robots stop when they touch one
    # How hard robots try
    config: MissionConfig = MissionConfig()  # noqa: RUF009  # frozen
    liars: Mapping[int, MakeLiar] = field(default_factory=dict)  # what makes a compromised robot, by number

    def __post_init__(self) -> None:
        if not 1 <= self.robots <= ROBOTS_MAX:
            raise UsageError(f"{self.robots} robots", f"1 to {ROBOTS_MAX}")
        if not 0 < self.duration_s <= 86_400:
            raise UsageError(f"a run of {self.duration_s} s", "up to a day")
        if self.seed < 0:
            raise UsageError(f"seed {self.seed}", "0 or more")
        if not 0 <= self.people <= PEOPLE_MAX:
            raise UsageError(f"{self.people} people", f"0 to {PEOPLE_MAX}")
        if self.defence not in DEFENCES:
            raise UsageError(f"no defence {self.defence!r}", f"one of {', '.join(DEFENCES)}")
        if not self.alone and self.robots > IN_HEARING_MAX:
            raise UsageError(f"{self.robots} robots that hear each other", f"up to {IN_HEARING_MAX}")
        if self.audited:
            check_count(self.robots, self.f_max)
            if self.meet_m:
                raise UsageError("what robots tell each other when they meet cannot be audited yet", "--defence none")

    @property
    def audited(self) -> bool:
        """Return whether robots audit each other."""
        return self.defence != "none"

    @property
    def alone(self) -> bool:
        """Return whether no robot can hear another, or is to see what another does."""
        says = any(node.sends for part in self.parts for node in part.mission.nodes)
        sees = any(part.name for part in self.parts)
        return not (self.audited or self.meet_m or says or sees)

    def part_of(self, number: int) -> Part:
        """Return a robot's part."""
        return self.parts[number % len(self.parts)]


def doing(who: str, action: str) -> str:
    """Return the sensor reading of another robot, on part `who`, that does something: S_ij.

    Source: Encoded graphs Fig. 5 (sensor data at robot i, describing robot j's actions).
    """
    return f"{who}{DOES}{action}"


def check_count(robots: int, f_max: int) -> None:
    """Do nothing if so many robots can get tokens from each other on missions.

    Raises: UsageError: there are too few for each to get its tokens from the others, or too many.
    """
    least = tokens_of(f_max) + 1
    if robots < least:
        who = "1 robot" if robots == 1 else f"{robots} robots"
        hint = f"at least {least}; or --defence none"
        raise UsageError(f"{who} cannot audit each other with f_max {f_max}", hint)
    if robots > AUDITED_MAX:
        hint = f"at most {AUDITED_MAX}; or --defence none"
        raise UsageError(f"{robots} robots on missions cannot audit each other in time", hint)


def pool_of(plain: Mission) -> tuple[Action, ...]:
    """The actions that a mission's author counts on: what robots must be capable of, without where or when."""
    return tuple(dict.fromkeys(actions_of(plain, plain.parts)))


def actions_of(plain: Mission, parts: Container[str]) -> list[Action]:
    """Return the actions that a mission asks of robots on some of its parts."""
    nodes = {node.name: node for node in plain.nodes if node.part in parts}
    done: list[Action] = []
    for node in nodes.values():
        done += [thing for alias in node.see for thing in alias if isinstance(thing, Action)]
        done += [node.do] if node.do else []
    return [*done, *(way.do for way in plain.ways if way.do and way.source in nodes)]
