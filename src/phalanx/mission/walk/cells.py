"""Cells, compiled: the one that a seen thing falls into, and the search around it, with a memory.

What was searched before (searched.py) changes how long a search takes, never what it finds or how many tries it counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x1, F64x2, I64x1, I64x2, U64x1, U64x2
from phalanx.bundle import bundled
from phalanx.crypto.sha3 import find
from phalanx.kernel import kernel
from phalanx.mission.pose.spread import Sight, doubt_of

from .searched import RINGS_MOST, SPIRAL, Known, Numbers, keep, keep_tiles, row_of, untried

CELL_LIMIT = 1 << 30  # cells from the origin: further away is nonsense, and would not fit

Steps = tuple[float, float, float, float]


class Groups(NamedTuple):
    """Shapes that are searched together, as kernel arrays."""

    rows: F64x2  # (m, 5) offset of the cells, and the reach in 0.1 m from which things count, or 0
    targets: U64x2  # (t, 4) digests, those of a group together and sorted
    ends: I64x1  # (m + 1,) group g has those from ends[g] to ends[g + 1]


class Doubt(NamedTuple):
    """How sure the robot is of its pose, and how far it searches for that."""

    x_m: float  # where it believes to be
    y_m: float
    spread: F64x2  # (3, 3)
    sight: Sight
    sigmas: float
    tolerance_m: float


class Message(NamedTuple):
    """Message to hash in 8-byte words with SHA3 padding; zeros where x, y, bin and area go."""

    template: U64x1
    word: int  # where x begins
    shift: int  # by so many bits


class Shapes(NamedTuple):
    """Shapes of which nothing but a place goes into the hash, with what they are searched among: one call for all."""

    asks: I64x2  # (s, 3) kind of the landmark, or OWN for the robot's own place; whether its orientation, its area
    at: I64x2  # (s, 3) bins, and of the message: the word where x begins, by so many bits
    lanes: I64x2  # (s, m) of each group
    templates: U64x2  # (s, w) messages
    # As in `Groups` and `Known`
    rows: F64x2
    targets: U64x2
    ends: I64x1
    table: I64x2
    tiles: I64x2
    used: I64x1


pack = bundled(Shapes)
OWN = -1

# So many rings are searched, or more; what is kept of earlier searches is kept for each.
RINGS = (0, 1, 2, 3, 5, 7, 10, 14, 20, 28, RINGS_MOST)
BIN_STEPS = (0, 1, -1)


@kernel
def _number(value: float, offset: float, step: float) -> int:
    # rint rounds halves to even, on every machine and as `round` does.
    return int(np.rint((value - offset) / step))


@kernel
def numbers_of(
    x_m: float, y_m: float, turn_rad: float, area_m2: float, offset: Steps, steps: Steps, bins: int
) -> Numbers:
    """(x, y, bin, area) of the cell of a thing; -1 where it has no orientation or no area, which is NaN.

    Args:
        offset: of the cells: metres, metres, radians, square metres.
        steps: from one cell to the next: metres, metres, radians, square metres.
        bins: in a full turn, or in half of one.
    Source: Encoded graphs §IV-A.
    """
    x, y = _number(x_m, offset[0], steps[0]), _number(y_m, offset[1], steps[1])
    turn, area = -1, -1
    if not np.isnan(turn_rad):
        turn = _number(turn_rad, offset[2], steps[2]) % bins
    if not np.isnan(area_m2):
        area = max(0, min(CELL_LIMIT, _number(area_m2, offset[3], steps[3])))
    return max(-CELL_LIMIT, min(CELL_LIMIT, x)), max(-CELL_LIMIT, min(CELL_LIMIT, y)), turn, area


@kernel
def level_of(thing: F64x1, place: bool, steps: Steps, doubt: Doubt) -> int:
    """Return the level of RINGS that is searched around a thing's cell.

    Args:
        thing: (4,) x, y, orientation and area.
        place: it is the robot's own place, and no landmark.
    """
    ox, oy = thing[0] - doubt.x_m, thing[1] - doubt.y_m
    _, _, most = doubt_of(doubt.spread, ox, oy, doubt.sight)
    if place:
        most = math.sqrt(max(doubt.spread[0, 0], doubt.spread[1, 1]))
    # What is in the middle of its cell is so many cells away at most, from wherever in a cell it was seen.
    wanted = int(np.ceil(min(doubt.sigmas * most, doubt.tolerance_m) / steps[0] + 0.5)) - 1
    level = 0
    while level + 1 < len(RINGS) and RINGS[level] < wanted:
        level += 1
    return level


@kernel
def bins_beside(turn_rad: float, offset_rad: float, step_rad: float, doubt: Doubt) -> tuple[bool, bool]:
    """Return whether the next bin of an orientation may be meant, and whether the one before may."""
    if np.isnan(turn_rad):
        return False, False
    turn = (turn_rad - offset_rad) / step_rad
    rest = turn - np.rint(turn)
    sight = doubt.sight.turn_rad
    reach = doubt.sigmas * math.sqrt(doubt.spread[2, 2] + sight * sight) / step_rad
    return rest + reach > 0.5, rest - reach < -0.5


@kernel
def search_cells(  # noqa: C901  # a kernel is one function
    first: int,
    things: F64x2,
    place: bool,
    doubt: Doubt,
    groups: Groups,
    steps: Steps,
    bins: int,
    known: Known,
    lanes: I64x1,
    left: int,
    message: Message,
) -> tuple[int, int, int, Numbers, int]:
    """(pair, row of the targets, tries left, cell, next pair) of the next match, looked for around cell after cell.

    What is found to have nothing around it is remembered, and not searched again; its tries are spent all the same.

    Args:
        first: pair to begin with; pair k is thing k // 3 // groups, group k // 3 % groups, and bin step k % 3.
        things: (n, 4) x, y, orientation and area, NaN where there is none.
        place: they are the robot's own place, and no landmarks.
        lanes: (m,) the first lane of each group; those for further levels of RINGS follow.
    Returns: pair -1 where nothing more is found, by all pairs or by what tries there are.
    """
    rows, table = groups.rows, known.table
    trial = np.empty_like(message.template)
    of, level, away_dm = -1, 0, 0.0
    for pair in range(first, 3 * len(things) * len(rows)):
        g, step = pair // 3 % len(rows), BIN_STEPS[pair % 3]
        thing, group = things[pair // 3 // len(rows)], rows[g]
        if pair // 3 // len(rows) != of:
            of = pair // 3 // len(rows)
            dx, dy = thing[0] - doubt.x_m, thing[1] - doubt.y_m
            level, away_dm = level_of(thing, place, steps, doubt), math.sqrt(dx * dx + dy * dy) * 10
        if group[4] > 0.0 and away_dm > group[4]:
            continue
        if step != 0:
            up, down = bins_beside(thing[2], group[2], steps[2], doubt)
            if (step == 1 and not up) or (step == -1 and not down):
                continue
        wanted = RINGS[level]
        if left <= 0:
            break
        offset = (group[0], group[1], group[2], group[3])
        turn = thing[2] + step * steps[2]
        numbers = numbers_of(thing[0], thing[1], turn, thing[3], offset, steps, bins)
        own = lanes[g] + level
        # With fewer tries left a search has fewer rings, and is another one.
        rings = min(wanted, (int(math.sqrt(left)) + 1) // 2)
        if rings == wanted and table[row_of(table, own, numbers), 0] != 0:
            left -= (2 * rings + 1) * (2 * rings + 1)
            continue
        trial[:] = message.template
        if not place:
            _put(trial, message, np.uint64(numbers[2] & 0xFFFF) | np.uint64(numbers[3] & 0xFFFFFFFF) << np.uint64(16))
        words, places, bits = untried(known, lanes[g], numbers, rings)
        targets = groups.targets[groups.ends[g] : groups.ends[g + 1]]
        hit, row = find(trial, message.word, np.uint64(message.shift), words, targets)
        if hit >= 0:
            cell = places[hit]
            x, y = numbers[0] + int(SPIRAL[cell, 0]), numbers[1] + int(SPIRAL[cell, 1])
            return pair, groups.ends[g] + row, left - cell - 1, (x, y, numbers[2], numbers[3]), pair + 1
        left -= (2 * rings + 1) * (2 * rings + 1)
        keep_tiles(known, lanes[g], numbers, rings, bits)
        if rings == wanted:
            keep(known, own, numbers)
    return -1, -1, left, (0, 0, 0, 0), -1


@kernel
def search_shapes(
    begin: tuple[int, int], shapes: Shapes, seen: F64x2, doubt: Doubt, steps: Steps, left: int
) -> tuple[int, int, int, int, int, Numbers, int]:
    """(shape, thing seen, pair, row of the targets, tries left, cell, next pair) of the next match of any shape.

    Args:
        begin: shape and pair to begin with.
        seen: (k, 5) kind, x, y, orientation and area of landmarks, NaN where there is none.
    Returns: shape -1 where nothing more is found. The rest is as `search_cells` has it.
    """
    first, pair = begin
    groups, known = Groups(shapes.rows, shapes.targets, shapes.ends), Known(shapes.table, shapes.tiles, shapes.used)
    things, which = np.empty((len(seen) + 1, 4)), np.empty(len(seen) + 1, np.int64)
    for s in range(first, len(shapes.asks)):
        kind, oriented, area = shapes.asks[s, 0], shapes.asks[s, 1] != 0, shapes.asks[s, 2] != 0
        found = 0
        if kind == OWN:
            things[0, 0], things[0, 1], things[0, 2], things[0, 3] = doubt.x_m, doubt.y_m, np.nan, np.nan
            which[0] = -1
            found = 1
        for k in range(len(seen)):
            if seen[k, 0] != kind or (oriented and np.isnan(seen[k, 3])) or (area and np.isnan(seen[k, 4])):
                continue
            things[found, 0], things[found, 1] = seen[k, 1], seen[k, 2]
            things[found, 2], things[found, 3] = seen[k, 3] if oriented else np.nan, seen[k, 4] if area else np.nan
            which[found] = k
            found += 1
        bins, word, shift = shapes.at[s, 0], shapes.at[s, 1], shapes.at[s, 2]
        message = Message(shapes.templates[s], word, shift)
        hit, row, left, numbers, after = search_cells(
            pair, things[:found], kind == OWN, doubt, groups, steps, bins, known, shapes.lanes[s], left, message
        )
        if hit >= 0:
            return s, which[hit // 3 // len(groups.rows)], hit, row, left, numbers, after
        pair = 0
    return -1, -1, -1, -1, left, (0, 0, 0, 0), -1


@kernel
def _put(trial: U64x1, message: Message, six: np.uint64) -> None:
    """Six bytes, behind the eight of x and y: bin and area."""
    shift = np.uint64(message.shift)
    trial[message.word + 1] ^= six << shift
    if shift > np.uint64(16):
        trial[message.word + 2] ^= six >> (np.uint64(64) - shift)
