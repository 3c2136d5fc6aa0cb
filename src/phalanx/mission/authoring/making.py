"""What compiling means in both profiles: numbering, headers, and the bytes of what the author says will be seen."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError
from phalanx.mission.file.canonical import Shape, canonical, place_bytes, shape_of
from phalanx.mission.file.records import (
    FINAL,
    FOREVER_S,
    JOIN,
    OPEN_START,
    REPEATABLE,
    ROAM,
    START,
    EncodedMission,
    Header,
    Profile,
)
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.observable import (
    Action,
    Landmark,
    Message,
    Observable,
    Offset,
    Position,
    Sensor,
    Time,
    cell_of,
    offset_of,
    window_of,
)
from phalanx.mission.walk.gate import StartKey

Random = Callable[[int], bytes]
Spread = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
PAPER_CODING = CodingConfig()
# Sealed cells are large, for every try costs 10 ms: 9 of them cover +-0.6 m.
SEALED_CODING = CodingConfig(delta_mm=400)
# A robot takes what it knows of places for exact to `MissionConfig.sight_m`; with more fixes are false.
OFFSET_LIMIT_MM = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Who may run a mission, and when."""

    profile: Profile = Profile.SEALED
    robots: tuple[int, ...] = ()  # ids; empty is any
    valid_from_s: int = 0  # on the mission's clock
    valid_to_s: int = FOREVER_S  # likewise
    open_start: bool = False  # put the start key into the file (sealed profile): anybody may begin
    offset_mm: int = 1  # offsets of places are rounded to multiples of so much

    def __post_init__(self) -> None:
        if not 0 <= self.valid_from_s < self.valid_to_s <= FOREVER_S:
            raise UsageError(f"valid from {self.valid_from_s} to {self.valid_to_s}", "the end after the beginning")
        if any(not 0 <= robot < 1 << 16 for robot in self.robots) or len(set(self.robots)) > 255:
            raise UsageError(f"robots {self.robots}", "at most 255 ids of 0 to 65535")
        if self.open_start and self.profile is Profile.PAPER:
            raise UsageError("an open start in the paper profile", "it has no start key: every node can be tried")
        if not 1 <= self.offset_mm <= OFFSET_LIMIT_MM:
            raise UsageError(f"offsets rounded to {self.offset_mm} mm", f"1 to {OFFSET_LIMIT_MM}")


@dataclass(frozen=True, slots=True)
class Built:
    """One robot's half of a mission: the file (unsigned yet), and the key that starts it."""

    part: str
    mission: EncodedMission
    key: StartKey


class Maker(ABC):
    """What both profiles share: numbering, headers, offsets."""

    def __init__(self, mission: Mission, options: BuildOptions, random: Random) -> None:
        default = PAPER_CODING if options.profile is Profile.PAPER else SEALED_CODING
        self.coding = mission.coding or default
        self.mission = mission
        self.options = options
        self.random = random
        self.sent = {name: node for node in mission.nodes for name in node.send}
        self.before: dict[str, list[PlainWay]] = {}
        for way in mission.ways:
            self.before.setdefault(way.target, []).append(way)
        waited = dict.fromkeys(name for node in mission.nodes for name in node.wait)
        # Nobody in the mission sends these: a controller does, and finds them in the key file.
        self.external = {name: random(32) for name in waited if name not in self.sent}

    @abstractmethod
    def part(self, part: str, spread: Spread) -> Built:
        """One robot's half."""

    def header(self, nodes: list[Node], shapes: Iterable[Shape] = ()) -> Header:
        """The header of a part, with an id of its own."""
        flags = REPEATABLE * self.mission.repeatable | ROAM * self.mission.roam | OPEN_START * self.options.open_start
        return Header(
            self.options.profile,
            self.random(16),
            self.coding,
            len(nodes),
            flags,
            self.options.valid_from_s,
            self.options.valid_to_s,
            tuple(sorted(set(self.options.robots))),
            tuple(sorted(set(shapes), key=lambda shape: shape.code)),
        )

    def numbered(self, part: str) -> tuple[list[Node], dict[str, int], list[list[PlainWay]]]:
        """(nodes, number by name, ways out of each node by ascending target) of a part."""
        nodes = [node for node in self.mission.nodes if node.part == part]
        number = {node.name: i for i, node in enumerate(nodes)}
        out: list[list[PlainWay]] = [[] for _ in nodes]
        for way in self.mission.ways:
            if way.source in number:
                out[number[way.source]].append(way)
        for ways in out:
            ways.sort(key=lambda way: number[way.target])
        return nodes, number, out

    def offset(self, alias: tuple[Observable, ...]) -> Offset:
        """Where the cells of an alias are counted from."""
        return alias_offset(self.coding, alias, self.options.offset_mm)

    @staticmethod
    def flags(node: Node) -> int:
        """As stored."""
        return START * node.start | FINAL * node.final | JOIN * node.join

    @staticmethod
    def common(node: Node) -> tuple[int, int, int, int]:
        """flags, timeout_s, reach_dm and sends of a record."""
        return Maker.flags(node), node.timeout_s, math.ceil(node.within_m * 10), len(node.send)


def place_of(alias: tuple[Observable, ...]) -> Landmark | Position | None:
    """The one place in a conjunction, if it has one."""
    return next((thing for thing in alias if isinstance(thing, Landmark | Position)), None)


def observed_bytes(
    coding: CodingConfig,
    alias: tuple[Observable, ...],
    offset: Offset,
    *,
    do: Action | None = None,
    messages: Iterable[bytes] = (),
    previous: bytes | None = None,
) -> bytes:
    """Canonical bytes of what the author says will be experienced."""
    place = place_of(alias)
    where = b""
    if place is not None:
        landmark = place if isinstance(place, Landmark) else None
        where = place_bytes(
            shape_of((place,)),
            cell_of(coding, offset, place.x_m, place.y_m, landmark),
            landmark.text if landmark else None,
        )
    actions = [thing for thing in alias if isinstance(thing, Action)] or ([] if do is None else [do])
    windows = [window_of(coding, thing.t_s) for thing in alias if isinstance(thing, Time)]
    return canonical(
        where,
        sensors=[thing.value for thing in alias if isinstance(thing, Sensor)],
        action=actions[0] if actions else None,
        window=windows[0] if windows else None,
        messages=[*messages, *(thing.value for thing in alias if isinstance(thing, Message))],
        previous=previous,
    )


def alias_offset(coding: CodingConfig, alias: tuple[Observable, ...], rounded_mm: int = 1) -> Offset:
    """Where the cells of an alias are counted from, rounded to multiples within half a cell."""
    place = place_of(alias)
    if place is None:
        return Offset()
    exact = offset_of(coding, place)
    most = (coding.delta_mm + 1) // 2 // rounded_mm * rounded_mm
    x, y = (max(-most, min(most, round(value / rounded_mm) * rounded_mm)) for value in exact[:2])
    return exact._replace(x=x, y=y)


def direction_of(way: PlainWay, source: tuple[float, float] | None, target: tuple[float, float] | None) -> float | None:
    """The way's direction, map frame, or None if it has none."""
    if way.direction_rad is not None:
        return way.direction_rad
    if source is None or target is None:
        return None
    dx, dy = target[0] - source[0], target[1] - source[1]
    return math.atan2(dy, dx) if dx or dy else None
