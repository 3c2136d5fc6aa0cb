"""Make a mission from a floor plan: visit every landmark that a robot can find there."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Collection, Sequence
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
from phalanx.mission.worth.feasible import failing_ways

from .findable import alone, mark_lookalikes, sighted, without_duplicates
from .free import END_M, STAND_M, Free

# Longer ways are neither straight nor sure to have the target in sight. Ways up to FAR_LIMIT_M lead only to landmarks
# that no shorter way reaches, as the far end of a bare corridor, if a robot can be expected to recognise them.
WAY_LIMIT_M, FAR_LIMIT_M = 16.0, 24.0
NEIGHBOURS = 6
# A short way needs this clearance on both sides, except at its ends, as landmarks lie in walls and on corners. A way of
# LONG_M or more needs it on one side only.
CLEARANCE_M, LONG_M = 0.3, 3.0
SIDES = (-CLEARANCE_M, 0.0, CLEARANCE_M)
# The path of a robot may be longer than the straight line by this factor and this length: a robot cannot pass behind a
# shelf 0.1 m from a wall, and one that drives around it leaves the line.
DETOUR, DETOUR_M = 1.2, 1.0
# The start is searched on a grid with this many places along the longer side of the map, spaced at least GRID_M.
GRID_PLACES = 200
GRID_M = 0.05
NORTH_RAD = math.pi / 2
APART_M = 0.5  # smallest distance of a landmark to a look-alike, somewhat more than the uncertainty of a robot's pose
START = "start"
TWO_SIDED = ("doorway", "room")
BEHIND = -0.1  # cosine of the angle to a wall's normal, above which a robot is in front of it, with a tolerance
SHORT = {"doorway": "door", "concave_left": "corner", "concave_right": "corner", "room": "room", "qr": "code"}

log = logging.getLogger(__name__)


def survey(plan: FloorPlan, coding: CodingConfig | None = None, lidar: LidarConfig | None = None) -> Mission:
    """Return a mission to visit all doorways, rooms, concave corners and QR codes of a floor plan.

    Landmarks are left out if the lidar does not show them, if a look-alike is near, if robots cannot be expected to
    find them, or, with a warning, if no way leads to them from the start: such a mission would never complete. Convex
    corners are left out because every room has four, and its node identifies it better.

    Ways lead to each landmark from the six nearest in sight, on the side from which it is visible, and back. Longer
    ways lead to landmarks without other ways. Ways on which robots cannot be expected to find the target are left out.

    Raises: UsageError: the plan has no start, no robot can stand there, or no landmark is in reach.
    Source: Encoded graphs §IV-A, Fig. 6.
    """
    if plan.start is None:
        raise UsageError(f"{plan.name} has no start of the robots", "add start_pose: [x, y, heading] to the map")
    with_start(plan, plan.start)
    in_sight, beside = sighted(plan, [site for site in landmarks_of(plan) if site.type in SHORT], lidar)
    all_aliases = [alias for each in in_sight for alias in each.site.aliases]
    others = (*look_alikes_of(plan), *beside)
    unique = set(without_duplicates(alone(all_aliases, others, APART_M)))
    sites = [site for site in (each.with_aliases(unique) for each in in_sight) if site is not None]
    if not sites:
        hint = "use a map that has doorways, rooms, free corners or QR codes"
        raise UsageError(f"{plan.name} has no landmarks that robots can recognise", hint)
    start = (plan.start[0], plan.start[1])
    named: dict[str, Site] = {}
    counts: Counter[str] = Counter()
    for site in sites:
        short = SHORT[site.type]
        counts[short] += 1
        named[f"{short}{counts[short]}"] = site
    places = {START: start, **{name: site.place_m for name, site in named.items()}}
    free = Free(plan, [start])
    near, behind = _ways(plan, free, places, named)
    ways = _with_far(plan, free, places, named, _joined(near, behind), behind)
    made = partial(_made, Draft(f"explore {plan.name}", coding, plan.bounds, floor_plan=plan.name), start, named)
    mission = mark_lookalikes(made(ways), (*all_aliases, *others))
    outlook, late, vain = failing_ways(mission, plan, lidar)
    # The remaining nodes can be found on the remaining ways: a second prediction would not exclude more.
    ways = _without(outlook.infeasible.keys(), ways - late - vain, behind - vain | late, vain)
    mission = mark_lookalikes(made(ways, outlook.order), (*all_aliases, *others))
    reached = _reached(START, ways)
    if len(reached) == 1:
        dark = sorted(outlook.infeasible.items(), key=lambda each: (not each[1][0].startswith("from "), each))
        why = next((f": {name} {whys[0]}" for name, whys in dark), "")
        raise UsageError(
            f"no way leads to a landmark from ({start[0]:g}, {start[1]:g}) in {plan.name}{why}", "use another start"
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
    order: Sequence[str] = (),
) -> Mission:
    """Return the mission of all places and ways that can be reached from the start.

    `order` is the order of the nodes: of two nodes at the same estimated distance robots try the first.
    """
    draft, kept = replace(draft, nodes=[], ways=[]), _reached(START, ways)
    draft.node(START, Position(*start), start=True)
    for name in order or named:
        if name in kept and name != START:
            draft.node(name, *named[name].aliases, width_m=named[name].width_m or None)
    for source, target in sorted(ways):
        if source in kept and target in kept:
            draft.way(source, target)
    return draft.mission()


def with_start(plan: FloorPlan, start: tuple[float, float, float]) -> FloorPlan:
    """Return the floor plan with a start of the robots at x, y, heading.

    Raises: UsageError: no robot can stand there: it is in or near a wall, outside, or in a space that the plan omits.
    """
    x, y, _ = start
    # A map_server map whose start is not in free space has walls, but no outline.
    nowhere = len(plan.walls) > 0 and not plan.outlines
    if nowhere or not plan.inside(x, y) or plan.clearance_m(x, y) < STAND_M:
        raise UsageError(
            f"no robot can stand at ({x:g}, {y:g}) in {plan.name}",
            f"use a free place {STAND_M} m from walls; outside the map's largest space, set start_pose in the map",
        )
    return replace(plan, start=start)


def most_spacious_start(plan: FloorPlan) -> tuple[float, float, float]:
    """Return a start for a map without one: the place farthest from all walls, facing north.

    It is in the largest space of a map_server map, and rounded to centimetres, so that people can type it.
    Raises: UsageError: there is no such place, or walls divide the map into several spaces.
    """
    x0, y0, x1, y1 = _extent(plan)
    step = max(GRID_M, max(x1 - x0, y1 - y0) / GRID_PLACES)
    places = [
        (round(x0 + (i + 0.5) * step, 2), round(y0 + (j + 0.5) * step, 2))
        for i in range(math.ceil((x1 - x0) / step))
        for j in range(math.ceil((y1 - y0) / step))
    ]
    # `inside` is slow: try the place with the most clearance first, ties in the order of the grid.
    for clearance_m, place in sorted(((plan.clearance_m(*place), place) for place in places), key=lambda row: -row[0]):
        if clearance_m < STAND_M:
            break
        if plan.inside(*place):
            return (*place, NORTH_RAD)
    raise UsageError(
        f"{plan.name} has no start of the robots, and no single space to choose one in",
        "add start_pose: [x, y, heading] to the map",
    )


def _extent(plan: FloorPlan) -> tuple[float, float, float, float]:
    """Return the bounds of all outlines, as images of maps have wide margins."""
    if not plan.outlines:
        return plan.bounds
    x0, y0, x1, y1 = plan.bounds
    points = np.vstack([outline.points for outline in plan.outlines])
    (left, low), (right, high) = points.min(0).tolist(), points.max(0).tolist()
    return max(x0, left), max(y0, low), min(x1, right), min(y1, high)


def _ways(
    plan: FloorPlan, free: Free, places: dict[str, tuple[float, float]], sites: dict[str, Site]
) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """Return ways (from, to) to each place from its nearest neighbours in sight, and back.

    Returns: (ways on which the target is visible, ways that come from behind its wall).
    """
    ways, behind = set[tuple[str, str]](), set[tuple[str, str]]()
    beside = {name: free.beside(_around(plan, place), place) for name, place in places.items()}
    for name, place in places.items():
        around = _around(plan, place)
        near = sorted((math.dist(place, there), other) for other, there in places.items() if other != name)
        others = (
            (other, side)
            for away, other in near
            if away <= WAY_LIMIT_M
            and (side := _side(around, free, places, name, other)) is not None
            and free.has_way(beside[name], beside[other], DETOUR * away + DETOUR_M)
        )
        left = NEIGHBOURS
        for other, side in others:
            shows = _shows_itself(sites.get(name), free, places[other], place, -side)
            (ways if shows else behind).add((other, name))
            (ways if _shows_itself(sites.get(other), free, place, places[other], side) else behind).add((name, other))
            left -= shows
            if not left:
                break
    return ways, behind


def _joined(ways: set[tuple[str, str]], *spare: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the ways, with those spare ways that are needed to reach further places, and ways back.

    The sets of spare ways are used in order.
    """

    def new(spare: set[tuple[str, str]]) -> set[tuple[str, str]]:
        reached = _reached(START, ways)
        return {(a, b) for a, b in spare if a in reached and b not in reached}

    while more := next(filter(None, map(new, spare)), None):
        ways = ways | more
    return ways | {(b, a) for a, b in ways if (b, a) not in ways and a not in _reached(b, ways)}


def _without(dark: Collection[str], *ways: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the result of `_joined` without ways to and from nodes in `dark`."""
    return _joined(*({(a, b) for a, b in each if a not in dark and b not in dark} for each in ways))


def _with_far(
    plan: FloorPlan,
    free: Free,
    places: dict[str, tuple[float, float]],
    sites: dict[str, Site],
    ways: set[tuple[str, str]],
    behind: set[tuple[str, str]],
) -> set[tuple[str, str]]:
    """Return the ways, with the shortest long ways, there and back, to places that are not reached yet.

    Add long ways also to places that are connected only through the start: a robot that returns there may have no
    landmark in sight.
    """
    tried, unseen = set[tuple[str, str]](), list[tuple[float, str, str]]()

    def joins(away_m: float, a: str, b: str) -> bool:
        tried.add((a, b))
        side = _side(plan, free, places, a, b)
        if side is None:
            return False
        one, other = (free.beside(plan, places[name]) for name in (a, b))
        if not free.has_way(one, other, DETOUR * away_m + DETOUR_M):
            return False
        if _shows_itself(sites.get(b), free, places[a], places[b], side):
            return True
        unseen.append((away_m, a, b))
        return False

    def longer(reached: set[str], left: set[str]) -> bool:
        pairs = {(a, b) for a in reached for b in left} - tried
        far = sorted((away, a, b) for a, b in pairs if (away := math.dist(places[a], places[b])) <= FAR_LIMIT_M)
        found = next((each for each in far if each[0] > CLEARANCE_M and joins(*each)), None)
        # Otherwise use a way whose target a robot sees only when it looks back.
        found = found or min((each for each in unseen if each[1] in reached and each[2] in left), default=None)
        if found is not None:
            nonlocal ways
            ways = _joined(ways | {(found[1], found[2]), (found[2], found[1])}, behind)
        return found is not None

    while longer(reached := _reached(START, ways), set(places) - reached):
        pass
    firsts = sorted((math.dist(places[START], places[name]), name) for source, name in ways if source == START)
    while firsts:
        beyond = _reached(firsts[0][1], {way for way in ways if START not in way})
        if not longer(beyond, _reached(START, ways) - beyond - {START}):
            break
    return ways


def _shows_itself(site: Site | None, free: Free, a: tuple[float, float], b: tuple[float, float], side: int) -> bool:
    """Return True if a robot on the way from a, on this side of its line, is in front of the wall of the site at b."""
    if site is None or site.type in TWO_SIDED:
        return True
    away_m = math.dist(a, b)
    last = free.on_way(a, b, away_m - END_M, side) if away_m >= LONG_M else None
    places = (a,) if last is None else (a, last)

    def shows(alias: Landmark) -> bool:
        turn = alias.orientation_rad or 0.0
        ways = [(x - alias.x_m, y - alias.y_m) for x, y in places]
        return all(x * math.cos(turn) + y * math.sin(turn) > BEHIND * math.hypot(x, y) for x, y in ways)

    return any(map(shows, site.aliases))


def _side(plan: FloorPlan, free: Free, places: dict[str, tuple[float, float]], one: str, other: str) -> int | None:
    """Return the side of the line on which a robot can drive straight between two places: 1 left, -1 right, or None."""
    a, b = places[one], places[other]
    away_m = math.dist(a, b)
    if away_m >= LONG_M:
        return free.side_of(a, b)
    if away_m <= CLEARANCE_M:  # too near for a way, except from the start
        return 1 if START in (one, other) and plan.sees(a, b) else None
    along_x, along_y = (b[0] - a[0]) / away_m, (b[1] - a[1]) / away_m

    def sees(side: float) -> bool:
        end, x, y = away_m / 4 if side else 0.0, -side * along_y, side * along_x
        p = (a[0] + x + end * along_x, a[1] + y + end * along_y)
        q = (b[0] + x - end * along_x, b[1] + y - end * along_y)
        return plan.sees(p, q)

    return 1 if all(map(sees, SIDES)) else None


def _reached(start: str, ways: set[tuple[str, str]]) -> set[str]:
    """Return the start and all places that can be reached from it."""
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
    """Return the plan with only those walls that a way from here could meet, as large maps have thousands."""
    reach_m = WAY_LIMIT_M + CLEARANCE_M
    ends = plan.walls.reshape(-1, 2, 2)
    met = np.all((ends.min(1) <= np.add(place, reach_m)) & (ends.max(1) >= np.subtract(place, reach_m)), axis=1)
    return replace(plan, walls=plan.walls[met])
