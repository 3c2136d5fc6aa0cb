"""A mission as robots in a building get it: files, start keys, where they begin, and what hangs on the walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from phalanx.errors import UsageError
from phalanx.mission import Action, Built, EncodedMission, Landmark, Mission, StartKey
from phalanx.mission.landmarks import FloorPlan, WallCode

from .diffdrive import DiffDriveConfig
from .mission_run import Part, pool_of
from .odometry import Pose

CODE_HEIGHT_M, CODE_EDGE_M = 0.3, 0.12
NORTH_RAD = math.pi / 2


@dataclass(frozen=True, slots=True)
class Orders:
    """What a fleet is given.

    Args:
        name: for people.
        plan: the building, with the codes that the mission's author hung on its walls.
        parts: robot i gets part i modulo their number.
        pool: actions that the robots can do.
        controller: messages that a controller sends when the robots start.
    """

    name: str
    plan: FloorPlan
    parts: tuple[Part, ...]
    pool: tuple[Action, ...] = ()
    controller: tuple[bytes, ...] = ()


def orders_of(plain: Mission, built: Sequence[Built], plan: FloorPlan) -> Orders:
    """What robots are given of a mission whose author is asked.

    Args:
        plain: the mission.
        built: a file and a key for each of its parts, in their order.
        plan: the building.
    Raises: UsageError: robots cannot be put where a part begins.
    """
    parts = tuple(
        Part(each.mission, each.key, _start(plain, name, plan)) for each, name in zip(built, plain.parts, strict=True)
    )
    messages = tuple(message for each in built for message in each.key.messages.values())
    return Orders(plain.name, furnished(plan, plain), parts, pool_of(plain), messages)


def orders_of_file(name: str, mission: EncodedMission, key: StartKey | None, plan: FloorPlan) -> Orders:
    """What robots are given of an encoded mission, of which nobody here knows more than its file says.

    Raises: UsageError: the building does not say where robots begin.
    """
    messages = tuple(key.messages.values()) if key else ()
    return Orders(name, plan, (Part(mission, key, start_of(plan)),), (), messages)


def start_of(plan: FloorPlan) -> Pose:
    """Where robots begin in a building.

    Raises: UsageError: it does not say.
    """
    if plan.start is None:
        raise UsageError(f"{plan.name} does not say where robots begin", "start_pose: [x, y, heading] in the map")
    return plan.start


def _start(plain: Mission, part: str, plan: FloorPlan) -> Pose:
    """Where a part's robots are put: at its first start node; where the map says, if that is in no place."""
    node = next(node for node in plain.nodes if node.start and node.part == part)
    if node.place is None:
        return start_of(plan)
    if plan.clearance_m(*node.place) < DiffDriveConfig().radius_m or not plan.inside(*node.place):
        raise UsageError(
            f"no robot can stand at {node.name!r}, where the mission starts", "start at a position away from walls"
        )
    return (*node.place, plan.start[2] if plan.start else NORTH_RAD)


def furnished(plan: FloorPlan, plain: Mission) -> FloorPlan:
    """The building with the QR codes on its walls that the mission's author put there and the map does not show."""
    shown = {code.text for code in plan.codes}
    hung = [
        WallCode(thing.text, thing.x_m, thing.y_m, CODE_HEIGHT_M, thing.orientation_rad or 0.0, CODE_EDGE_M)
        for node in plain.nodes
        for alias in node.see
        for thing in alias
        if isinstance(thing, Landmark) and thing.text is not None and thing.text not in shown
    ]
    return replace(plan, codes=(*plan.codes, *hung)) if hung else plan
