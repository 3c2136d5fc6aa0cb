"""Generate random buildings, which test assumptions that hold only in the built-in floor plans.

`drawn:7` is a building of a kind chosen by the seed, `drawn:flat:7` one of the given kind. The same name always gives
the same building. All of it can be reached from the start pose, through gaps of at least 0.8 m.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import pairwise
from random import Random

import numpy as np

from phalanx.errors import UsageError, did_you_mean
from phalanx.mission.landmarks.floorplan import FloorPlan
from phalanx.mission.landmarks.outlines import outlines_of

from .bricks import Box, Door, Site

PREFIX = "drawn:"
SEED_MAX = 10**9
# Width of the passage beyond the last rack.
WAY_ROUND_M = 1.2
# Share of the buildings that are rotated in their map.
TURNED = 0.25
_NAME = re.compile(r"drawn:(?:([a-z]+):)?(\d{1,10})")


def drawn(name: str) -> FloorPlan:
    """Return the floor plan named `drawn:SEED` or `drawn:KIND:SEED`. Raises: UsageError: there is none."""
    match = _NAME.fullmatch(name)
    if match is None or int(match[2]) > SEED_MAX:
        near = did_you_mean(name.partition(":")[2].partition(":")[0], KINDS)
        hint = f"{near}use {PREFIX}SEED, or {PREFIX}KIND:SEED: {', '.join(KINDS)}"
        raise UsageError(f"no building is called {name!r}", hint)
    seed = int(match[2])
    kind = match[1] or tuple(KINDS)[seed % len(KINDS)]
    if kind not in KINDS:
        raise UsageError(f"no kind of building is called {kind!r}", f"{did_you_mean(kind, KINDS)}{', '.join(KINDS)}")
    random = Random(f"{kind}:{seed}")  # noqa: S311  # for a floor plan, not for a key
    site = KINDS[kind](random)
    return _plan(f"{PREFIX}{kind}:{seed}", site, random.uniform(-0.8, 0.8) if random.random() < TURNED else 0.0)


def _plan(name: str, site: Site, turn_rad: float) -> FloorPlan:
    x, y, heading = site.start()
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    turned = np.array([[cosine, sine], [-sine, cosine]])
    walls = np.vstack([site.walls(), [x, y, x, y]]).reshape(-1, 2) @ turned
    walls -= walls.min(0)
    *ends, (x, y, _, _) = np.round(walls, 4).reshape(-1, 4).tolist()
    walls = np.array(ends)
    across, up = walls.reshape(-1, 2).max(0).tolist()
    bounds = (0.0, 0.0, across, up)
    walls.setflags(write=False)
    return FloorPlan(name, walls, outlines_of(walls, bounds, (x, y)), bounds, (x, y, round(heading + turn_rad, 4)))


def _office(random: Random) -> Site:
    """Draw rooms of different sizes on both sides of a corridor."""
    site = _site(random, (16, 30), (10, 18))
    _rooms_along(site, site.width_m)
    return site


def _mirror(random: Random) -> Site:
    """Draw an office whose right half mirrors its left half."""
    site = _site(random, (18, 28), (10, 16))
    _rooms_along(site, site.width_m / 2)
    width = site.width_m
    for boxes in (site.solids, site.sheets, site.things, site.clear, site.rooms):
        boxes += [Box(width - box.x1, box.y0, width - box.x0, box.y1) for box in boxes]
    return site


def _rooms_along(site: Site, until_m: float) -> None:
    """Draw furnished rooms on both sides of a corridor from the left edge to `until_m`."""
    wide = site.between(1.6, 2.8)
    below = round(site.between(0.4, 0.6) * site.height_m - wide / 2, 3)
    above = round(below + wide, 3)
    site.rooms.append(Box(0.0, below, until_m, above).grown(-site.thick_m / 2))
    for low, high, front in ((0.0, below, below), (above, site.height_m, above)):
        ends, at = [0.0], 0.0
        while until_m - at > 6.0:
            at = round(at + site.between(2.8, min(7.0, until_m - at - 2.8)), 3)
            ends.append(at)
        ends.append(until_m)
        doors = [site.door(a, b) for a, b in pairwise(ends)]
        site.wall((0.0, front), (until_m, front), *doors)
        for x in ends[1:-1]:
            site.wall((x, low), (x, high), *([site.door(low, high, 0.8, 1.4)] if site.chance(0.25) else []))
        site.rooms += [Box(a, low, b, high).grown(-site.thick_m / 2) for a, b in pairwise(ends)]
    for room in site.rooms[1:]:
        site.furnish(room, site.random.randrange(4))


def _alike(random: Random) -> Site:
    """Draw a corridor with identical rooms, including the furniture."""
    count = random.randint(4, 7)
    room_m, deep, wide = (round(random.uniform(*limits), 3) for limits in ((3, 4.5), (3, 5), (1.6, 2.6)))
    site = Site(round(count * room_m, 3), round(2 * deep + wide, 3), random, random.choice((0.0, 0.12, 0.2)))
    door = site.door(0.0, room_m)
    fronts = (deep, round(deep + wide, 3))
    doors = [Door(i * room_m + door.at_m, door.width_m) for i in range(count)]
    for front in fronts:
        site.wall((0.0, front), (site.width_m, front), *doors)
    site.rooms.append(Box(0.0, fronts[0], site.width_m, fronts[1]).grown(-site.thick_m / 2))
    mirrored = site.chance(0.5)
    for low, high in ((0.0, fronts[0]), (fronts[1], site.height_m)):
        for i in range(count):
            if i:
                site.wall((round(i * room_m, 3), low), (round(i * room_m, 3), high))
            site.rooms.append(Box(i * room_m, low, (i + 1) * room_m, high).grown(-site.thick_m / 2))
    first = site.rooms[1]
    site.furnish(first, random.randrange(4))
    copied = tuple(site.things)
    for i, room in enumerate(site.rooms[2:], 1):
        for x0, y0, x1, y1 in copied:
            dx = room.x0 - first.x0
            above = i >= count and mirrored
            low, high = (first.y1 - y1, first.y1 - y0) if above else (y0 - first.y0, y1 - first.y0)
            site.put(Box(x0 + dx, room.y0 + low, x1 + dx, room.y0 + high), room)
    return site


def _flat(random: Random) -> Site:
    """Draw a small flat, full of furniture, with narrow doors."""
    site = _site(random, (7.5, 13), (6.5, 11))
    waiting = [Box(0.0, 0.0, site.width_m, site.height_m)]
    while waiting:
        box = waiting.pop()
        halves = _halved(site, box) if max(box.x1 - box.x0, box.y1 - box.y0) > site.between(3.5, 6.5) else []
        waiting += halves
        if not halves:
            site.rooms.append(box.grown(-site.thick_m / 2))
    for room in site.rooms:
        site.furnish(room, 2 + random.randrange(4))
    return site


def _halved(site: Site, box: Box) -> list[Box]:
    """Divide a space by a wall with a door, and return both parts; return none if the wall would block another door."""
    horizontal = box.y1 - box.y0 > box.x1 - box.x0  # direction of the wall
    low, high = (box.y0, box.y1) if horizontal else (box.x0, box.x1)
    for _ in range(8):
        at = site.between(low + 0.35 * (high - low), low + 0.65 * (high - low))
        wall = Box(box.x0, at, box.x1, at) if horizontal else Box(at, box.y0, at, box.y1)
        if all(wall.away_m(clear) > site.thick_m for clear in site.clear) and min(at - low, high - at) > 2.0:
            door = site.door(*((box.x0, box.x1) if horizontal else (box.y0, box.y1)), 0.8, 1.3)
            site.wall((wall.x0, wall.y0), (wall.x1, wall.y1), door)
            if horizontal:
                return [Box(box.x0, box.y0, box.x1, at), Box(box.x0, at, box.x1, box.y1)]
            return [Box(box.x0, box.y0, at, box.y1), Box(at, box.y0, box.x1, box.y1)]
    return []


def _one_room_or_two(site: Site, two: float) -> None:
    """Use the whole building as one room, or with probability `two` divide it by a wall with a door."""
    ends = [0.0, site.width_m]
    if site.chance(two):
        ends.insert(1, site.between(0.4 * site.width_m, 0.6 * site.width_m))
        site.wall((ends[1], 0.0), (ends[1], site.height_m), site.door(0.0, site.height_m))
    site.rooms += [Box(a, 0.0, b, site.height_m).grown(-site.thick_m / 2) for a, b in pairwise(ends)]


def _pillars(random: Random) -> Site:
    """Draw a hall with rows of square pillars, sometimes divided by a wall."""
    site = _site(random, (13, 26), (9, 18))
    edge, step, first = site.between(0.3, 0.9), site.between(2.2, 5.0), site.between(1.5, 3.0)
    _one_room_or_two(site, 0.5)
    for room in site.rooms:
        for x in np.arange(room.x0 + first, room.x1 - edge, step).round(3).tolist():
            for y in np.arange(room.y0 + first, room.y1 - edge, step).round(3).tolist():
                site.put(Box(x, y, x + edge, y + edge), room)
        site.furnish(room, random.randrange(5))
    return site


def _racks(random: Random) -> Site:
    """Draw a hall with rows of racks, an aisle between rows, and a cross aisle."""
    site = _site(random, (14, 26), (10, 18))
    deep, aisle, end = site.between(0.6, 1.3), site.between(1.6, 3.0), site.between(1.8, 3.2)
    cross, parts = site.between(1.8, 3.0), random.randint(1, 2)
    room = Box(0.0, 0.0, site.width_m, site.height_m)
    site.rooms.append(room)
    long = round((site.width_m - 2 * end - (parts - 1) * cross) / parts, 3)
    against = site.chance(0.4)
    for y in np.arange(0.0 if against else aisle, site.height_m - deep - WAY_ROUND_M, deep + aisle).round(3).tolist():
        for part in range(parts):
            x = round(end + part * (long + cross), 3)
            if not site.chance(0.1):
                site.put(Box(x, y, x + long, y + deep), room)
    for _ in range(random.randrange(5)):
        site.put_rotated(room)
    return site


def _corridor(random: Random) -> Site:
    """Draw long corridors with corners, with landmarks only at the ends, where each leads through a door to a room."""
    wide, thick = round(random.uniform(1.5, 2.4), 3), random.choice((0.1, 0.2, 0.3))
    across, up = round(random.uniform(10, 20), 3), round(random.uniform(7, 14), 3)
    room_m = [round(random.uniform(3.0, 5.5), 3) for _ in range(4)]
    left, low = room_m[0] + thick, 0.5
    site = Site(left + across + room_m[2] + thick, max(up, 6.5) + 0.5 + low, random, thick)
    right, high = left + across, low + up
    site.carved += [Box(left, low, right, low + wide), Box(right - wide, low, right, high)]
    is_ring = site.chance(0.4)
    if is_ring:
        site.carved += [Box(left, high - wide, right, high), Box(left, low, left + wide, high)]
    elif site.chance(0.6):
        site.carved.append(Box(left + 3.0, high - wide, right, high))
    site.rooms += site.carved
    first = Box(0.0, low, room_m[0], low + min(room_m[1], up))
    last = Box(right + thick, high - min(room_m[3], up), right + thick + room_m[2], high)
    for room, (a, b), inner in (
        (first, (low, low + wide), Box(first.x1, 0.0, left, 0.0)),
        (last, (high - wide, high), Box(right, 0.0, last.x0, 0.0)),
    ):
        width = site.between(0.8, min(2.0, wide - 0.4))
        at = site.between(a + 0.2 + width / 2, b - 0.2 - width / 2)
        gap = Box(inner.x0, round(at - width / 2, 3), inner.x1, round(at + width / 2, 3))
        site.carved += [room, gap]
        site.clear.append(Box(gap.x0 - 0.9, gap.y0, gap.x1 + 0.9, gap.y1))
        site.rooms.append(room)
        site.furnish(room, random.randrange(4))
    return site


def _clutter(random: Random) -> Site:
    """Draw one or two rooms full of rotated boxes."""
    site = _site(random, (9, 17), (8, 13))
    _one_room_or_two(site, 0.6)
    for room in site.rooms:
        site.furnish(room, random.randrange(4))
        for _ in range(random.randint(4, 14)):
            site.put_rotated(room)
    return site


def _site(random: Random, widths: tuple[float, float], heights: tuple[float, float]) -> Site:
    width, height = (round(random.uniform(*each), 3) for each in (widths, heights))
    return Site(width, height, random, random.choice((0.0, 0.0, 0.1, 0.15, 0.2, 0.3)))


KINDS: dict[str, Callable[[Random], Site]] = {
    "office": _office,
    "alike": _alike,
    "flat": _flat,
    "pillars": _pillars,
    "racks": _racks,
    "corridor": _corridor,
    "mirror": _mirror,
    "clutter": _clutter,
}
