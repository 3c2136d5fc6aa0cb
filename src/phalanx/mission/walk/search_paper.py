"""The fast search of the paper profile: thousands of hashes a step, against all candidates at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import groupby, product

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import MissionConfig
from phalanx.config.parameter import made_once
from phalanx.crypto.sha3 import Targets, padded, sha3_256
from phalanx.mission.file.canonical import AT_POSITION, Shape, cell_at
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import (
    LANDMARK_TYPES,
    Cell,
    Experience,
    Offset,
    bins_of,
    number_or_nan,
    rows_of,
    steps_of,
)

from .cells import BIN_STEPS, OWN, RINGS, Doubt, Groups, Message, Shapes, pack, search_cells, search_shapes
from .found import Claim, Found
from .search import LANDMARK_PLACES, Budget, Variant, doubt_in, variants
from .searched import Searched

TARGETS_LIMIT = 4096
_BARE = Variant(None, (), None, None, ())


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
    parts: dict[bytes, list[Shape | _Together]]  # the mission's shapes, by H of the node before


@dataclass(frozen=True, slots=True, eq=False)
class _Together:
    """Shapes that one call searches."""

    shapes: tuple[Shape, ...]
    arrays: Shapes


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Variants whose hashes differ in nothing but the cell."""

    shape: Shape
    variants: tuple[Variant, ...]
    # (n, 4) x, y, orientation and area of each one's landmark, or the robot's; NaN for what is not asked
    things: NDArray[np.float64]
    message: Callable[[Cell], bytes]  # the canonical bytes at a cell
    lanes: NDArray[np.int64]  # of the groups


class PaperSearch:
    """The search of one mission.

    It remembers around which cells it found nothing. That changes how long a search takes, never what it finds or how
    many tries it counts, so two searches of one mission agree whatever they have seen before.
    """

    def __init__(self, mission: EncodedMission, config: MissionConfig) -> None:
        self._mission = mission
        self._config = config
        self.steps = steps_of(mission.header.coding)
        self._among = made_once(self._candidates_of)
        self._targets = lru_cache(TARGETS_LIMIT)(self._targets_of)
        self._searched = Searched()

    def _targets_of(self, aliases: tuple[tuple[int, int], ...]) -> Targets:
        return Targets([self._mission.nodes[node].aliases[alias].mark for node, alias in aliases])

    def _candidates_of(self, nodes: tuple[int, ...]) -> _Candidates:
        by_offset: dict[tuple[Offset, int], list[tuple[int, int]]] = {}
        for node in nodes:
            record = self._mission.nodes[node]
            for a, alias in enumerate(record.aliases):
                by_offset.setdefault((alias.offset, record.reach_dm), []).append((node, a))
        groups = tuple(
            _Group(offset, reach, self._targets(tuple(aliases)), tuple(aliases))
            for (offset, reach), aliases in by_offset.items()
        )
        arrays = Groups(
            np.array([(*group.offset.natural, group.reach_dm) for group in groups], np.float64).reshape(-1, 5),
            np.vstack([np.empty((0, 4), np.uint64), *(group.targets.rows for group in groups)]),
            np.cumsum([0, *(len(group.aliases) for group in groups)]),
        )
        return _Candidates(nodes, groups, arrays, {})

    def _parts(self, among: _Candidates, released: bytes) -> list[Shape | _Together]:
        """The shapes, in their order; those that follow each other and ask for nothing but a place in one."""
        known = among.parts.get(released)
        if known is None:
            known = among.parts[released] = []
            for is_bare, same in groupby(self._mission.header.shapes, _is_bare):
                alike = tuple(same)
                known += [self._together(among, alike, released)] if is_bare else alike
        return known

    def _together(self, among: _Candidates, shapes: tuple[Shape, ...], released: bytes) -> _Together:
        asks, at, lanes, templates = [], [], [], []
        for shape in shapes:
            is_own, begin = shape.place == AT_POSITION, cell_at(shape)
            previous = released if shape.previous else None
            asks.append((OWN if is_own else shape.place - 1, shape.oriented, shape.area))
            at.append((self._bins(shape), begin // 8, begin % 8 * 8))
            lanes.append(self._lanes(among, shape, (None, *_BARE[1:]), previous))
            templates.append(padded(_BARE.canonical(shape, Cell(0, 0, 0, 0), (), previous), begin))
        searched = (*among.arrays, *self._searched.known)
        rows = np.array(lanes, np.int64)
        return _Together(shapes, pack(Shapes(np.array(asks), np.array(at), rows, np.array(templates), *searched)))

    def parts(self, nodes: tuple[int, ...], released: bytes) -> tuple[list[Shapes], list[Shape]]:
        """The shapes of a search that ask for nothing but a place, as kernels take them, packed; and the others."""
        parts = self._parts(self._among(nodes), released)
        together = [part.arrays for part in parts if isinstance(part, _Together)]
        return together or [self.nothing()], [part for part in parts if isinstance(part, Shape)]

    def nothing(self) -> Shapes:
        """What finds nothing, as kernels take it, packed."""
        none, searched = np.empty((0, 3), np.int64), (*self._among(()).arrays, *self._searched.known)
        return pack(Shapes(none, none, none, np.empty((0, 1), np.uint64), *searched))

    def _lanes(self, among: _Candidates, shape: Shape, rest: object, previous: bytes | None) -> list[int]:
        return [self._searched.lane((group.aliases, shape, rest, previous), len(RINGS)) for group in among.groups]

    def _bins(self, shape: Shape) -> int:
        is_own = shape.place not in LANDMARK_PLACES
        return 1 if is_own else bins_of(self._mission.header.coding, LANDMARK_TYPES[shape.place - 1])

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
        for part in self._parts(among, released):
            if isinstance(part, _Together):
                yield from self._at_once(among, part, seen, released, doubt, budget)
                continue
            for batch in self._batches(among, part, seen, heard, released):
                search = self._around if part.place else self._as_it_is
                yield from search(among, batch, doubt, budget)

    def _at_once(
        self, among: _Candidates, part: _Together, seen: Experience, released: bytes, doubt: Doubt, budget: Budget
    ) -> Iterator[Found]:
        """Matches of shapes that ask for nothing but a place."""
        rows, begin = rows_of(seen.landmarks), (0, 0)
        while True:
            s, k, pair, row, left, numbers, after = search_shapes(
                begin, part.arrays, rows, doubt, self.steps, budget.left
            )
            budget.spend(budget.left - left)
            if s < 0:
                return
            begin, shape = (s, after), part.shapes[s]
            landmark = seen.landmarks[k] if shape.place in LANDMARK_PLACES else None
            one, previous = _BARE._replace(landmark=landmark), released if shape.previous else None
            message = partial(one.canonical, shape, previous=previous)
            yield _found(among, pair, row, shape, one, Cell(*numbers), message)

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
            lanes = np.array(self._lanes(among, shape, same, previous), np.int64)
            yield _Batch(shape, batch, np.array(things, np.float64), message, lanes)

    def _around(self, among: _Candidates, batch: _Batch, doubt: Doubt, budget: Budget) -> Iterator[Found]:
        """Matches of what has a place: each landmark against each group, around its cell."""
        shape = batch.shape
        at, first = cell_at(shape), 0
        message = Message(padded(batch.message(Cell(0, 0, 0, 0)), at), at // 8, at % 8 * 8)
        while first >= 0:
            pair, row, left, numbers, first = search_cells(
                first,
                batch.things,
                shape.place not in LANDMARK_PLACES,
                doubt,
                among.arrays,
                self.steps,
                self._bins(shape),
                self._searched.known,
                batch.lanes,
                budget.left,
                message,
            )
            budget.spend(budget.left - left)
            if pair >= 0:
                one = batch.variants[pair // len(BIN_STEPS) // len(among.groups)]
                yield _found(among, pair, row, shape, one, Cell(*numbers), batch.message)

    def _as_it_is(self, among: _Candidates, batch: _Batch, _doubt: Doubt, budget: Budget) -> Iterator[Found]:
        """Matches of what has no place: one hash each."""
        digest = sha3_256(batch.message(Cell(0, 0)))
        for variant, group in product(batch.variants, among.groups):
            if budget.left <= 0:
                return
            budget.spend(1)
            marks = [self._mission.nodes[v].aliases[a].mark for v, a in group.aliases]
            if digest in marks:
                yield _of(group, marks.index(digest), batch.shape, variant, Cell(0, 0), batch.message)


def _is_bare(shape: Shape) -> bool:
    """Whether it asks for a place, and for nothing else that robots sense or do."""
    wanted = shape.text, shape.sensors, shape.messages, shape.action, shape.time
    return bool(shape.place) and not any(wanted)


def _found(
    among: _Candidates, pair: int, row: int, shape: Shape, one: Variant, cell: Cell, message: Callable[[Cell], bytes]
) -> Found:
    """What kernels found, by the numbers that they give it."""
    number = pair // len(BIN_STEPS) % len(among.groups)
    group = among.groups[number]
    return _of(group, group.targets.place(row - int(among.arrays.ends[number])), shape, one, cell, message)


def _of(group: _Group, place: int, shape: Shape, one: Variant, cell: Cell, message: Callable[[Cell], bytes]) -> Found:
    node, alias = group.aliases[place]
    return Found(Claim(node, alias, shape, group.offset, cell, message(cell)), one.landmark, one.action)
