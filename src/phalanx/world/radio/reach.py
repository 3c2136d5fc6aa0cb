"""List the robots in range of each robot, by square cells as wide as the range.

The cost is linear in robots and neighbours. Lists are symmetric, in the order of robots, and the same for the same
positions. Everything else that asks for robots nearby (carrier sense, overlaps, contacts) goes through these lists.

Robots are sorted into cells only now and then: candidates are noted from a little farther than the range (the skin),
and until somebody has gone half of that, beside what all have gone, nobody else can be in range (Verlet 1967). Who of
them is in range is found for each robot when somebody first asks, as most robots say nothing between two looks at where
all are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F32x1, F64x1, F64x2, I32x1, I64x1, I64x2
from phalanx.bundle import bundled
from phalanx.errors import UsageError
from phalanx.kernel import kernel

END = -1
# A swarm of this size gets room for every robot to hear every other; a larger one begins with room for 32 each.
SMALL_SWARM = 1024
NEIGHBOURS = 32
# Of the range. A wider skin means fewer sortings, and more candidates to look at each time.
SKIN = 0.25


class Reach(NamedTuple):
    """Neighbours of each robot i: they are `ids[near[i]:in_range(reach, i)]`."""

    range_m: float  # what counts as near, metres, inclusive
    skin_m: float  # candidates are from so much farther away; 0: robots are sorted anew each time that one has moved
    at: F64x2  # (N, 2), where robots are, metres
    looks: I64x1  # (1,), how often they have been looked at
    listed: I64x1  # (N,), the look at which a robot's neighbours were listed last
    end: I64x1  # (N,), where they end
    ids: I32x1  # (room,)
    square: F32x1  # (room,), how far each of them is, metres squared
    cell: I64x2  # (N, 2), the cell each robot is in
    first: I32x1  # (power of two ≥ N,), the first robot of each bucket of cells
    after: I32x1  # (N,), the next robot of the same bucket
    sorted_at: F64x2  # (N, 2), where robots were when candidates were noted, NaN before
    near: I64x1  # (N + 1,), candidates of robot i are maybe[near[i]:near[i + 1]]
    maybe: I32x1  # (room,)
    least_m: F64x1  # (N,), how far the nearest of them was then; infinite if there were none
    aisle: I32x1  # (N,), 0 where all aisles meet; robots of different aisles are never near each other


pack = bundled(Reach)


def make_reach(robots: int, range_m: float, capacity: int | None = None, skin: float = SKIN) -> Reach:
    """Lists in which nobody is near anybody yet, with room for `capacity` neighbours of all robots together.

    None is room that small swarms always find enough, and large ones mostly. `skin` is a share of the range, which
    gets room of its own.
    Raises: UsageError: no robots, or a range that is not a positive number.
    """
    if robots < 1:
        raise UsageError(f"{robots} robots", "at least 1")
    if not 0 < range_m < math.inf:
        raise UsageError(f"range is {range_m} m", "a positive number")
    if capacity is None:
        capacity = robots * (robots - 1 if robots <= SMALL_SWARM else NEIGHBOURS)
    buckets = 1 << (robots - 1).bit_length()
    room = max(capacity, min(robots * (robots - 1), math.ceil(capacity * (1 + skin) ** 2)))
    reach = Reach(
        range_m=float(range_m),
        skin_m=float(skin * range_m),
        at=np.zeros((robots, 2)),
        looks=np.zeros(1, np.int64),
        listed=np.zeros(robots, np.int64),
        end=np.zeros(robots, np.int64),
        ids=np.zeros(room, np.int32),
        square=np.zeros(room, np.float32),
        cell=np.zeros((robots, 2), np.int64),
        first=np.zeros(buckets, np.int32),
        after=np.zeros(robots, np.int32),
        sorted_at=np.full((robots, 2), np.nan),
        near=np.zeros(robots + 1, np.int64),
        maybe=np.zeros(room, np.int32),
        least_m=np.zeros(robots),
        aisle=np.zeros(robots, np.int32),
    )
    return pack(reach)


def set_aisles(reach: Reach, hub: int, robots: int) -> None:
    """Let the first `hub` robots hear all in range, and each further one only them."""
    reach.aisle[hub:robots] = np.arange(1, robots - hub + 1)


@kernel
def rebuild(reach: Reach, pos: F64x2) -> int:
    """Robots are looked at: lists are those of `pos` from now on. Returns: the number of candidates of all together.

    If that number is greater than `len(reach.maybe)` the lists are cut short (robots at the end have none or too few):
    make a larger Reach, and rebuild. `pos`: (N, 2), metres, finite.
    """
    found = reach.near[len(pos)]
    if _has_moved(reach, pos):
        found = _sort(reach, pos, reach.range_m + reach.skin_m)
        if found > len(reach.maybe):  # a crowd: without the skin there may be room
            found = _sort(reach, pos, reach.range_m)
            reach.sorted_at[:] = np.nan
    for i in range(len(pos)):
        reach.at[i, 0], reach.at[i, 1] = pos[i, 0], pos[i, 1]
    reach.looks[0] += 1
    return found  # type: ignore[no-any-return]


@kernel
def in_range(reach: Reach, i: int) -> int:
    """Return the end of robot i's neighbour list, which begins at `near[i]` of `ids` and `square`."""
    if reach.listed[i] == reach.looks[0]:
        return reach.end[i]  # type: ignore[no-any-return]
    pos, end = reach.at, reach.near[i]
    limit = reach.range_m * reach.range_m
    for at in range(reach.near[i], reach.near[i + 1]):
        k = int(reach.maybe[at])
        dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
        square = dx * dx + dy * dy
        if square <= limit and not walled(reach, i, k):
            reach.ids[end] = k
            reach.square[end] = square
            end += 1
    reach.listed[i] = reach.looks[0]
    reach.end[i] = end
    return end  # type: ignore[no-any-return]


@kernel
def _has_moved(reach: Reach, pos: F64x2) -> bool:
    """Return whether a robot has moved so far since the candidates were noted that others may be in range.

    What all have gone together, and that all have come nearer to each other by the same share, as a flock does on its
    way to a goal, does not count. Two that were no candidates were farther apart than range and skin: that share of
    their distance, and what each has gone beside it, would have to make up for the skin.
    """
    count = len(pos)
    gone_x, gone_y, mean_x, mean_y, along, spread = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        x, y = reach.sorted_at[i, 0], reach.sorted_at[i, 1]
        dx, dy = pos[i, 0] - x, pos[i, 1] - y
        gone_x += dx
        gone_y += dy
        mean_x += x
        mean_y += y
        along += dx * x + dy * y
        spread += x * x + y * y
    gone_x /= count
    gone_y /= count
    mean_x /= count
    mean_y /= count
    along -= count * (gone_x * mean_x + gone_y * mean_y)
    spread -= count * (mean_x * mean_x + mean_y * mean_y)
    share = along / spread if spread > 0.0 else 0.0
    room = 0.5 * (reach.skin_m - abs(share) * (reach.range_m + reach.skin_m))
    if not (room >= 0.0 and abs(share) < 1.0):  # nor where there was nobody
        return True
    for i in range(count):
        x, y = reach.sorted_at[i, 0], reach.sorted_at[i, 1]
        dx = pos[i, 0] - x - gone_x - share * (x - mean_x)
        dy = pos[i, 1] - y - gone_y - share * (y - mean_y)
        if not (dx * dx + dy * dy <= room * room):
            return True
    return False


@kernel
def _sort(reach: Reach, pos: F64x2, width_m: float) -> int:
    """Everybody's candidates within `width_m` are noted, in the order of robots; their number, or more than fit."""
    count = len(pos)
    mask = len(reach.first) - 1
    width = width_m * 1.000001  # a distance that is rounded down to it must not skip a cell
    for bucket in range(len(reach.first)):
        reach.first[bucket] = END
    for i in range(count - 1, -1, -1):  # backwards, so that each bucket lists its robots in order
        reach.cell[i, 0] = math.floor(pos[i, 0] / width)
        reach.cell[i, 1] = math.floor(pos[i, 1] / width)
        reach.sorted_at[i, 0], reach.sorted_at[i, 1] = pos[i, 0], pos[i, 1]
        bucket = _bucket(reach.cell[i, 0], reach.cell[i, 1], mask)
        reach.after[i] = reach.first[bucket]
        reach.first[bucket] = i
    total = 0
    limit = width_m * width
    for i in range(count):
        reach.near[i] = min(total, len(reach.maybe))
        least = math.inf
        for nth in range(9):
            x, y = reach.cell[i, 0] + nth // 3 - 1, reach.cell[i, 1] + nth % 3 - 1
            k = int(reach.first[_bucket(x, y, mask)])
            while k != END:
                dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
                # Cells share buckets: a robot counts for its own cell only, or it would be listed twice.
                here = reach.cell[k, 0] == x and reach.cell[k, 1] == y
                square = dx * dx + dy * dy
                if here and k != i and square <= limit:
                    least = min(least, square)
                    if total < len(reach.maybe):
                        _put_in_order(reach, reach.near[i], total, k)
                    total += 1
                k = int(reach.after[k])
        reach.least_m[i] = math.sqrt(least)
    reach.near[count] = min(total, len(reach.maybe))
    return total


@kernel
def _put_in_order(reach: Reach, begin: int, end: int, k: int) -> None:
    while end > begin and reach.maybe[end - 1] > k:
        reach.maybe[end] = reach.maybe[end - 1]
        end -= 1
    reach.maybe[end] = k


@kernel
def walled(reach: Reach, i: int, k: int) -> bool:
    """Return whether the two are in different aisles."""
    return bool(reach.aisle[i] != reach.aisle[k] and reach.aisle[i] != 0 and reach.aisle[k] != 0)


@kernel
def _bucket(x: int, y: int, mask: int) -> int:
    return (x * 73856093 ^ y * 19349663) & mask
