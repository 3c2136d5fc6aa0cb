"""Who is in range of whom, as lists: robots are sorted into square cells as wide as the range.

The cost is linear in robots and neighbours. Lists are symmetric, in the order of robots, and the same for the same
positions. Everything else that asks for robots nearby (carrier sense, overlaps, contacts) goes through these lists.

Robots are sorted into cells only now and then: candidates are noted from a little farther than the range (the skin),
and until somebody has gone half of that, nobody else can be in range (Verlet 1967).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    """Neighbours of each robot: of robot i they are `ids[start[i]:start[i + 1]]`."""

    range_m: float  # what counts as near, metres, inclusive
    skin_m: float  # candidates are from so much farther away; 0: robots are sorted anew each time that one has moved
    start: NDArray[np.int64]  # (N + 1,)
    ids: NDArray[np.int32]  # (capacity,)
    square: NDArray[np.float32]  # (capacity,), how far each of them is, metres squared
    cell: NDArray[np.int64]  # (N, 2), the cell each robot is in
    first: NDArray[np.int32]  # (power of two ≥ N,), the first robot of each bucket of cells
    after: NDArray[np.int32]  # (N,), the next robot of the same bucket
    sorted_at: NDArray[np.float64]  # (N, 2), where robots were when candidates were noted, NaN before
    near: NDArray[np.int64]  # (N + 1,), candidates of robot i are maybe[near[i]:near[i + 1]]
    maybe: NDArray[np.int32]  # (room,)
    aisle: NDArray[np.int32]  # (N,), 0 where all aisles meet; robots of different aisles are never near each other


pack = bundled(Reach)


def make_reach(robots: int, range_m: float, capacity: int | None = None, skin: float = SKIN) -> Reach:
    """Lists in which nobody is near anybody yet, with room for `capacity` neighbours of all robots together.

    None is room that small swarms always find enough, and large ones mostly. `skin` is a share of the range.
    Raises: UsageError: no robots, or a range that is not a positive number.
    """
    if robots < 1:
        raise UsageError(f"{robots} robots", "at least 1")
    if not 0 < range_m < math.inf:
        raise UsageError(f"range is {range_m} m", "a positive number")
    if capacity is None:
        capacity = robots * (robots - 1 if robots <= SMALL_SWARM else NEIGHBOURS)
    buckets = 1 << (robots - 1).bit_length()
    room = min(robots * (robots - 1), math.ceil(capacity * (1 + skin) ** 2))
    reach = Reach(
        float(range_m),
        float(skin * range_m),
        np.zeros(robots + 1, np.int64),
        np.zeros(capacity, np.int32),
        np.zeros(capacity, np.float32),
        np.zeros((robots, 2), np.int64),
        np.zeros(buckets, np.int32),
        np.zeros(robots, np.int32),
        np.full((robots, 2), np.nan),
        np.zeros(robots + 1, np.int64),
        np.zeros(max(room, capacity), np.int32),
        np.zeros(robots, np.int32),
    )
    return pack(reach)


@kernel
def rebuild(reach: Reach, pos: NDArray[np.float64]) -> int:
    """The number of neighbours of all robots together, and the lists are those of `pos`.

    If that number is greater than `len(reach.ids)` the lists are cut short (robots at the end have none or too few):
    make a larger Reach, and rebuild. `pos`: (N, 2), metres, finite.
    """
    found = 0
    if _has_moved(reach, pos):
        found = _sort(reach, pos, reach.range_m + reach.skin_m)
        if found > len(reach.maybe):  # a crowd: without the skin there may be room
            found = _sort(reach, pos, reach.range_m)
            reach.sorted_at[:] = np.nan
    count, total = len(pos), 0
    limit = reach.range_m * reach.range_m
    for i in range(count):
        reach.start[i] = min(total, len(reach.ids))
        for at in range(reach.near[i], reach.near[i + 1]):
            k = reach.maybe[at]
            dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
            square = dx * dx + dy * dy
            if square <= limit and not _walled(reach, i, k):
                if total < len(reach.ids):
                    reach.ids[total] = k
                    reach.square[total] = square
                total += 1
    reach.start[count] = min(total, len(reach.ids))
    return found if found > len(reach.maybe) else total


@kernel
def _has_moved(reach: Reach, pos: NDArray[np.float64]) -> bool:
    """Whether somebody has gone half the skin since candidates were noted, so that others may be in range."""
    most = 0.25 * reach.skin_m * reach.skin_m
    for i in range(len(pos)):
        dx, dy = pos[i, 0] - reach.sorted_at[i, 0], pos[i, 1] - reach.sorted_at[i, 1]
        if not (dx * dx + dy * dy <= most):  # nor where there was nobody
            return True
    return False


@kernel
def _sort(reach: Reach, pos: NDArray[np.float64], width_m: float) -> int:
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
        for nth in range(9):
            x, y = reach.cell[i, 0] + nth // 3 - 1, reach.cell[i, 1] + nth % 3 - 1
            k = reach.first[_bucket(x, y, mask)]
            while k != END:
                dx, dy = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
                # Cells share buckets: a robot counts for its own cell only, or it would be listed twice.
                here = reach.cell[k, 0] == x and reach.cell[k, 1] == y
                if here and k != i and dx * dx + dy * dy <= limit:
                    if total < len(reach.maybe):
                        _put_in_order(reach, reach.near[i], total, k)
                    total += 1
                k = reach.after[k]
    reach.near[count] = min(total, len(reach.maybe))
    return total


@kernel
def _put_in_order(reach: Reach, begin: int, end: int, k: int) -> None:
    while end > begin and reach.maybe[end - 1] > k:
        reach.maybe[end] = reach.maybe[end - 1]
        end -= 1
    reach.maybe[end] = k


@kernel
def _walled(reach: Reach, i: int, k: int) -> bool:
    return bool(reach.aisle[i] != reach.aisle[k] and reach.aisle[i] != 0 and reach.aisle[k] != 0)


@kernel
def _bucket(x: int, y: int, mask: int) -> int:
    return (x * 73856093 ^ y * 19349663) & mask
