"""Mission for a fleet in a building: files, start keys, start poses, and codes and beacons that the mission adds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from phalanx.errors import UsageError, did_you_mean
from phalanx.mission import Action, Built, EncodedMission, Landmark, Mission, Position, Sensor, StartKey
from phalanx.mission.landmarks import FloorPlan, WallCode
from phalanx.mission.landmarks.floorplan import Beacon
from phalanx.mission.observable import Observable
from phalanx.world.building.odometry import DiffDriveConfig, Pose

from .setup import DOES, MissionRun, Part, actions_of, doing, pool_of

CODE_HEIGHT_M, CODE_EDGE_M = 0.3, 0.12
BEACON_M = 2.0  # range of a beacon that is added at a node that requires its reading
LONE = "robot"  # name of robots whose mission has one part
NORTH_RAD = math.pi / 2
File = tuple[EncodedMission, StartKey | None]


@dataclass(frozen=True, slots=True)
class Orders:
    """Mission files, start poses and building of a fleet."""

    name: str
    plan: FloorPlan  # the building, with the codes that the mission adds
    parts: tuple[Part, ...]  # robot i gets part i modulo their number
    pool: tuple[Action, ...] = ()
    controller: tuple[bytes, ...] = ()  # messages that a controller sends when the robots start
    plain: Mission | None = None  # source of the files, if known

    def run(self, **settings: Any) -> MissionRun:
        """Return the run for these robots, by default one for each part.

        Raises: UsageError: a value is out of range.
        """
        given = {"plan": self.plan, "parts": self.parts, "pool": self.pool, "controller": self.controller}
        return MissionRun(**{"robots": len(self.parts), **given, **settings})


def orders_of(plain: Mission, built: Sequence[Built], plan: FloorPlan) -> Orders:
    """Return the orders for a mission, built from its source.

    Args:
        built: a file and a key for each part, in order.
    Raises: UsageError: no room for a robot at a start pose, or no source for a required sensor reading.
    """
    return orders_of_files(plain.name, [(each.mission, each.key) for each in built], plan, plain)


def orders_of_files(
    name: str, files: Sequence[File], plan: FloorPlan, plain: Mission | None = None, start: Pose | None = None
) -> Orders:
    """Return the orders for encoded missions.

    Args:
        files: one for each part, with its start key.
        plain: source of the files, with the parts in the same order. It determines start poses, codes on the walls and
            the robots' actions; without it only the files' content is known.
        start: start pose of all robots; None is the start of each part, or of the building.
    Raises: UsageError: no room for a robot, no source for a reading, or the numbers of files and parts differ.
    """
    if start is not None and not _has_room(plan, start[0], start[1]):
        x0, y0, x1, y1 = plan.bounds
        raise UsageError(
            f"no robot can stand at ({start[0]:g}, {start[1]:g}) in {plan.name}",
            f"choose a free position away from walls, x {x0:g} to {x1:g}, y {y0:g} to {y1:g} m",
        )
    messages = tuple(message for _, key in files if key for message in key.messages.values())
    if plain is None:
        begin = start or start_of(plan)
        return Orders(name, plan, tuple(Part(*file, begin) for file in files), (), messages)
    if len(files) != len(plain.parts):
        raise UsageError(
            f"{len(files)} encoded files for {plain.name!r}, which has {len(plain.parts)} parts",
            "give one file for each part, in the order in which they were built",
        )
    plan = with_fixtures(plan, plain)
    check_sensed(plan, plain)
    doings = set(_doings(plain))
    is_watched = any(not doings.isdisjoint(_readings(alias)) for node in plain.nodes for alias in node.see)
    starts = [start or _start(plain, part, plan) for part in plain.parts]
    names = [_title(plain, part) if is_watched else "" for part in plain.parts]
    parts = tuple(Part(*file, begin, title) for file, begin, title in zip(files, starts, names, strict=True))
    return Orders(name, plan, parts, pool_of(plain), messages, plain)


def start_of(plan: FloorPlan) -> Pose:
    """Return the start pose in a building. Raises: UsageError: the floor plan has none."""
    if plan.start is None:
        raise UsageError(f"{plan.name} has no start pose", "add start_pose: [x, y, heading] to the map")
    return plan.start


def _start(plain: Mission, part: str, plan: FloorPlan) -> Pose:
    """Return the start pose of a part's robots: at its first start node, or the map's if that has no position."""
    node = next(node for node in plain.nodes if node.start and node.part == part)
    if node.place is None:
        return start_of(plan)
    if not _has_room(plan, *node.place):
        raise UsageError(
            f"no robot can stand at {node.name!r}, where the mission starts", "start at a position away from walls"
        )
    return (*node.place, plan.start[2] if plan.start else NORTH_RAD)


def _has_room(plan: FloorPlan, x_m: float, y_m: float) -> bool:
    return plan.inside(x_m, y_m) and plan.clearance_m(x_m, y_m) >= DiffDriveConfig().radius_m


def with_fixtures(plan: FloorPlan, plain: Mission) -> FloorPlan:
    """Return the floor plan with the mission's QR codes and beacons that the map lacks."""
    shown = {code.text for code in plan.codes}
    hung = [
        WallCode(thing.text, thing.x_m, thing.y_m, CODE_HEIGHT_M, thing.orientation_rad or 0.0, CODE_EDGE_M)
        for node in plain.nodes
        for alias in node.see
        for thing in alias
        if isinstance(thing, Landmark) and thing.text is not None and thing.text not in shown
    ]
    known = {*(source.reading for source in plan.sources), *_doings(plain)}
    put = [
        Beacon(reading=reading, x_m=thing.x_m, y_m=thing.y_m, range_m=BEACON_M)
        for node in plain.nodes
        for alias in node.see
        for thing in alias
        if isinstance(thing, Landmark | Position)
        for reading in _readings(alias)
        if reading not in known and not _is_of_robot(plain, reading)
    ]
    if not hung and not put:
        return plan
    return replace(plan, codes=(*plan.codes, *hung), sources=(*plan.sources, *dict.fromkeys(put)))


def _readings(alias: tuple[Observable, ...]) -> list[str]:
    """Return the required readings of sensors other than lidar and camera."""
    return [thing.value.decode(errors="replace") for thing in alias if isinstance(thing, Sensor)]


def _title(plain: Mission, part: str) -> str:
    """Return the name by which other robots know robots on this part."""
    return part if len(plain.parts) > 1 else LONE


def _doings(plain: Mission) -> list[str]:
    """Return the readings for actions of a mission that robots can see each other do."""
    return [doing(_title(plain, part), act.name) for part in plain.parts for act in actions_of(plain, [part])]


def check_sensed(plan: FloorPlan, plain: Mission) -> None:
    """Check that robots can sense each node of a mission in this building. Raises: UsageError."""
    doings = _doings(plain)
    known = {source.reading for source in plan.sources} | {*doings}
    for node in plain.nodes:
        missing = [next((each for each in _readings(alias) if each not in known), None) for alias in node.see]
        if None in missing or not (reading := next(iter(missing), None)):
            continue
        hint = "add a position in see, beacons or quantities to the map, or use PART does ACTION"
        if _is_of_robot(plain, reading):
            hint = did_you_mean(reading, doings) + f"use {', '.join(dict.fromkeys(doings)) or 'nothing'}"
        raise UsageError(f"{node.name!r} requires the reading {reading!r}, which has no source in {plan.name}", hint)


def _is_of_robot(plain: Mission, reading: str) -> bool:
    part, does, _ = reading.partition(DOES)
    return bool(does) and part in {_title(plain, part) for part in plain.parts}
