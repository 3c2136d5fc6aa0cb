"""The hash search: everything that a robot can try at one moment, in order, until something matches.

Positions in a spiral around the estimate, as far as the robot is unsure of its pose, in the bins of headings that this
leaves open; windows of time around the clock's; actions of the pool; combinations of readings and messages. The number
of trials is itself an output: it tells how far the estimate was off (Encoded graphs §VI-F).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations, groupby, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.crypto.sha3 import Targets, padded, sha3_256
from phalanx.mission.file.canonical import AT_POSITION, Shape, canonical, cell_at, place_bytes
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import (
    LANDMARK_TYPES,
    Action,
    Cell,
    Experience,
    Landmark,
    Offset,
    bins_of,
    cell_of,
    number_or_nan,
    steps_of,
    window_of,
)
from phalanx.mission.pose.spread import pose_spread

from .cells import BIN_STEPS, RINGS, Doubt, Groups, Message, Searched, region_of, search_cells, spiral
from .fix import distance_m, sight_of
from .found import Claim, Found

READINGS_LIMIT = 16  # of one experience; combinations of more would let a chatty sensor eat the budget
CANDIDATES_LIMIT = 256  # sets of nodes that are kept ready
WINDOWS = (0, -1, 1)
LANDMARK_PLACES = range(1, AT_POSITION)


@dataclass(slots=True)
class Budget:
    """Tries that are left in this step, and those made."""

    left: int
    used: int = 0

    def spend(self, tries: int) -> None:
        """Count tries."""
        self.left -= tries
        self.used += tries


class Variant(NamedTuple):
    """One combination to try, apart from the position: what else goes into the hash."""

    landmark: Landmark | None
    sensors: tuple[bytes, ...]
    action: Action | None
    window: int | None
    messages: tuple[bytes, ...]

    def canonical(
        self, shape: Shape, cell: Cell, messages: tuple[bytes, ...] = (), previous: bytes | None = None
    ) -> bytes:
        """The canonical bytes of it in a cell; what else is in them is the profile's affair."""
        place = place_bytes(shape, cell, self.landmark.text if self.landmark else None)
        return canonical(
            place,
            sensors=self.sensors,
            action=self.action,
            window=self.window,
            messages=messages,
            previous=previous,
        )


def doubt_in(config: MissionConfig, seen: Experience) -> Doubt:
    """How far to search in an experience."""
    place = float(seen.x_m), float(seen.y_m)
    return Doubt(*place, pose_spread(seen.spread), sight_of(config), config.sigmas, config.tolerance_m)


def cells_around(
    shape: Shape, coding: CodingConfig, doubt: Doubt, landmark: Landmark | None, centre: Cell, offset: Offset
) -> list[Cell]:
    """The cells in which the thing may truly be that was seen in `centre`: ring after ring, likely bins first."""
    rings, steps, bins = _region(shape, coding, doubt, landmark, offset)
    return [
        centre._replace(
            x=centre.x + dx, y=centre.y + dy, bin=centre.bin if centre.bin < 0 else (centre.bin + step) % bins
        )
        for dx, dy in spiral(rings)
        for step in steps
    ]


def is_around(
    shape: Shape,
    coding: CodingConfig,
    doubt: Doubt,
    landmark: Landmark | None,
    centre: Cell,
    offset: Offset,
    cell: Cell,
) -> bool:
    """Whether `cell` is one of `cells_around`, of which there may be a thousand."""
    rings, steps, bins = _region(shape, coding, doubt, landmark, offset)
    return (
        max(abs(cell.x - centre.x), abs(cell.y - centre.y)) <= rings
        and cell.bin in {centre.bin if centre.bin < 0 else (centre.bin + step) % bins for step in steps}
        and cell.area == centre.area
    )


def _region(
    shape: Shape, coding: CodingConfig, doubt: Doubt, landmark: Landmark | None, offset: Offset
) -> tuple[int, list[int], int]:
    """How many rings of cells, by how many bins to either side, and how many bins there are."""
    if not shape.place:
        return 0, [0], 1
    x, y = (landmark.x_m, landmark.y_m) if landmark else (doubt.x_m, doubt.y_m)
    turn = number_or_nan(landmark.orientation_rad if landmark and shape.oriented else None)
    thing, group = np.array([x, y, turn, math.nan]), np.array([*offset.natural, 0.0])
    _, rings, up, down = region_of(thing, landmark is None, group, steps_of(coding), doubt)
    bins = bins_of(coding, LANDMARK_TYPES[shape.place - 1]) if landmark else 1
    return rings, [step for step, is_meant in zip(BIN_STEPS, (True, up, down), strict=True) if is_meant], bins


def fits(shape: Shape, landmark: Landmark) -> bool:
    """Whether the landmark has what the shape asks for."""
    return (
        landmark.type == LANDMARK_TYPES[shape.place - 1]
        and (not shape.oriented or landmark.orientation_rad is not None)
        and (not shape.area or landmark.area_m2 is not None)
        and (not shape.text or landmark.text is not None)
    )


def variants(shape: Shape, coding: CodingConfig, seen: Experience, heard: tuple[bytes, ...]) -> Iterator[Variant]:
    """All combinations of what was experienced that have this shape."""
    landmarks: list[Landmark | None] = [None]
    if shape.place in LANDMARK_PLACES:
        landmarks = [landmark for landmark in seen.landmarks if fits(shape, landmark)]
        if not landmarks:
            return
    now = window_of(coding, seen.t_s)
    windows = [now + step for step in WINDOWS] if shape.time else [None]
    actions = list(seen.actions) if shape.action else [None]
    sensors = combinations(dict.fromkeys(seen.sensors[:READINGS_LIMIT]), shape.sensors)
    messages = list(combinations(reversed(heard), shape.messages))
    for landmark, reading, action, window, message in product(landmarks, sensors, actions, windows, messages):
        yield Variant(landmark, reading, action, window, message)


def placed(
    shape: Shape,
    coding: CodingConfig,
    seen: Experience,
    heard: tuple[bytes, ...],
    offset: Offset,
    reach_dm: int,
) -> Iterator[tuple[Variant, Cell]]:
    """The variants that are near enough, each with the cell in which it was seen, or in which the robot is."""
    for variant in variants(shape, coding, seen, heard):
        landmark = variant.landmark
        if landmark and reach_dm and distance_m(seen, landmark) * 10 > reach_dm:
            continue
        if landmark:
            cell = cell_of(coding, offset, landmark.x_m, landmark.y_m, landmark)
            # Of a landmark only what the shape asks for.
            cell = Cell(cell.x, cell.y, cell.bin if shape.oriented else -1, cell.area if shape.area else -1)
        else:
            cell = cell_of(coding, offset, seen.x_m, seen.y_m) if shape.place else Cell(0, 0)
        yield variant, cell


@dataclass(frozen=True, slots=True)
class _Group:
    """Aliases that are searched with the same hashes: their cells are counted from the same offset."""

    offset: Offset
    reach_dm: int
    targets: Targets
    aliases: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Nodes and their aliases in groups, and what kernels read of them."""

    nodes: tuple[int, ...]
    groups: tuple[_Group, ...]
    arrays: Groups


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Variants whose hashes differ in nothing but the cell."""

    shape: Shape
    variants: tuple[Variant, ...]
    # (n, 4) x, y, orientation and area of each one's landmark, or the robot's; NaN for what is not asked
    things: NDArray[np.float64]
    message: Callable[[Cell], bytes]  # the canonical bytes at a cell
    lane: int  # of the first group


class PaperSearch:
    """The search in the paper profile: thousands of fast hashes, against all candidates at once.

    It remembers around which cells it found nothing. That changes how long a search takes, never what it finds or how
    many tries it counts, so two searches of one mission agree whatever they have seen before.
    """

    def __init__(self, mission: EncodedMission, config: MissionConfig) -> None:
        self._mission = mission
        self._config = config
        self._steps = steps_of(mission.header.coding)
        self._candidates: dict[tuple[int, ...], _Candidates] = {}
        self._searched = Searched()

    def _among(self, nodes: tuple[int, ...]) -> _Candidates:
        if nodes not in self._candidates:
            by_offset: dict[tuple[Offset, int], list[tuple[int, int]]] = {}
            for node in nodes:
                record = self._mission.nodes[node]
                for a, alias in enumerate(record.aliases):
                    by_offset.setdefault((alias.offset, record.reach_dm), []).append((node, a))
            if len(self._candidates) >= CANDIDATES_LIMIT:
                self._candidates.clear()
            groups = tuple(
                _Group(
                    offset, reach, Targets([self._mission.nodes[v].aliases[a].mark for v, a in aliases]), tuple(aliases)
                )
                for (offset, reach), aliases in by_offset.items()
            )
            arrays = Groups(
                np.array([(*group.offset.natural, group.reach_dm) for group in groups], np.float64).reshape(-1, 5),
                np.vstack([np.empty((0, 4), np.uint64), *(group.targets.rows for group in groups)]),
                np.cumsum([0, *(len(group.aliases) for group in groups)]),
            )
            self._candidates[nodes] = _Candidates(nodes, groups, arrays)
        return self._candidates[nodes]

    def run(
        self,
        nodes: tuple[int, ...],
        seen: Experience,
        heard: tuple[bytes, ...],
        released: bytes,
        budget: Budget,
    ) -> Iterator[Found]:
        """Matches, best first.

        Args:
            released: H of the node before, for chained nodes.
            budget: is spent; when nothing is left the search ends.
        """
        among = self._among(nodes)
        doubt = doubt_in(self._config, seen)
        kinds = {landmark.type for landmark in seen.landmarks}
        for shape in self._mission.header.shapes:
            if shape.place in LANDMARK_PLACES and LANDMARK_TYPES[shape.place - 1] not in kinds:
                continue
            for batch in self._batches(among, shape, seen, heard, released):
                search = self._around if shape.place else self._as_it_is
                yield from search(among, batch, doubt, budget)

    def _batches(
        self, among: _Candidates, shape: Shape, seen: Experience, heard: tuple[bytes, ...], released: bytes
    ) -> Iterator[_Batch]:
        coding = self._mission.header.coding

        def rest(variant: Variant) -> tuple[object, ...]:
            return variant.landmark.text if shape.text and variant.landmark else None, *variant[1:]

        for same, alike in groupby(variants(shape, coding, seen, heard), rest):
            batch = tuple(alike)
            previous = released if shape.previous else None

            def message(cell: Cell, one: Variant = batch[0], previous: bytes | None = previous) -> bytes:
                return one.canonical(shape, cell, one.messages, previous)

            things = [
                (
                    landmark.x_m,
                    landmark.y_m,
                    number_or_nan(landmark.orientation_rad if shape.oriented else None),
                    number_or_nan(landmark.area_m2 if shape.area else None),
                )
                if landmark
                else (seen.x_m, seen.y_m, math.nan, math.nan)
                for landmark in (variant.landmark for variant in batch)
            ]
            lane = self._searched.lane((among.nodes, shape, same, previous), len(RINGS) * len(among.groups))
            yield _Batch(shape, batch, np.array(things, np.float64), message, lane)

    def _around(self, among: _Candidates, batch: _Batch, doubt: Doubt, budget: Budget) -> Iterator[Found]:
        """Matches of what has a place: each landmark against each group, around its cell."""
        coding, shape = self._mission.header.coding, batch.shape
        is_own = shape.place not in LANDMARK_PLACES
        bins = 1 if is_own else bins_of(coding, LANDMARK_TYPES[shape.place - 1])
        at, first = cell_at(shape), 0
        message = Message(padded(batch.message(Cell(0, 0, 0, 0)), at), at // 8, at % 8 * 8)
        while first >= 0:
            pair, row, left, numbers, first = search_cells(
                first,
                batch.things,
                is_own,
                doubt,
                among.arrays,
                self._steps,
                bins,
                self._searched.known,
                batch.lane,
                budget.left,
                message,
            )
            budget.spend(budget.left - left)
            if pair >= 0:
                of, number = divmod(pair // len(BIN_STEPS), len(among.groups))
                group, cell = among.groups[number], Cell(*numbers)
                place = group.targets.place(row - int(among.arrays.ends[number]))
                yield _found(group, place, batch, batch.variants[of], cell)

    def _as_it_is(self, among: _Candidates, batch: _Batch, _doubt: Doubt, budget: Budget) -> Iterator[Found]:
        """Matches of what has no place: one hash each."""
        digest = sha3_256(batch.message(Cell(0, 0)))
        for variant, group in product(batch.variants, among.groups):
            if budget.left <= 0:
                return
            budget.spend(1)
            marks = [self._mission.nodes[v].aliases[a].mark for v, a in group.aliases]
            if digest in marks:
                yield _found(group, marks.index(digest), batch, variant, Cell(0, 0))


def _found(group: _Group, place: int, batch: _Batch, variant: Variant, cell: Cell) -> Found:
    node, alias = group.aliases[place]
    claim = Claim(node, alias, batch.shape, group.offset, cell, batch.message(cell))
    return Found(claim, variant.landmark, variant.action)
