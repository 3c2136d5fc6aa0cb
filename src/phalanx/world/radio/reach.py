"""Neighbour lists: the robots in range of each robot, found with square cells as wide as the range.

The cost is linear in robots and neighbours. Lists are symmetric, sorted by robot, and determined by the positions.
Every other query for nearby robots (carrier sense, overlaps, contacts) uses these lists.

Robots are sorted into cells only now and then: candidates come from a little farther than the range (the skin). Until
a robot has moved by half of the skin, apart from the common motion, no other robot can be in range (Verlet 1967).
A robot's list is filtered from its candidates on the first query after a `rebuild`, as most robots send nothing
in between.
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
# Swarms up to this size have room for all pairs; a larger one initially has room for 32 neighbours each.
SMALL_SWARM = 1024
NEIGHBOURS = 32
# Relative to the range. A wider skin means fewer sortings, and more candidates to filter each time.
SKIN = 0.25


class Reach(NamedTuple):
    """Neighbour lists: those of robot i are `ids[near[i]:in_range(reach, i)]`."""

    range_m: float  # radio range, metres, inclusive
    skin_m: float  # extra distance of candidates; 0 sorts the robots again after every movement
    at: F64x2  # (N, 2), current positions, metres
    rebuild_count: I64x1  # (1,), number of calls of `rebuild`
    listed: I64x1  # (N,), value of `rebuild_count` when a robot's list was last filtered
    end: I64x1  # (N,), end of each robot's list
    ids: I32x1  # (room,)
    square: F32x1  # (room,), squared distance of each neighbour, m²
    cell: I64x2  # (N, 2), cell of each robot
    first: I32x1  # (power of two ≥ N,), first robot of each bucket of cells
    after: I32x1  # (N,), next robot of the same bucket
    sorted_at: F64x2  # (N, 2), positions when candidates were collected, NaN before
    near: I64x1  # (N + 1,), candidates of robot i are candidate_ids[near[i]:near[i + 1]]
    candidate_ids: I32x1  # (room,)
    least_m: F64x1  # (N,), distance of the nearest candidate then; infinite without candidates
    aisle: I32x1  # (N,), 0 is the hub; robots in different aisles are never in range of each other


pack = bundled(Reach)


def make_reach(robots: int, range_m: float, capacity: int | None = None, skin: float = SKIN) -> Reach:
    """Return empty lists, with room for `capacity` neighbours of all robots together.

    The default capacity always suffices for small swarms, and usually for large ones. `skin` is relative to the range,
    and adds room of its own.
    Raises: UsageError: no robots, or a range that is not a positive number.
    """
    if robots < 1:
        raise UsageError(f"{robots} robots", "use at least 1")
    if not 0 < range_m < math.inf:
        raise UsageError(f"range is {range_m} m", "use a positive number")
    if capacity is None:
        capacity = robots * (robots - 1 if robots <= SMALL_SWARM else NEIGHBOURS)
    buckets = 1 << (robots - 1).bit_length()
    room = max(capacity, min(robots * (robots - 1), math.ceil(capacity * (1 + skin) ** 2)))
    reach = Reach(
        range_m=float(range_m),
        skin_m=float(skin * range_m),
        at=np.zeros((robots, 2)),
        rebuild_count=np.zeros(1, np.int64),
        listed=np.zeros(robots, np.int64),
        end=np.zeros(robots, np.int64),
        ids=np.zeros(room, np.int32),
        square=np.zeros(room, np.float32),
        cell=np.zeros((robots, 2), np.int64),
        first=np.zeros(buckets, np.int32),
        after=np.zeros(robots, np.int32),
        sorted_at=np.full((robots, 2), np.nan),
        near=np.zeros(robots + 1, np.int64),
        candidate_ids=np.zeros(room, np.int32),
        least_m=np.zeros(robots),
        aisle=np.zeros(robots, np.int32),
    )
    return pack(reach)


def set_aisles(reach: Reach, hub: int, robots: int) -> None:
    """Put the first `hub` robots in the hub, and each further one in an aisle of its own, in range of the hub only."""
    reach.aisle[hub:robots] = np.arange(1, robots - hub + 1)


@kernel
def rebuild(reach: Reach, pos: F64x2) -> int:
    """Set the positions that the lists are for. Returns: the number of candidates of all robots together.

    If that number exceeds `len(reach.candidate_ids)` the lists are truncated (the last robots lack neighbours): make
    a larger Reach, and rebuild. `pos`: (N, 2), metres, finite.
    """
    found = reach.near[len(pos)]
    if _has_moved(reach, pos):
        found = _sort(reach, pos, reach.range_m + reach.skin_m)
        if found > len(reach.candidate_ids):  # too crowded: there may be room without the skin
            found = _sort(reach, pos, reach.range_m)
            reach.sorted_at[:] = np.nan
    for i in range(len(pos)):
        reach.at[i, 0], reach.at[i, 1] = pos[i, 0], pos[i, 1]
    reach.rebuild_count[0] += 1
    return found  # type: ignore[no-any-return]


@kernel
def in_range(reach: Reach, i: int) -> int:
    """Return the end of robot i's neighbour list, which begins at `near[i]` of `ids` and `square`."""
    if reach.listed[i] == reach.rebuild_count[0]:
        return reach.end[i]  # type: ignore[no-any-return]
    pos, end = reach.at, reach.near[i]
    limit = reach.range_m * reach.range_m
    for at in range(reach.near[i], reach.near[i + 1]):
        k = int(reach.candidate_ids[at])
        dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
        square = dx * dx + dy * dy
        if square <= limit and not in_different_aisles(reach, i, k):
            reach.ids[end] = k
            reach.square[end] = square
            end += 1
    reach.listed[i] = reach.rebuild_count[0]
    reach.end[i] = end
    return end  # type: ignore[no-any-return]


@kernel
def _has_moved(reach: Reach, pos: F64x2) -> bool:
    """Return whether robots have moved so far since candidates were collected that others may be in range.

    Common translation and common contraction, as of a flock on its way to a goal, are subtracted. Robots that are not
    candidates were farther apart than range plus skin: the contraction of that distance and each one's remaining motion
    would have to make up for the skin.
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
    if not (room >= 0.0 and abs(share) < 1.0):  # also for NaN, before the first sorting
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
    """Collect all robots' candidates within `width_m`, sorted by robot; return their number, stored or not."""
    count = len(pos)
    mask = len(reach.first) - 1
    width = width_m * 1.000001  # rounding of a distance must not skip a cell
    for bucket in range(len(reach.first)):
        reach.first[bucket] = END
    for i in range(count - 1, -1, -1):  # backwards, so that each bucket is in ascending order
        reach.cell[i, 0] = math.floor(pos[i, 0] / width)
        reach.cell[i, 1] = math.floor(pos[i, 1] / width)
        reach.sorted_at[i, 0], reach.sorted_at[i, 1] = pos[i, 0], pos[i, 1]
        bucket = _bucket(reach.cell[i, 0], reach.cell[i, 1], mask)
        reach.after[i] = reach.first[bucket]
        reach.first[bucket] = i
    total = 0
    limit = width_m * width
    for i in range(count):
        reach.near[i] = min(total, len(reach.candidate_ids))
        least = math.inf
        for nth in range(9):
            x, y = reach.cell[i, 0] + nth // 3 - 1, reach.cell[i, 1] + nth % 3 - 1
            k = int(reach.first[_bucket(x, y, mask)])
            while k != END:
                dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
                # Different cells may share a bucket: check the cell, or a robot would be listed twice.
                here = reach.cell[k, 0] == x and reach.cell[k, 1] == y
                square = dx * dx + dy * dy
                if here and k != i and square <= limit:
                    least = min(least, square)
                    if total < len(reach.candidate_ids):
                        _put_in_order(reach, reach.near[i], total, k)
                    total += 1
                k = int(reach.after[k])
        reach.least_m[i] = math.sqrt(least)
    reach.near[count] = min(total, len(reach.candidate_ids))
    return total


@kernel
def _put_in_order(reach: Reach, begin: int, end: int, k: int) -> None:
    while end > begin and reach.candidate_ids[end - 1] > k:
        reach.candidate_ids[end] = reach.candidate_ids[end - 1]
        end -= 1
    reach.candidate_ids[end] = k


@kernel
def in_different_aisles(reach: Reach, i: int, k: int) -> bool:
    """Return whether two robots are in different aisles."""
    return bool(reach.aisle[i] != reach.aisle[k] and reach.aisle[i] != 0 and reach.aisle[k] != 0)


@kernel
def _bucket(x: int, y: int, mask: int) -> int:
    return (x * 73856093 ^ y * 19349663) & mask
