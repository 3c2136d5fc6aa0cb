"""A mission as robots in a building get it: files, start keys, where they begin, and what hangs on the walls."""

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
BEACON_M = 2.0  # range of one that stands where a mission wants its reading
LONE = "robot"  # what those are called whose mission has one part
NORTH_RAD = math.pi / 2
File = tuple[EncodedMission, StartKey | None]


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders of a fleet."""

    name: str
    plan: FloorPlan  # the building, with the codes that the mission's author hung on its walls
    parts: tuple[Part, ...]  # robot i gets part i modulo their number
    pool: tuple[Action, ...] = ()
    controller: tuple[bytes, ...] = ()  # messages that a controller sends when the robots start
    plain: Mission | None = None  # what the files were built from, if that is known here

    def run(self, **how: Any) -> MissionRun:
        """The run in which robots live it; one for each part if nothing else is said.

        Raises: UsageError: a value is out of range.
        """
        given = {"plan": self.plan, "parts": self.parts, "pool": self.pool, "controller": self.controller}
        return MissionRun(**{"robots": len(self.parts), **given, **how})


def orders_of(plain: Mission, built: Sequence[Built], plan: FloorPlan) -> Orders:
    """Return the orders for a mission, built from its source.

    Args:
        built: a file and a key for each of its parts, in their order.
    Raises: UsageError: robots cannot be put where a part begins, or lack a sensor that it wants.
    """
    return orders_of_files(plain.name, [(each.mission, each.key) for each in built], plan, plain)


def orders_of_files(
    name: str, files: Sequence[File], plan: FloorPlan, plain: Mission | None = None, start: Pose | None = None
) -> Orders:
    """Return the orders for encoded missions.

    Args:
        files: one for each part, with its start key.
        plain: what the files were built from, in the order of its parts: it says where robots begin, what hangs on the
            walls and what robots can do. Without it nobody here knows more than the files say.
        start: where all robots are put; None is where each part begins, or where the building says.
    Raises: UsageError: robots cannot be put there, lack a sensor, or there are more or fewer files than parts.
    """
    if start is not None and not _has_room(plan, start[0], start[1]):
        x0, y0, x1, y1 = plan.bounds
        raise UsageError(
            f"no robot can stand at ({start[0]:g}, {start[1]:g}) in {plan.name}",
            f"a free place away from walls, x {x0:g} to {x1:g}, y {y0:g} to {y1:g} m",
        )
    messages = tuple(message for _, key in files if key for message in key.messages.values())
    if plain is None:
        begin = start or start_of(plan)
        return Orders(name, plan, tuple(Part(*file, begin) for file in files), (), messages)
    if len(files) != len(plain.parts):
        raise UsageError(
            f"encoded files: {len(files)}, and {plain.name!r} is built into {len(plain.parts)}",
            "one file for each part, in the order in which they were built",
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
    """Return the start pose in a building. Raises: UsageError: it names none."""
    if plan.start is None:
        raise UsageError(f"{plan.name} does not say where robots begin", "start_pose: [x, y, heading] in the map")
    return plan.start


def _start(plain: Mission, part: str, plan: FloorPlan) -> Pose:
    """Return the pose of a part's robots: its first start node, or the map's start if that has no place."""
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
    """The building with what its author put there and the map does not show: QR codes on walls, beacons at nodes."""
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
    """Return the name under which others observe robots on a part."""
    return part if len(plain.parts) > 1 else LONE


def _doings(plain: Mission) -> list[str]:
    """Return the actions that robots can see each other do in a mission."""
    return [doing(_title(plain, part), act.name) for part in plain.parts for act in actions_of(plain, [part])]


def check_sensed(plan: FloorPlan, plain: Mission) -> None:
    """Nothing, if robots can sense each node of a mission in this building, furnished for it. Raises: UsageError."""
    doings = _doings(plain)
    known = {source.reading for source in plan.sources} | {*doings}
    for node in plain.nodes:
        missing = [next((each for each in _readings(alias) if each not in known), None) for alias in node.see]
        if None in missing or not (reading := next(iter(missing), None)):
            continue
        hint = "a place beside it in see; beacons or quantities in the map; or what a robot does: PART does ACTION"
        if _is_of_robot(plain, reading):
            hint = did_you_mean(reading, doings) + f"robots do {', '.join(dict.fromkeys(doings)) or 'nothing'}"
        raise UsageError(f"{node.name!r} wants the reading {reading!r}, and nothing in {plan.name} gives it", hint)


def _is_of_robot(plain: Mission, reading: str) -> bool:
    who, does, _ = reading.partition(DOES)
    return bool(does) and who in {_title(plain, part) for part in plain.parts}
