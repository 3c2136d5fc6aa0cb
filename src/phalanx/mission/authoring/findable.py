"""Select landmarks that robots can recognise: visible to their lidar, and far from others that look the same.

A robot has hashes and no map, so it cannot know of a second pillar half a metre away. The compiler knows the building
and stores the distance of each landmark to its next look-alike. Also, a corner of a map may be an artefact of its grid,
be hidden behind a cupboard, or lie 0.1 m from where a scan shows it. So each landmark is checked in simulated scans
from places around it, with the lidar and the feature extraction of the robots.
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
from phalanx.mission.observable import DEFAULT_APART_M, HALF_TURN_TYPES, Landmark, Observable, number_or_nan
from phalanx.mission.walk.finding import MIDDLE_M

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]

Pose = tuple[float, float, float]
# Orientations that differ by less may be confused: two bins of headings.
ALIKE_RAD = math.radians(30)
# Landmarks closer than this are one object, drawn twice or seen twice in a ragged map; the walker's limit is the same.
SAME_M = MissionConfig().agree_m / 2
# Distances and number of directions of the places from which a landmark is scanned, and the most scans of it.
AWAY_M = (0.8, 1.5, 2.5, 4.0, 6.0)
DIRECTIONS, LOOKS = 12, 24
# Scans do not point straight at the landmark: a beam that hits a corner or the end of a wall exactly would show more
# than robots see.
BESIDE_RAD = 0.054
ROOM_M = 0.3  # free space that a robot needs around such a place
# A landmark in a scan counts as the one in the map within these limits.
NEAR_M, TURNED_RAD = 0.2, math.radians(10)
# Accept a landmark if this share of the scans, and at least this number, show it; and this share of them within
# STEADY_M of its mean place.
SEEN_SHARE, SEEN_LEAST, STEADY_SHARE, STEADY_M = 0.3, 3, 0.85, 0.1


def mark_lookalikes_in(plan: FloorPlan, mission: Mission) -> Mission:
    """Return the mission with distances to look-alikes, from the floor plan of its building."""
    return mark_lookalikes(mission, look_alikes_of(plan))


def mark_lookalikes(mission: Mission, look_alikes: Iterable[Landmark] | None = None) -> Mission:
    """Return the mission with `apart_m` set in all landmarks.

    `look_alikes` are all other landmarks of the building. If they are unknown (None), landmarks keep their `apart_m`,
    by default DEFAULT_APART_M, as an upper limit; QR codes with a text are taken for unique.
    """
    own = [thing for node in mission.nodes for alias in node.see for thing in alias if isinstance(thing, Landmark)]
    tables = _tables((*own, *(look_alikes or ())))

    def seen(thing: Observable) -> Observable:
        if not isinstance(thing, Landmark):
            return thing
        is_known = look_alikes is not None or thing.text is not None
        most_m = math.inf if is_known and thing.apart_m == DEFAULT_APART_M else thing.apart_m
        return replace(thing, apart_m=min(most_m, _apart_m(thing, tables[thing.type, thing.text])))

    def of(node: Node) -> Node:
        return replace(node, see=tuple(tuple(seen(thing) for thing in alias) for alias in node.see))

    return replace(mission, nodes=tuple(of(node) for node in mission.nodes))


def alone(landmarks: Iterable[Landmark], others: Iterable[Landmark], least_m: float) -> list[Landmark]:
    """Return the landmarks that are at least `least_m` from all look-alikes among `landmarks` and `others`."""
    landmarks = list(landmarks)
    tables = _tables((*landmarks, *others))
    return [each for each in landmarks if _apart_m(each, tables[each.type, each.text]) >= least_m]


def without_duplicates(landmarks: Iterable[Landmark]) -> list[Landmark]:
    """Return the landmarks without later ones that are the same object as an earlier one."""
    kept: dict[tuple[str, str | None], list[Landmark]] = {}
    for each in landmarks:
        same = kept.setdefault((each.type, each.text), [])
        if not any(_is_same(each, other) for other in same):
            same.append(each)
    return [each for alike in kept.values() for each in alike]


def is_duplicate(one: Landmark, other: Landmark) -> bool:
    """Return True if two landmarks are the same object at places that differ by more than MIDDLE_M."""
    alike = (one.type, one.text) == (other.type, other.text) and _is_same(one, other)
    return alike and math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) > MIDDLE_M


def _is_same(one: Landmark, other: Landmark) -> bool:
    return _is_near(one, other, SAME_M, ALIKE_RAD)


def _is_near(one: Landmark, other: Landmark, most_m: float, most_rad: float) -> bool:
    """Return True if two landmarks are within a distance, and within a turn if both have an orientation."""
    if math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) > most_m:
        return False
    return one.orientation_rad is None or other.orientation_rad is None or abs(_turn_between(one, other)) <= most_rad


def _turn_between(one: Landmark, other: Landmark) -> float:
    """Return the turn from one landmark's orientation to the other's; a missing orientation counts as 0."""
    full = math.pi if one.type in HALF_TURN_TYPES else math.tau
    return math.remainder((other.orientation_rad or 0.0) - (one.orientation_rad or 0.0), full)


def _tables(landmarks: Iterable[Landmark]) -> dict[tuple[str, str | None], Rows]:
    """Return, by type and text, an (n, 3) array of x, y and orientation of the landmarks."""
    rows: dict[tuple[str, str | None], list[tuple[float, float, float]]] = {}
    for each in landmarks:
        row = (each.x_m, each.y_m, number_or_nan(each.orientation_rad))
        rows.setdefault((each.type, each.text), []).append(row)
    return {kind: np.array(table, np.float64) for kind, table in rows.items()}


def _apart_m(landmark: Landmark, rows: Rows) -> float:
    """Return the distance to the nearest look-alike in rows of one type and text; infinite if there is none."""
    away = np.hypot(rows[:, 0] - landmark.x_m, rows[:, 1] - landmark.y_m)
    full = math.pi if landmark.type in HALF_TURN_TYPES else math.tau
    turn = rows[:, 2] - number_or_nan(landmark.orientation_rad)
    turned = np.abs(turn - full * np.round(turn / full)) > ALIKE_RAD  # False for NaN
    rivals = away[(away > SAME_M) & ~turned]
    return float(rivals.min()) if len(rivals) else math.inf


class SimulatedScans:
    """Simulated scans of a building by a noiseless lidar; with `as_drawn`, including the specks of its map."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig | None = None, *, as_drawn: bool = False) -> None:
        lidar = lidar or LidarConfig()
        walls = plan.drawn if as_drawn and plan.drawn is not None else plan.walls
        self._eye, self._chance = Lidar(walls, replace(lidar, noise_m=0.0, drop_out=0.0)), np.random.default_rng(0)
        self._extraction = plan.extraction.for_noise(lidar.noise_m)

    def from_pose(self, pose: Pose) -> tuple[Landmark, ...]:
        """Return the landmarks extracted from a scan at x, y, heading; map frame."""
        return extract(self._eye.sweep(pose, self._chance), self._extraction).landmarks(*pose)

    def shows(self, pose: Pose, landmark: Landmark) -> bool:
        """Return True if a scan shows this landmark; always True for QR codes, which cameras see."""
        return landmark.text is not None or any(_is(found, landmark) for found in self.from_pose(pose))


@dataclass(frozen=True, slots=True)
class Sighted:
    """A site at the place where scans show it, and the landmarks in all scans around it."""

    site: Site
    looks: tuple[tuple[Landmark, ...], ...]  # by scan; empty for a QR code, which a lidar does not show

    def with_aliases(self, aliases: Container[Landmark]) -> Site | None:
        """Return the site with only these aliases; None if too few scans show them."""
        kept = tuple(alias for alias in self.site.aliases if alias in aliases)
        enough = self.site.type == "qr" or _is_enough(_seen(kept, self.looks), len(self.looks))
        return replace(self.site, aliases=kept) if kept and enough else None


def sighted(
    plan: FloorPlan, sites: Sequence[Site], lidar: LidarConfig | None = None
) -> tuple[list[Sighted], list[Landmark]]:
    """Return (visible sites, at the places where scans show them; all other landmarks in the scans)."""
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
        # A speck in a doorway of the map hides the doorway from the lidar.
        if found and (drawn is looks or _is_enough(_seen(found, drawn), len(poses))):
            kept.append(Sighted(replace(site, aliases=found), looks))
        beside += _beside(site, looks)
        if drawn is not looks:  # specks may also look like landmarks
            beside += _beside(site, drawn)
    return kept, beside


def _seen(aliases: Sequence[Landmark], looks: Iterable[Sequence[Landmark]]) -> int:
    """Return the number of scans that show any of the aliases."""
    return sum(any(_is(found, alias) for alias in aliases for found in look) for look in looks)


def _is_enough(seen: int, looks: int) -> bool:
    return seen >= max(SEEN_LEAST, SEEN_SHARE * looks)


@lru_cache(maxsize=2)
def _looks(plan: FloorPlan, lidar: LidarConfig, *, as_drawn: bool = False) -> Callable[[Pose], tuple[Landmark, ...]]:
    """Return a cached `SimulatedScans.from_pose`: the audit of a mission repeats the scans of its survey."""
    return cache(SimulatedScans(plan, lidar, as_drawn=as_drawn).from_pose)


def _beside(site: Site, looks: Sequence[Sequence[Landmark]]) -> list[Landmark]:
    """Return other landmarks that at least two scans show: a single one may be a poor detection."""
    others = [[found for found in look if not any(_is(found, alias) for alias in site.aliases)] for look in looks]
    before: dict[tuple[str, int, int], list[Landmark]] = {}
    beside = []
    for look in others:
        beside += [found for found in look if any(_is(found, other) for other in _around(before, found))]
        for found in look:
            before.setdefault(_square_of(found), []).append(found)
    return beside


def _square_of(landmark: Landmark) -> tuple[str, int, int]:
    # Squares are slightly wider than NEAR_M, so that near landmarks are in adjacent squares despite rounding.
    return landmark.type, math.floor(landmark.x_m / (1.01 * NEAR_M)), math.floor(landmark.y_m / (1.01 * NEAR_M))


def _around(known: dict[tuple[str, int, int], list[Landmark]], found: Landmark) -> Iterator[Landmark]:
    """Yield known landmarks of the same type in the square of a landmark and the eight around it."""
    kind, i, j = _square_of(found)
    for square in product((kind,), (i - 1, i, i + 1), (j - 1, j, j + 1)):
        yield from known.get(square, ())


def _away(one: Landmark, other: Landmark) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


def _places(plan: FloorPlan, site: Site) -> list[Pose]:
    """Return poses from which robots can see a site, facing it."""
    x, y = site.place_m
    poses = []
    for away, k in ((away, k) for away in AWAY_M for k in range(DIRECTIONS)):
        turn = math.tau * k / DIRECTIONS
        eye = x + away * math.cos(turn), y + away * math.sin(turn)
        if plan.clearance_m(*eye) >= ROOM_M and plan.inside(*eye) and plan.sees(eye, _before(eye, (x, y))):
            poses.append((*eye, turn - math.pi + BESIDE_RAD))
    return [poses[i] for i in np.unique(np.linspace(0, len(poses) - 1, min(LOOKS, len(poses))).astype(int))]


def _before(eye: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    """Return a point 0.1 m in front of a place, as landmarks lie in walls."""
    away = math.dist(eye, place)
    share = max(0.0, 1.0 - 0.1 / away)
    return eye[0] + share * (place[0] - eye[0]), eye[1] + share * (place[1] - eye[1])


def _is(found: Landmark, truth: Landmark) -> bool:
    """Return True if a landmark in a scan is the given one."""
    return found.type == truth.type and _is_near(found, truth, NEAR_M, TURNED_RAD)


def _as_seen(alias: Landmark, looks: Sequence[Sequence[Landmark]]) -> Landmark | None:
    """Return the alias at the median, or else the mean, of its places in the scans; None if they do not agree."""
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
    """Return (x, y, turn from the alias's orientation) of the nearest landmark in a scan that is the alias."""
    found = (each for each in look if _is(each, alias))
    rows = ((_away(each, alias), each.x_m, each.y_m, _turn_between(alias, each)) for each in found)
    return min(rows)[1:]
