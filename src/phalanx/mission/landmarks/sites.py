"""Extract the landmarks of a floor plan, as robots will recognise them in scans of the building.

The rules are those for scans (`corners`, `features`), applied to outlines instead of beams.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from phalanx.config.lidar import ExtractionConfig
from phalanx.mission.observable import Landmark

from .floorplan import FloorPlan
from .outlines import Outline

# Jambs may be slanted by this: the ends of walls that are two cells thick are.
FACE_M = 0.25
# Doorways closer than this are one, found from both sides of the wall.
SAME_M = 0.25
SHOWN_M = 0.05  # largest distance between a landmark in a mission and the one of the plan that it stands for


@dataclass(frozen=True, slots=True)
class Site:
    """A landmark with its aliases: the forms in which it can be seen."""

    # A corner has an alias for each wall, a room one for each three consecutive corners
    aliases: tuple[Landmark, ...]
    width_m: float = 0.0  # width of a doorway, else 0

    @property
    def type(self) -> str:
        """Return the type of the landmark."""
        return self.aliases[0].type

    @property
    def place_m(self) -> tuple[float, float]:
        """Return the mean of the aliases' places, map frame."""
        count = len(self.aliases)
        return sum(alias.x_m for alias in self.aliases) / count, sum(alias.y_m for alias in self.aliases) / count


@dataclass(frozen=True, slots=True)
class _Corner:
    """A corner of an outline: its place, and direction, length and visibility of both walls."""

    at: tuple[float, float]
    before: tuple[float, float]
    after: tuple[float, float]
    before_m: float
    after_m: float
    before_seen: bool
    after_seen: bool
    sine: float
    cosine: float


def is_shown(thing: Landmark, sites: Iterable[Site]) -> bool:
    """Return True if one of the sites is a landmark of this type at this place."""
    same = (other for site in sites for other in site.aliases if other.type == thing.type)
    return any(abs(other.x_m - thing.x_m) <= SHOWN_M and abs(other.y_m - thing.y_m) <= SHOWN_M for other in same)


def look_alikes_of(plan: FloorPlan) -> tuple[Landmark, ...]:
    """Return all landmarks that robots may detect: those of the plan, and jambs of doorways that are seen in part."""
    config = plan.extraction
    sites = landmarks_of(plan)
    corners = (corner for outline in plan.outlines for corner in _corners(outline) if _is_concave(corner, config))
    jambs = (alias for corner in corners for alias in _concave_site(corner, config).aliases)
    return (*(alias for site in sites for alias in site.aliases), *jambs)


def landmarks_of(plan: FloorPlan, config: ExtractionConfig | None = None) -> tuple[Site, ...]:
    """Return the landmarks of a floor plan: doorways, rooms, concave corners except jambs, convex corners, QR codes.

    Source: Encoded graphs §V-A; docs/spec/mission.md.
    """
    config = config or plan.extraction
    chains = [list(_corners(outline)) for outline in plan.outlines]
    everywhere = [corner for chain in chains for corner in chain]
    concave = [corner for corner in everywhere if _is_concave(corner, config)]
    doors, jambs = _doorways(plan, concave, config)
    rooms = [room for chain in chains for room in _rooms(plan, chain, config)]
    ends = [_concave_site(corner, config) for corner in concave if corner.at not in jambs]
    convex = [_convex_site(corner) for corner in everywhere if _is_convex(corner, config)]
    codes = [Site((Landmark("qr", code.x_m, code.y_m, code.facing_rad, text=code.text),)) for code in plan.codes]
    return tuple(site for site in (*doors, *rooms, *_merged(ends), *convex, *codes) if site.aliases)


def _corners(outline: Outline) -> Iterator[_Corner]:
    points, seen = outline.points.tolist(), outline.seen.tolist()
    sides = []
    for (x, y), (next_x, next_y) in pairwise([points[-1], *points, points[0]]):
        length_m = max(math.hypot(next_x - x, next_y - y), 1e-9)
        sides.append(((next_x - x) / length_m, (next_y - y) / length_m, length_m))
    for i, ((bx, by, before_m), (ax, ay, after_m)) in enumerate(pairwise(sides)):
        sine, cosine = bx * ay - by * ax, bx * ax + by * ay
        yield _Corner(tuple(points[i]), (bx, by), (ax, ay), before_m, after_m, seen[i - 1], seen[i], sine, cosine)


def _is_convex(corner: _Corner, config: ExtractionConfig) -> bool:
    return (
        corner.sine >= math.sin(config.corner_min_rad)
        and corner.before_seen
        and corner.after_seen
        and min(corner.before_m, corner.after_m) >= config.wall_min_m
    )


def _is_concave(corner: _Corner, config: ExtractionConfig) -> bool:
    turns_right = corner.sine <= -math.sin(config.corner_min_rad)
    # At the end of a wall without thickness the outline turns back.
    turns_back = abs(corner.sine) < math.sin(config.corner_min_rad) and corner.cosine < 0
    return (turns_right or turns_back) and (corner.before_seen or corner.after_seen)


def _doorways(
    plan: FloorPlan, concave: list[_Corner], config: ExtractionConfig
) -> tuple[list[Site], set[tuple[float, float]]]:
    """Return the doorways, and the places of the corners that are their jambs."""
    sites: list[Site] = []
    jambs: set[tuple[float, float]] = set()
    straight = math.cos(config.door_bend_rad)
    places = np.array([corner.at for corner in concave]).reshape(-1, 2)
    for a in concave:
        if not a.before_seen or a.before_m < config.wall_min_m:
            continue
        away = np.hypot(places[:, 0] - a.at[0], places[:, 1] - a.at[1])
        for j in np.flatnonzero((away >= config.door_min_m - 1e-9) & (away <= config.door_max_m + 1e-9)):
            b = concave[j]
            if not b.after_seen or b.after_m < config.wall_min_m:
                continue
            x, y, width = (b.at[0] - a.at[0]), (b.at[1] - a.at[1]), float(away[j])
            if min(a.before[0] * x + a.before[1] * y, b.after[0] * x + b.after[1] * y) < straight * width:
                continue
            if not (plan.sees(a.at, b.at) and plan.is_clear(a.at, b.at, FACE_M, 0.0, config.door_clear_m)):
                continue
            depth = max(_face_depth(a.sine, a.after_m, config), _face_depth(b.sine, b.before_m, config))
            along_x = a.before_m * a.before[0] + b.after_m * b.after[0]
            along_y = a.before_m * a.before[1] + b.after_m * b.after[1]
            length = math.hypot(along_x, along_y)
            # Free space is on the left, the middle of the wall's thickness on the right.
            door = Landmark(
                "doorway",
                0.5 * (a.at[0] + b.at[0]) + 0.5 * depth * along_y / length,
                0.5 * (a.at[1] + b.at[1]) - 0.5 * depth * along_x / length,
                math.atan2(along_y, along_x) % math.pi,
            )
            jambs |= {a.at, b.at}
            if not any(math.hypot(s.aliases[0].x_m - door.x_m, s.aliases[0].y_m - door.y_m) < SAME_M for s in sites):
                sites.append(Site((door,), width))
    return sites, jambs


def _face_depth(sine: float, length_m: float, config: ExtractionConfig) -> float:
    return length_m if sine <= -math.sin(config.corner_min_rad) and length_m <= config.door_depth_m else 0.0


def _concave_site(corner: _Corner, config: ExtractionConfig) -> Site:
    # Free space is on the left: a robot there sees the left end of the wall before the corner.
    walls = (
        ("concave_left", corner.before, corner.before_m, corner.before_seen),
        ("concave_right", corner.after, corner.after_m, corner.after_seen),
    )
    return Site(
        tuple(
            Landmark(kind, *corner.at, math.atan2(x, -y))
            for kind, (x, y), length, seen in walls
            if seen and length >= config.wall_min_m
        )
    )


def _merged(sites: list[Site]) -> list[Site]:
    """Merge sites at the same place: where two walls meet tip to tip, several outlines have a corner."""
    merged: dict[tuple[float, float], Site] = {}
    for site in sites:
        if site.aliases:
            at = (site.aliases[0].x_m, site.aliases[0].y_m)
            known = merged.get(at, Site(()))
            merged[at] = replace(known, aliases=(*known.aliases, *site.aliases))
    return list(merged.values())


def _convex_site(corner: _Corner) -> Site:
    x = -corner.before[1] - corner.after[1]
    y = corner.before[0] + corner.after[0]
    return Site((Landmark("corner_convex", *corner.at, math.atan2(y, x)),))


def _rooms(plan: FloorPlan, chain: list[_Corner], config: ExtractionConfig) -> Iterator[Site]:
    """Yield a room for each run of at least three convex corners."""
    convex = [_is_convex(corner, config) for corner in chain]
    if not chain or all(convex):
        # A closed room: visible only to robots that start inside.
        runs = [[*chain, *chain[:2]]] if chain else []
    else:
        first = convex.index(False)
        turned = groupby(chain[first:] + chain[:first], key=lambda corner: _is_convex(corner, config))
        runs = [list(run) for are_convex, run in turned if are_convex]
    for run in runs:
        places = [corner.at for corner in run]
        triangles = (_triangle(plan, *three, config) for three in zip(places, places[1:], places[2:], strict=False))
        yield Site(tuple(alias for alias in triangles if alias is not None))


def _triangle(
    plan: FloorPlan, a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], config: ExtractionConfig
) -> Landmark | None:
    area = 0.5 * abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    middle = ((a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3)
    if area < config.room_min_m2 or not all(plan.sees(middle, corner) for corner in (a, b, c)):
        return None
    return Landmark("room", *middle, area_m2=area)
