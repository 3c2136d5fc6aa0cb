"""How far each landmark of a mission is from the next thing that a robot might take for it.

A robot holds hashes and no map: that there is a second pillar half a metre on, it cannot know. Whoever compiles the
mission knows the building, and says of each landmark how far it stands alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from phalanx.config.mission import MissionConfig
from phalanx.mission.graph import Mission, Node
from phalanx.mission.landmarks import FloorPlan, look_alikes_of
from phalanx.mission.observable import HALF_TURN_TYPES, UNTOLD_M, Landmark, Observable, number_or_nan
from phalanx.mission.walk.finding import MIDDLE_M

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]

# Orientations that differ by less may be taken for one another: two bins of headings.
ALIKE_RAD = math.radians(30)
# What is nearer is the same thing, drawn twice, or seen at two places of a ragged map: the walker takes it for one too.
SAME_M = MissionConfig().agree_m / 2


def apart_in(plan: FloorPlan, mission: Mission) -> Mission:
    """The mission in a building that is known."""
    return told_apart(mission, look_alikes_of(plan))


def told_apart(mission: Mission, look_alikes: Iterable[Landmark] | None = None) -> Mission:
    """The mission whose landmarks say how far it is to the next thing that looks the same.

    Args:
        look_alikes: what else there is to be seen in the building; None: nobody knows, and what the landmarks say
            already holds, or UNTOLD_M, but for codes, which have a text of their own.
    """
    own = [thing for node in mission.nodes for alias in node.see for thing in alias if isinstance(thing, Landmark)]
    tables = _tables((*own, *(look_alikes or ())))

    def seen(thing: Observable) -> Observable:
        if not isinstance(thing, Landmark):
            return thing
        is_told = look_alikes is not None or thing.text is not None
        told = math.inf if is_told and thing.apart_m == UNTOLD_M else thing.apart_m
        return replace(thing, apart_m=min(told, _apart_m(thing, tables[thing.type, thing.text])))

    def of(node: Node) -> Node:
        return replace(node, see=tuple(tuple(seen(thing) for thing in alias) for alias in node.see))

    return replace(mission, nodes=tuple(of(node) for node in mission.nodes))


def alone(landmarks: Iterable[Landmark], others: Iterable[Landmark], least_m: float) -> list[Landmark]:
    """Those of the landmarks that stand at least so far from whatever looks the same, among them or the others."""
    landmarks = list(landmarks)
    tables = _tables((*landmarks, *others))
    return [each for each in landmarks if _apart_m(each, tables[each.type, each.text]) >= least_m]


def once(landmarks: Iterable[Landmark]) -> list[Landmark]:
    """The landmarks without those that are the same thing as one before: robots know it by the first name it has."""
    kept: dict[tuple[str, str | None], list[Landmark]] = {}
    for each in landmarks:
        same = kept.setdefault((each.type, each.text), [])
        if not any(_is_same(each, other) for other in same):
            same.append(each)
    return [each for alike in kept.values() for each in alike]


def is_written_twice(one: Landmark, other: Landmark) -> bool:
    """Whether these are the same thing, at two places: who knows the one takes the other for it, and never finds it."""
    alike = (one.type, one.text) == (other.type, other.text) and _is_same(one, other)
    return alike and math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) > MIDDLE_M


def _is_same(one: Landmark, other: Landmark) -> bool:
    away_m = math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)
    if one.orientation_rad is None or other.orientation_rad is None:
        return away_m <= SAME_M
    full = math.pi if one.type in HALF_TURN_TYPES else math.tau
    return away_m <= SAME_M and abs(math.remainder(one.orientation_rad - other.orientation_rad, full)) <= ALIKE_RAD


def _tables(landmarks: Iterable[Landmark]) -> dict[tuple[str, str | None], Rows]:
    """(n, 3) for each kind and text: places and orientations."""
    rows: dict[tuple[str, str | None], list[tuple[float, float, float]]] = {}
    for each in landmarks:
        row = (each.x_m, each.y_m, number_or_nan(each.orientation_rad))
        rows.setdefault((each.type, each.text), []).append(row)
    return {kind: np.array(table, np.float64) for kind, table in rows.items()}


def _apart_m(landmark: Landmark, rows: Rows) -> float:
    away = np.hypot(rows[:, 0] - landmark.x_m, rows[:, 1] - landmark.y_m)
    turn = rows[:, 2] - number_or_nan(landmark.orientation_rad)
    full = math.pi if landmark.type in HALF_TURN_TYPES else math.tau
    turned = np.abs(turn - full * np.round(turn / full)) > ALIKE_RAD  # not so where one has no orientation
    rivals = away[(away > SAME_M) & ~turned]
    return float(rivals.min()) if len(rivals) else math.inf
