"""Which landmarks robots find: those that a lidar truly shows, and that stand far from whatever looks the same.

A robot holds hashes and no map: that there is a second pillar half a metre on, it cannot know. Whoever compiles the
mission knows the building, and says of each landmark how far it stands alone. And a map's corner may be a step of its
grid, hide behind a cupboard, or lie a hand's breadth from where a scan puts it. So each landmark is looked at from
places around it, with the lidar and the extraction that robots have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phalanx.config.lidar import LidarConfig
from phalanx.config.mission import MissionConfig
from phalanx.mission.graph import Mission, Node
from phalanx.mission.landmarks import FloorPlan, Site, extract, look_alikes_of
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.observable import HALF_TURN_TYPES, UNTOLD_M, Landmark, Observable, number_or_nan
from phalanx.mission.walk.finding import MIDDLE_M

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]

Pose = tuple[float, float, float]
# Orientations that differ by less may be taken for one another: two bins of headings.
ALIKE_RAD = math.radians(30)
# What is nearer is the same thing, drawn twice, or seen at two places of a ragged map: the walker takes it for one too.
SAME_M = MissionConfig().agree_m / 2
# A landmark is looked at from places so far away, in so many directions, and from no more than so many of them.
AWAY_M = (0.8, 1.5, 2.5, 4.0, 6.0)
DIRECTIONS, LOOKS = 12, 24
# It is not aimed at: a beam that goes just there shows a corner, or the last of a wall, that robots do not see.
BESIDE_RAD = 0.054
ROOM_M = 0.3  # that a robot needs around such a place
# So far from where the map has it, and so much turned, it is still itself.
NEAR_M, TURNED_RAD = 0.2, math.radians(10)
# Seen from so many of those places, and from so many of these within so much of its middle place, it is a landmark.
SEEN_SHARE, SEEN_LEAST, STEADY_SHARE, STEADY_M = 0.3, 3, 0.85, 0.1


def apart_in(plan: FloorPlan, mission: Mission) -> Mission:
    """The mission in a building that is known."""
    return mark_lookalikes(mission, look_alikes_of(plan))


def mark_lookalikes(mission: Mission, look_alikes: Iterable[Landmark] | None = None) -> Mission:
    """Return the mission whose landmarks say how far it is to the next thing that looks the same.

    `look_alikes` is what else robots see in the building. Where nobody knows (None), what landmarks say already holds,
    or UNTOLD_M, but for codes, which have a text of their own.
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


def without_duplicates(landmarks: Iterable[Landmark]) -> list[Landmark]:
    """The landmarks without those that are the same thing as one before: robots know it by the first name it has."""
    kept: dict[tuple[str, str | None], list[Landmark]] = {}
    for each in landmarks:
        same = kept.setdefault((each.type, each.text), [])
        if not any(_is_same(each, other) for other in same):
            same.append(each)
    return [each for alike in kept.values() for each in alike]


def is_written_twice(one: Landmark, other: Landmark) -> bool:
    """Return whether two landmarks look the same, so that a robot takes one for the other."""
    alike = (one.type, one.text) == (other.type, other.text) and _is_same(one, other)
    return alike and math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) > MIDDLE_M


def _is_same(one: Landmark, other: Landmark) -> bool:
    return _is_near(one, other, SAME_M, ALIKE_RAD)


def _is_near(one: Landmark, other: Landmark, most_m: float, most_rad: float) -> bool:
    """Return True if two landmarks are so near, and turned so little where both have an orientation."""
    if math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) > most_m:
        return False
    return one.orientation_rad is None or other.orientation_rad is None or abs(_turn_between(one, other)) <= most_rad


def _turn_between(one: Landmark, other: Landmark) -> float:
    """Return the turn from one landmark's orientation to the other's; none counts as 0."""
    full = math.pi if one.type in HALF_TURN_TYPES else math.tau
    return math.remainder((other.orientation_rad or 0.0) - (one.orientation_rad or 0.0), full)


def _tables(landmarks: Iterable[Landmark]) -> dict[tuple[str, str | None], Rows]:
    """(n, 3) for each kind and text: places and orientations."""
    rows: dict[tuple[str, str | None], list[tuple[float, float, float]]] = {}
    for each in landmarks:
        row = (each.x_m, each.y_m, number_or_nan(each.orientation_rad))
        rows.setdefault((each.type, each.text), []).append(row)
    return {kind: np.array(table, np.float64) for kind, table in rows.items()}


def _apart_m(landmark: Landmark, rows: Rows) -> float:
    away = np.hypot(rows[:, 0] - landmark.x_m, rows[:, 1] - landmark.y_m)
    full = math.pi if landmark.type in HALF_TURN_TYPES else math.tau
    turn = rows[:, 2] - number_or_nan(landmark.orientation_rad)
    turned = np.abs(turn - full * np.round(turn / full)) > ALIKE_RAD  # not so where one has no orientation
    rivals = away[(away > SAME_M) & ~turned]
    return float(rivals.min()) if len(rivals) else math.inf


class Looks:
    """Landmarks that a noiseless lidar shows in a building; with `as_drawn`, with the dust of its map."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig | None = None, *, as_drawn: bool = False) -> None:
        lidar = lidar or LidarConfig()
        walls = plan.drawn if as_drawn and plan.drawn is not None else plan.walls
        self._eye, self._chance = Lidar(walls, replace(lidar, noise_m=0.0, drop_out=0.0)), np.random.default_rng(0)
        self._extraction = plan.extraction.for_noise(lidar.noise_m)

    def from_pose(self, pose: Pose) -> tuple[Landmark, ...]:
        """Return the landmarks visible from x, y, heading; map frame."""
        return extract(self._eye.sweep(pose, self._chance), self._extraction).landmarks(*pose)

    def shows(self, pose: Pose, landmark: Landmark) -> bool:
        """Return whether this landmark is among it; a code is for cameras, and may be."""
        return landmark.text is not None or any(_is(found, landmark) for found in self.from_pose(pose))


@dataclass(frozen=True, slots=True)
class Sighted:
    """A site where it is seen, and what is to be seen from the places from which it was looked at."""

    site: Site
    looks: tuple[tuple[Landmark, ...], ...]  # none of a code: a lidar does not show it

    def left(self, aliases: Container[Landmark]) -> Site | None:
        """The site with no other aliases than these; None if they are seen too seldom."""
        kept = tuple(alias for alias in self.site.aliases if alias in aliases)
        enough = self.site.type == "qr" or _is_enough(_seen(kept, self.looks), len(self.looks))
        return replace(self.site, aliases=kept) if kept and enough else None


def sighted(
    plan: FloorPlan, sites: Sequence[Site], lidar: LidarConfig | None = None
) -> tuple[list[Sighted], list[Landmark]]:
    """(sites of which anything is seen, where it is seen; all that was seen beside them)."""
    from_pose = _looks(plan, lidar or LidarConfig())
    as_drawn = None if plan.drawn is None else _looks(plan, lidar or LidarConfig(), as_drawn=True)
    kept, beside = [], []
    for site in sites:
        if site.type == "qr":
            kept.append(Sighted(site, ()))
            continue
        poses = _places(plan, site)
        looks = tuple(map(from_pose, poses))
        drawn = looks if as_drawn is None else tuple(map(as_drawn, poses))
        found = tuple(alias for alias in (_as_seen(alias, looks) for alias in site.aliases) if alias is not None)
        # A speck in a doorway leaves none, for who meets it.
        if found and (drawn is looks or _is_enough(_seen(found, drawn), len(poses))):
            kept.append(Sighted(replace(site, aliases=found), looks))
        beside += _beside(site, looks)
        if drawn is not looks:  # and it may be taken for a landmark
            beside += _beside(site, drawn)
    return kept, beside


def _seen(aliases: Sequence[Landmark], looks: Iterable[Sequence[Landmark]]) -> int:
    """How many looks show any of them."""
    return sum(any(_is(found, alias) for alias in aliases for found in look) for look in looks)


def _is_enough(seen: int, looks: int) -> bool:
    return seen >= max(SEEN_LEAST, SEEN_SHARE * looks)


@lru_cache(maxsize=2)
def _looks(plan: FloorPlan, lidar: LidarConfig, *, as_drawn: bool = False) -> Callable[[Pose], tuple[Landmark, ...]]:
    """`Looks.from_pose`, from each pose once: whoever judges a mission made from a plan asks the same of it again."""
    return cache(Looks(plan, lidar, as_drawn=as_drawn).from_pose)


def _beside(site: Site, looks: Sequence[Sequence[Landmark]]) -> list[Landmark]:
    """Return other landmarks in at least two looks: one poor sighting does not count as another landmark."""
    others = [[found for found in look if not any(_is(found, alias) for alias in site.aliases)] for look in looks]
    before: dict[tuple[str, int, int], list[Landmark]] = {}
    beside = []
    for look in others:
        beside += [found for found in look if any(_is(found, other) for other in _around(before, found))]
        for found in look:
            before.setdefault(_square_of(found), []).append(found)
    return beside


def _square_of(landmark: Landmark) -> tuple[str, int, int]:
    # A little wider than what is near: no rounding has it two squares away.
    return landmark.type, math.floor(landmark.x_m / (1.01 * NEAR_M)), math.floor(landmark.y_m / (1.01 * NEAR_M))


def _around(known: dict[tuple[str, int, int], list[Landmark]], found: Landmark) -> Iterator[Landmark]:
    """Those of the same type in its square and the eight around it."""
    kind, i, j = _square_of(found)
    for square in product((kind,), (i - 1, i, i + 1), (j - 1, j, j + 1)):
        yield from known.get(square, ())


def _away(one: Landmark, other: Landmark) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


def _places(plan: FloorPlan, site: Site) -> list[Pose]:
    """Return the places from which robots see a landmark, facing it."""
    x, y = site.place_m
    poses = []
    for away, k in ((away, k) for away in AWAY_M for k in range(DIRECTIONS)):
        turn = math.tau * k / DIRECTIONS
        eye = x + away * math.cos(turn), y + away * math.sin(turn)
        if plan.clearance_m(*eye) >= ROOM_M and plan.inside(*eye) and plan.sees(eye, _before(eye, (x, y))):
            poses.append((*eye, turn - math.pi + BESIDE_RAD))
    return [poses[i] for i in np.unique(np.linspace(0, len(poses) - 1, min(LOOKS, len(poses))).astype(int))]


def _before(eye: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    """A place a little before a landmark, which lies in a wall."""
    away = math.dist(eye, place)
    share = max(0.0, 1.0 - 0.1 / away)
    return eye[0] + share * (place[0] - eye[0]), eye[1] + share * (place[1] - eye[1])


def _is(found: Landmark, truth: Landmark) -> bool:
    return found.type == truth.type and _is_near(found, truth, NEAR_M, TURNED_RAD)


def _as_seen(alias: Landmark, looks: Sequence[Sequence[Landmark]]) -> Landmark | None:
    """Return the alias where most looks show it, or between two such places; None where they do not agree."""
    places = np.array([_nearest(alias, look) for look in looks if any(_is(found, alias) for found in look)])
    if not len(places):
        return None
    middles = (np.median(places, axis=0), np.mean(places, axis=0))
    middle = next((each for each in middles if _is_steady(places, each)), None)
    if middle is None:
        return None
    turn = None if alias.orientation_rad is None else alias.orientation_rad + float(middle[2])
    return replace(alias, x_m=float(middle[0]), y_m=float(middle[1]), orientation_rad=turn)


def _is_steady(places: NDArray[np.float64], middle: NDArray[np.float64]) -> bool:
    away = np.hypot(*(places[:, :2] - middle[:2]).T)
    return bool(np.quantile(away, STEADY_SHARE) <= STEADY_M)


def _nearest(alias: Landmark, look: Sequence[Landmark]) -> tuple[float, float, float]:
    """(x, y, turn from the alias's orientation) of what is nearest to it among those that are it."""
    found = (each for each in look if _is(each, alias))
    rows = ((_away(each, alias), each.x_m, each.y_m, _turn_between(alias, each)) for each in found)
    return min(rows)[1:]
