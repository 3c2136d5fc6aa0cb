"""A floor plan becomes a mission: explore every landmark that a robot can find there."""

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
from phalanx.mission.worth.feasible import ways_in_vain

from .findable import alone, mark_lookalikes, sighted, without_duplicates
from .free import END_M, STAND_M, Free

# Landmarks further apart are not in each other's sight for certain; ways that long are not straight. Longer ones lead
# to what no others lead to, as the far end of a bare corridor, if a robot can be expected to know it there.
WAY_LIMIT_M, FAR_LIMIT_M = 16.0, 24.0
NEIGHBOURS = 6
# A short way keeps so far from walls on both sides, but for its ends: landmarks lie in walls and on corners. Beside a
# longer one either side will do.
CLEARANCE_M, LONG_M = 0.3, 3.0
SIDES = (-CLEARANCE_M, 0.0, CLEARANCE_M)
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
    others lead to. What robots cannot be expected to find is left out, and so is a way on which they cannot.

    Raises: UsageError: it says not where robots begin, or no robot can stand there, or no landmark is in reach.
    Source: Encoded graphs §IV-A, Fig. 6.
    """
    if plan.start is None:
        raise UsageError(f"{plan.name} does not say where robots begin", "start_pose: [x, y, heading] in the map")
    with_start(plan, plan.start)
    in_sight, beside = sighted(plan, [site for site in landmarks_of(plan) if site.type in SHORT], lidar)
    all_aliases = [alias for each in in_sight for alias in each.site.aliases]
    others = (*look_alikes_of(plan), *beside)
    told = set(without_duplicates(alone(all_aliases, others, APART_M)))
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
    free = Free(plan, [start])
    near, behind = _ways(plan, free, places, named)
    ways = _with_far(plan, free, places, named, _joined(near, behind), behind)
    made = partial(_made, Draft(f"explore {plan.name}", coding, plan.bounds, floor_plan=plan.name), start, named)
    mission = mark_lookalikes(made(ways), (*all_aliases, *others))
    outlook, late, vain = ways_in_vain(mission, plan, lidar)
    # What is left is found over what is left: no second look finds more that is dark.
    ways = _without(outlook.infeasible.keys(), ways - late - vain, behind - vain | late, vain)
    mission = mark_lookalikes(made(ways, outlook.order), (*all_aliases, *others))
    reached = _reached(START, ways)
    if len(reached) == 1:
        dark = sorted(outlook.infeasible.items(), key=lambda each: (not each[1][0].startswith("from "), each))
        why = next((f": {name} {whys[0]}" for name, whys in dark), "")
        raise UsageError(
            f"no way leads to a landmark from ({start[0]:g}, {start[1]:g}) in {plan.name}{why}", "another start"
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
    """Return the mission of the ways that lead on from the start, and of the places between them.

    Of two places that seem equally near robots try the first in `order`.
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


def most_spacious_start(plan: FloorPlan) -> tuple[float, float, float]:
    """Return where robots begin in a map that does not say it: the place farthest from all walls, facing north.

    Of a map_server map, in its largest space; in whole centimetres, which people can type.
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
    if not plan.outlines:
        return plan.bounds
    x0, y0, x1, y1 = plan.bounds
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
    """The ways, and of the spare ones, the first set first, what leads to where no others do; or back from there."""

    def new(spare: set[tuple[str, str]]) -> set[tuple[str, str]]:
        reached = _reached(START, ways)
        return {(a, b) for a, b in spare if a in reached and b not in reached}

    while more := next(filter(None, map(new, spare)), None):
        ways = ways | more
    return ways | {(b, a) for a, b in ways if (b, a) not in ways and a not in _reached(b, ways)}


def _without(dark: Collection[str], *ways: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the result of `_joined` without ways to and from dark nodes."""
    return _joined(*({(a, b) for a, b in each if a not in dark and b not in dark} for each in ways))


def _with_far(
    plan: FloorPlan,
    free: Free,
    places: dict[str, tuple[float, float]],
    sites: dict[str, Site],
    ways: set[tuple[str, str]],
    behind: set[tuple[str, str]],
) -> set[tuple[str, str]]:
    """Return the ways, with the shortest long ones to what they do not lead to, one after the other; and those back.

    Likewise to what they lead to over the start alone: who comes back there may have nothing in sight.
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
        # Who has driven past a thing may yet look back at it.
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
    """Return True if a robot on the way from a, on this side of its line, sees the site at b: walls have one side."""
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
    """Return on which side of its line a robot gets straight from near one place to near another: 1 left, -1 right."""
    a, b = places[one], places[other]
    away_m = math.dist(a, b)
    if away_m >= LONG_M:
        return free.side_of(a, b)
    if away_m <= CLEARANCE_M:  # no way leads from one to the other, but for who begins there
        return 1 if START in (one, other) and plan.sees(a, b) else None
    along_x, along_y = (b[0] - a[0]) / away_m, (b[1] - a[1]) / away_m

    def sees(side: float) -> bool:
        end, x, y = away_m / 4 if side else 0.0, -side * along_y, side * along_x
        p = (a[0] + x + end * along_x, a[1] + y + end * along_y)
        q = (b[0] + x - end * along_x, b[1] + y - end * along_y)
        return plan.sees(p, q)

    return 1 if all(map(sees, SIDES)) else None


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
