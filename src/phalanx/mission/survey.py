"""A floor plan becomes a mission: explore every landmark that a robot can find there."""

from __future__ import annotations

import math
from collections import Counter

from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError

from .graph import Draft, Mission
from .landmarks.floorplan import FloorPlan
from .landmarks.sites import Site, landmarks_of
from .observable import Position

# Landmarks further apart are not in each other's sight for certain; ways that long are not straight.
WAY_LIMIT_M = 16.0
NEIGHBOURS = 6
# A way keeps so far from walls on both sides, but for its ends: landmarks lie in walls and on corners.
CLEARANCE_M = 0.3
END_M = 1.0
SHORT = {"doorway": "door", "corner_concave": "corner", "room": "room", "qr": "code"}


def survey(plan: FloorPlan, coding: CodingConfig | None = None) -> Mission:
    """The mission to visit all doorways, rooms, concave corners and codes of a floor plan.

    Convex corners are left out: every room has four, and tells them apart by more than each alone.

    Args:
        plan: with the pose where robots begin.
        coding: None is the profile's default.
    Raises: UsageError: it says not where robots begin, or has no landmarks.
    Source: Encoded graphs §IV-A, Fig. 6; none for which ways are taken (the six nearest in sight).
    """
    if plan.start is None:
        raise UsageError(f"{plan.name} does not say where robots begin", "start_pose: [x, y, heading] in the map")
    sites = [site for site in landmarks_of(plan) if site.type in SHORT]
    if not sites:
        raise UsageError(f"{plan.name} has no landmarks", "walls with doorways, rooms or free corners; or codes")
    x0, y0, x1, y1 = plan.bounds
    draft = Draft(f"explore {plan.name}", coding=coding, area_m=(x0, y0, x1, y1), floor_plan=plan.name)
    start = (plan.start[0], plan.start[1])
    draft.node("start", Position(*start), start=True)
    places = {"start": start}
    counts: Counter[str] = Counter()
    for site in sites:
        counts[site.type] += 1
        name = f"{SHORT[site.type]}{counts[site.type]}"
        draft.node(name, *site.aliases, width_m=site.width_m or None)
        places[name] = _place(site)
    for source, target in sorted(_pairs(plan, places)):
        draft.way(source, target, both=True)
    return draft.mission()


def _place(site: Site) -> tuple[float, float]:
    count = len(site.aliases)
    return sum(alias.x_m for alias in site.aliases) / count, sum(alias.y_m for alias in site.aliases) / count


def _pairs(plan: FloorPlan, places: dict[str, tuple[float, float]]) -> set[tuple[str, str]]:
    """Each place with its nearest neighbours in sight."""
    pairs: set[tuple[str, str]] = set()
    for name, place in places.items():
        near = sorted((math.dist(place, there), other) for other, there in places.items() if other != name)
        in_sight = (
            other
            for away, other in near
            if CLEARANCE_M < away <= WAY_LIMIT_M and _is_clear(plan, place, places[other], away)
        )
        for other, _ in zip(in_sight, range(NEIGHBOURS), strict=False):
            pairs.add((min(name, other), max(name, other)))
    return pairs


def _is_clear(plan: FloorPlan, a: tuple[float, float], b: tuple[float, float], away_m: float) -> bool:
    """Whether a robot can drive from near a to near b in a straight line."""
    along_x, along_y = (b[0] - a[0]) / away_m, (b[1] - a[1]) / away_m
    for side in (-CLEARANCE_M, 0.0, CLEARANCE_M):
        end = min(END_M, away_m / 4) if side else 0.0
        x, y = -side * along_y, side * along_x
        p = (a[0] + x + end * along_x, a[1] + y + end * along_y)
        q = (b[0] + x - end * along_x, b[1] + y - end * along_y)
        if not plan.sees(p, q):
            return False
    return True
