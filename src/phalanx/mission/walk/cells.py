"""Kernels for cells: the cell that a seen landmark falls into, and the hash search in the cells around it.

Remembered searches (searched.py) change how long a search takes, never what it finds or how many tries it counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x1, F64x2, I64x1, I64x2, U64x1, U64x2
from phalanx.bundle import bundled
from phalanx.crypto.sha3 import find
from phalanx.kernel import kernel
from phalanx.mission.pose.spread import Sight, place_deviations

from .searched import RINGS_MOST, SPIRAL, Known, Numbers, keep, keep_tiles, row_of, untried

CELL_LIMIT = 1 << 30  # largest cell number: larger ones are implausible and would not fit the encoding

Steps = tuple[float, float, float, float]


class Groups(NamedTuple):
    """Groups of node aliases whose cells have the same offset, as kernel arrays."""

    rows: F64x2  # (m, 5) offset of the cells, and the largest distance to a landmark in 0.1 m, or 0 for any
    targets: U64x2  # (t, 4) digests, sorted within each group
    ends: I64x1  # (m + 1,) group g has the targets from ends[g] to ends[g + 1]


class PoseUncertainty(NamedTuple):
    """Uncertainty of the robot's pose, and limits of the search that follow from it."""

    x_m: float  # estimated position
    y_m: float
    spread: F64x2  # (3, 3) covariance of x, y, heading
    sight: Sight
    sigmas: float
    tolerance_m: float


class Message(NamedTuple):
    """Message to hash, in 8-byte words with SHA3 padding, with zeros in place of x, y, bin and area."""

    template: U64x1
    word: int  # index of the word in which x begins
    shift: int  # bits by which x is shifted in this word


class Shapes(NamedTuple):
    """Shapes whose hash depends on a place only, and the groups to search them in: one kernel call for all."""

    asks: I64x2  # (s, 3) kind of the landmark, or OWN for the robot's position; 1 if it has an orientation, an area
    at: I64x2  # (s, 3) number of bins; `word` and `shift` of the Message
    lanes: I64x2  # (s, m) first lane of each group
    templates: U64x2  # (s, w) messages
    # Fields of `Groups` and `Known`
    rows: F64x2
    targets: U64x2
    ends: I64x1
    table: I64x2
    tiles: I64x2
    used: I64x1


pack = bundled(Shapes)
OWN = -1

# Numbers of rings to search: a wanted number is rounded up to one of these, and each has its own memory of searches.
RINGS = (0, 1, 2, 3, 5, 7, 10, 14, 20, 28, RINGS_MOST)
BIN_STEPS = (0, 1, -1)


@kernel
def _number(value: float, offset: float, step: float) -> int:
    # rint rounds halves to even on every machine, as `round` does.
    return int(np.rint((value - offset) / step))


@kernel
def numbers_of(
    x_m: float, y_m: float, turn_rad: float, area_m2: float, offset: Steps, steps: Steps, bins: int
) -> Numbers:
    """Return (x, y, bin, area) of a landmark's cell; bin or area is -1 if the orientation or the area is NaN.

    Args:
        offset: offset of the cells: metres, metres, radians, square metres.
        steps: size of a cell: metres, metres, radians, square metres.
        bins: number of bins in a full turn, or in half a turn for symmetric landmarks.
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
def level_of(thing: F64x1, place: bool, steps: Steps, doubt: PoseUncertainty) -> int:
    """Return the index into RINGS for the search around a landmark's cell.

    Args:
        thing: (4,) x, y, orientation and area.
        place: True for the robot's own position, False for a landmark.
    """
    ox, oy = thing[0] - doubt.x_m, thing[1] - doubt.y_m
    _, _, most = place_deviations(doubt.spread, ox, oy, doubt.sight)
    if place:
        most = math.sqrt(max(doubt.spread[0, 0], doubt.spread[1, 1]))
    # The encoded landmark is in the middle of its cell, the seen one anywhere in its cell: add half a cell.
    wanted = int(np.ceil(min(doubt.sigmas * most, doubt.tolerance_m) / steps[0] + 0.5)) - 1
    level = 0
    while level + 1 < len(RINGS) and RINGS[level] < wanted:
        level += 1
    return level


@kernel
def bins_beside(turn_rad: float, offset_rad: float, step_rad: float, doubt: PoseUncertainty) -> tuple[bool, bool]:
    """Return (True if the orientation may truly be in the next bin, True if in the previous one)."""
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
    doubt: PoseUncertainty,
    groups: Groups,
    steps: Steps,
    bins: int,
    known: Known,
    lanes: I64x1,
    left: int,
    message: Message,
) -> tuple[int, int, int, Numbers, int]:
    """Search around cell after cell; return (pair, row of the targets, tries left, cell, next pair) of the next match.

    Cells without a match around them are remembered and not searched again, but their tries are counted all the same.

    Args:
        first: pair to begin with; pair k is thing k // 3 // groups, group k // 3 % groups, and bin step k % 3.
        things: (n, 4) x, y, orientation and area, NaN where there is none.
        place: True if `things` are the robot's own position, False for landmarks.
        lanes: (m,) first lane of each group; the lanes for higher indices into RINGS follow it.
    Returns: pair is -1 if there is no further match, or if no tries are left.
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
        # With few tries left the search covers fewer rings; such a search is not remembered.
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
    begin: tuple[int, int], shapes: Shapes, seen: F64x2, doubt: PoseUncertainty, steps: Steps, left: int
) -> tuple[int, int, int, int, int, Numbers, int]:
    """Return (shape, landmark, pair, row of the targets, tries left, cell, next pair) of the next match of any shape.

    Args:
        begin: shape and pair to start with.
        seen: (k, 5) kind, x, y, orientation and area of landmarks, NaN where there is none.
    Returns: shape is -1 if there is no further match; landmark is a row of `seen`; others as in `search_cells`.
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
    """Write bin and area, six bytes, after the eight bytes of x and y."""
    shift = np.uint64(message.shift)
    trial[message.word + 1] ^= six << shift
    if shift > np.uint64(16):
        trial[message.word + 2] ^= six >> (np.uint64(64) - shift)
