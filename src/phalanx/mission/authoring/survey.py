"""A floor plan becomes a mission: explore every landmark that a robot can find there."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Container
from dataclasses import replace
from functools import partial

import numpy as np

from phalanx.config.lidar import LidarConfig
from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError
from phalanx.mission.graph import Draft, Mission
from phalanx.mission.landmarks.floorplan import FloorPlan
from phalanx.mission.landmarks.sites import Site, landmarks_of, look_alikes_of
from phalanx.mission.observable import Landmark, Position
from phalanx.mission.worth.feasible import look_ahead

from .apart import alone, told_apart
from .free import PASS_M, STAND_M, Free
from .sighted import sighted

# Landmarks further apart are not in each other's sight for certain; ways that long are not straight. Longer ones lead
# to what no others lead to, as the far end of a bare corridor, if a robot can be expected to know it there.
WAY_LIMIT_M, FAR_LIMIT_M = 16.0, 24.0
NEIGHBOURS = 6
# A way keeps so far from walls on both sides, but for its ends: landmarks lie in walls and on corners.
CLEARANCE_M = 0.3
END_M = 1.0
# And from a face that it runs along: where exactly its ends were seen decides nothing. At less there are other ways.
FACE_M, FACE_LONG_M = 0.05, 3.0
SIDES = [(-CLEARANCE_M, 0.0, CLEARANCE_M), *((k * FACE_M, k * CLEARANCE_M, 2 * k * CLEARANCE_M) for k in (1, -1))]
# Nor is a way much longer for who has a body than the straight line: no robot gets through behind a shelf that stands
# 0.1 m from its wall, and who goes around it does not come along the line.
DETOUR, DETOUR_M = 1.2, 1.0
# Where robots begin is looked for on a grid of so many places along the map's longer side, but no denser than this.
GRID_PLACES = 200
GRID_M = 0.05
NORTH_RAD = math.pi / 2
APART_M = 0.5  # of a landmark from the next thing that looks the same: a robot's doubt is not much less
START = "start"
TWO_SIDED = ("doorway", "room")
BEHIND = -0.1  # cosine, from the normal: who comes along a wall is before it, and a little more
SHORT = {"doorway": "door", "concave_left": "corner", "concave_right": "corner", "room": "room", "qr": "code"}

log = logging.getLogger(__name__)


def survey(plan: FloorPlan, coding: CodingConfig | None = None, lidar: LidarConfig | None = None) -> Mission:
    """The mission to visit all doorways, rooms, concave corners and codes of a floor plan that such a lidar shows.

    Convex corners are left out: every room has four, and tells them apart by more than each alone. So is, with a
    warning, what no way leads to from where robots begin: a mission with such nodes is never done. And so is what has
    something beside it that looks the same: no robot would know one from the other. Ways lead to each from the six
    nearest in sight that a robot comes from, on the side from which it is seen, and back. Longer ways lead to what no
    others lead to, if robots can be expected to find it there.

    Raises: UsageError: it says not where robots begin, or no robot can stand there, or no landmark is in reach.
    Source: Encoded graphs §IV-A, Fig. 6.
    """
    if plan.start is None:
        raise UsageError(f"{plan.name} does not say where robots begin", "start_pose: [x, y, heading] in the map")
    begun_at(plan, plan.start)
    in_sight, beside = sighted(plan, [site for site in landmarks_of(plan) if site.type in SHORT], lidar)
    all_aliases = [alias for each in in_sight for alias in each.site.aliases]
    others = (*look_alikes_of(plan), *beside)
    told = set(alone(all_aliases, others, APART_M))
    sites = [site for site in (each.left(told) for each in in_sight) if site is not None]
    if not sites:
        raise UsageError(f"{plan.name} has no landmarks", "walls with doorways, rooms or free corners; or codes")
    start = (plan.start[0], plan.start[1])
    named: dict[str, Site] = {}
    counts: Counter[str] = Counter()
    for site in sites:
        short = SHORT[site.type]
        counts[short] += 1
        named[f"{short}{counts[short]}"] = site
    places = {START: start, **{name: site.place_m for name, site in named.items()}}
    free = Free(plan, [start], PASS_M)
    near, behind = _ways(plan, free, places, named)
    ways = _joined(near, behind)
    sure = _reached(START, ways)
    ways = _with_far(plan, free, places, ways, behind)
    reached = _reached(START, ways)
    made = partial(_made, Draft(f"explore {plan.name}", coding, plan.bounds, floor_plan=plan.name), start, named, ways)
    mission = told_apart(made(reached), (*all_aliases, *others))
    if reached != sure:
        reached -= look_ahead(mission, None, plan, lidar).infeasible.keys() - sure
        mission = told_apart(made(reached), (*all_aliases, *others))
    if len(reached) == 1:
        raise UsageError(
            f"no way leads to a landmark from ({start[0]:g}, {start[1]:g}) in {plan.name}", "another start"
        )
    if len(reached) <= len(sites):
        away = len(sites) + 1 - len(reached)
        log.warning("%s: %d of %d landmarks left out: no way from the start", plan.name, away, len(sites))
    return mission


def _made(
    draft: Draft,
    start: tuple[float, float],
    named: dict[str, Site],
    ways: set[tuple[str, str]],
    kept: Container[str],
) -> Mission:
    """The mission of these places and of the ways between them."""
    draft = replace(draft, nodes=[], ways=[])
    draft.node(START, Position(*start), start=True)
    for name, site in named.items():
        if name in kept:
            draft.node(name, *site.aliases, width_m=site.width_m or None)
    for source, target in sorted(ways):
        if source in kept and target in kept:
            draft.way(source, target)
    return draft.mission()


def begun_at(plan: FloorPlan, start: tuple[float, float, float]) -> FloorPlan:
    """The floor plan with robots that begin at x, y, heading.

    Raises: UsageError: no robot can stand there: it is in a wall, outside, or in a space that the plan leaves out.
    """
    x, y, _ = start
    # A map_server map whose start is in no free space has walls, but no outline at all.
    nowhere = len(plan.walls) > 0 and not plan.outlines
    if nowhere or not plan.inside(x, y) or plan.clearance_m(x, y) < STAND_M:
        raise UsageError(
            f"no robot can stand at ({x:g}, {y:g}) in {plan.name}",
            f"a free place, {STAND_M} m from walls; beyond the map's largest space only as start_pose in the map",
        )
    return replace(plan, start=start)


def roomiest(plan: FloorPlan) -> tuple[float, float, float]:
    """Where robots begin in a map that does not say it: the free place farthest from all walls, facing north.

    Of a map_server map, in its largest space. Whole centimetres, so that it can be told and typed again.

    Raises: UsageError: there is no such place, or the walls part the map into several spaces.
    """
    x0, y0, x1, y1 = _extent(plan)
    step = max(GRID_M, max(x1 - x0, y1 - y0) / GRID_PLACES)
    places = [
        (round(x0 + (i + 0.5) * step, 2), round(y0 + (j + 0.5) * step, 2))
        for i in range(math.ceil((x1 - x0) / step))
        for j in range(math.ceil((y1 - y0) / step))
    ]
    # Being inside is dear to tell: asked from the roomiest place on, and equal ones in the order of the grid.
    for clearance_m, place in sorted(((plan.clearance_m(*place), place) for place in places), key=lambda row: -row[0]):
        if clearance_m < STAND_M:
            break
        if plan.inside(*place):
            return (*place, NORTH_RAD)
    raise UsageError(
        f"{plan.name} does not say where robots begin, and has no one space to choose from",
        "start_pose: [x, y, heading] in the map",
    )


def _extent(plan: FloorPlan) -> tuple[float, float, float, float]:
    """The bounds, without what lies beyond all outlines: pictures of maps have wide margins."""
    x0, y0, x1, y1 = plan.bounds
    if not plan.outlines:
        return plan.bounds
    points = np.vstack([outline.points for outline in plan.outlines])
    (left, low), (right, high) = points.min(0).tolist(), points.max(0).tolist()
    return max(x0, left), max(y0, low), min(x1, right), min(y1, high)


def _ways(
    plan: FloorPlan, free: Free, places: dict[str, tuple[float, float]], sites: dict[str, Site]
) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """(from, to): to each place from its nearest neighbours in sight, and back; those that come from behind apart."""
    ways, behind = set[tuple[str, str]](), set[tuple[str, str]]()
    beside = {name: free.beside(_around(plan, place), place) for name, place in places.items()}
    for name, place in places.items():
        around = _around(plan, place)
        near = sorted((math.dist(place, there), other) for other, there in places.items() if other != name)
        others = (
            other
            for away, other in near
            if away <= WAY_LIMIT_M
            and _is_way(around, places, name, other, away)
            and free.has_way(beside[name], beside[other], DETOUR * away + DETOUR_M)
        )
        left = NEIGHBOURS
        for other in others:
            shows = _shows_itself(sites.get(name), places[other])
            (ways if shows else behind).add((other, name))
            (ways if _shows_itself(sites.get(other), place) else behind).add((name, other))
            left -= shows
            if not left:
                break
    return ways, behind


def _joined(ways: set[tuple[str, str]], behind: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """The ways, and of those that come from behind what leads to where no others do, or back from there."""
    reached = _reached(START, ways)
    while more := {(a, b) for a, b in behind if a in reached and b not in reached}:
        ways = ways | more
        reached = _reached(START, ways)
    return ways | {(b, a) for a, b in ways if (b, a) not in ways and a not in _reached(b, ways)}


def _with_far(
    plan: FloorPlan,
    free: Free,
    places: dict[str, tuple[float, float]],
    ways: set[tuple[str, str]],
    behind: set[tuple[str, str]],
) -> set[tuple[str, str]]:
    """The ways; the shortest of the long ones to what they do not lead to, one after the other; and those back.

    Likewise to what they lead to over the start alone: there may be nothing in sight, and who comes back would not know
    that it is there.
    """
    tried = set[tuple[str, str]]()

    def joins(a: str, b: str, away_m: float) -> bool:
        tried.add((a, b))
        one, other = (free.beside(plan, places[name]) for name in (a, b))
        return _is_clear(plan, places[a], places[b], away_m) and free.has_way(one, other, DETOUR * away_m + DETOUR_M)

    def longer(reached: set[str], left: set[str]) -> bool:
        pairs = {(a, b) for a in reached for b in left} - tried
        far = sorted((away, a, b) for a, b in pairs if (away := math.dist(places[a], places[b])) <= FAR_LIMIT_M)
        found = next(((a, b) for away, a, b in far if away > CLEARANCE_M and joins(a, b, away)), None)
        if found is not None:
            nonlocal ways
            ways = _joined(ways | {found, found[::-1]}, behind)
        return found is not None

    while longer(reached := _reached(START, ways), set(places) - reached):
        pass
    firsts = sorted((math.dist(places[START], places[name]), name) for source, name in ways if source == START)
    while firsts:
        beyond = _reached(firsts[0][1], {way for way in ways if START not in way})
        if not longer(beyond, _reached(START, ways) - beyond - {START}):
            break
    return ways


def _shows_itself(site: Site | None, place: tuple[float, float]) -> bool:
    """Whether who comes from a place comes to the side from which it is seen: walls and codes have one."""
    if site is None or site.type in TWO_SIDED:
        return True

    def shows(alias: Landmark) -> bool:
        dx, dy, turn = place[0] - alias.x_m, place[1] - alias.y_m, alias.orientation_rad or 0.0
        return dx * math.cos(turn) + dy * math.sin(turn) > BEHIND * math.hypot(dx, dy)

    return any(map(shows, site.aliases))


def _is_way(plan: FloorPlan, places: dict[str, tuple[float, float]], one: str, other: str, away_m: float) -> bool:
    """Whether a line leads from one to the other; so near each other there is none, but for who begins there."""
    a, b = places[one], places[other]
    if away_m <= CLEARANCE_M:
        return START in (one, other) and plan.sees(a, b)
    return _is_clear(plan, a, b, away_m)


def _reached(start: str, ways: set[tuple[str, str]]) -> set[str]:
    """The start, and what ways lead to from it."""
    after: dict[str, list[str]] = {}
    for source, target in ways:
        after.setdefault(source, []).append(target)
    reached, waiting = {start}, [start]
    while waiting:
        new = [name for name in after.get(waiting.pop(), []) if name not in reached]
        reached.update(new)
        waiting += new
    return reached


def _around(plan: FloorPlan, place: tuple[float, float]) -> FloorPlan:
    """The plan with those walls alone that a way from here could meet: large maps have thousands."""
    reach_m = WAY_LIMIT_M + CLEARANCE_M
    ends = plan.walls.reshape(-1, 2, 2)
    met = np.all((ends.min(1) <= np.add(place, reach_m)) & (ends.max(1) >= np.subtract(place, reach_m)), axis=1)
    return replace(plan, walls=plan.walls[met])


def _is_clear(plan: FloorPlan, a: tuple[float, float], b: tuple[float, float], away_m: float) -> bool:
    """Whether a robot can drive from near a to near b straight, or beside that along a face that both are on."""
    along_x, along_y = (b[0] - a[0]) / away_m, (b[1] - a[1]) / away_m

    def sees(side: float) -> bool:
        end = min(END_M, away_m / 4) if side else 0.0
        x, y = -side * along_y, side * along_x
        p = (a[0] + x + end * along_x, a[1] + y + end * along_y)
        q = (b[0] + x - end * along_x, b[1] + y - end * along_y)
        return plan.sees(p, q)

    return any(all(map(sees, sides)) for sides in (SIDES if away_m >= FACE_LONG_M else SIDES[:1]))
