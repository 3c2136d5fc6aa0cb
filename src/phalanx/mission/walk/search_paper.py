"""The fast search of the paper profile: thousands of hashes per step, compared with all candidates at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import groupby, product

import numpy as np

from phalanx.arrays import I64x1
from phalanx.config.mission import MissionConfig
from phalanx.config.parameter import made_once
from phalanx.crypto.sha3 import Targets, padded, sha3_256
from phalanx.mission.file.canonical import AT_POSITION, Shape, cell_at
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import LANDMARK_TYPES, Cell, Experience, Offset, bins_of, rows_of, steps_of

from .cells import BIN_STEPS, OWN, RINGS, Groups, Message, PoseUncertainty, Shapes, pack, search_cells, search_shapes
from .claims import Claim, Found
from .search import LANDMARK_PLACES, Budget, Variant, pose_uncertainty, variants
from .searched import SearchMemory

TARGETS_LIMIT = 4096
_BARE = Variant(None, (), None, None, ())


@dataclass(frozen=True, slots=True)
class _Group:
    """Aliases that share their hashes in a search, since their cells have the same offset."""

    offset: Offset
    reach_dm: int
    targets: Targets
    aliases: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Groups of the candidates' aliases, also as kernel arrays."""

    groups: tuple[_Group, ...]
    arrays: Groups
    # By hash H of the previous node: runs of the mission's shapes; those that need only a place also packed
    parts: dict[bytes, list[tuple[tuple[Shape, ...], Shapes | None]]]

    def found(
        self, pair: int, row: int, shape: Shape, one: Variant, cell: Cell, message: Callable[[Cell], bytes]
    ) -> Found:
        """Return the match for a kernel's result: the number of a pair and the row of a digest."""
        number = pair // len(BIN_STEPS) % len(self.groups)
        place = self.groups[number].targets.place(row - int(self.arrays.ends[number]))
        return _found(self.groups[number], place, shape, one, cell, message)


class PaperSearch:
    """The search of one mission; its memory of earlier searches never changes a result."""

    def __init__(self, mission: EncodedMission, config: MissionConfig) -> None:
        self._mission = mission
        self._config = config
        self.steps = steps_of(mission.header.coding)
        self._among = made_once(self._candidates_of)
        self._targets = lru_cache(TARGETS_LIMIT)(self._targets_of)
        self._searched = SearchMemory()

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
        return _Candidates(groups, arrays, {})

    def _parts(self, among: _Candidates, released: bytes) -> list[tuple[tuple[Shape, ...], Shapes | None]]:
        if released not in among.parts:
            runs = [(is_bare, tuple(same)) for is_bare, same in groupby(self._mission.header.shapes, _is_bare)]
            packed = [self._together(among, same, released) if is_bare else None for is_bare, same in runs]
            among.parts[released] = [(same, arrays) for (_, same), arrays in zip(runs, packed, strict=True)]
        return among.parts[released]

    def parts(self, nodes: tuple[int, ...], released: bytes) -> tuple[list[Shapes], list[Shape]]:
        """Return the shapes that need only a place, packed for kernels, and the other shapes."""
        parts = self._parts(self._among(nodes), released)
        together = [arrays for _, arrays in parts if arrays is not None]
        return together or [self.empty_shapes()], [shape for same, arrays in parts if arrays is None for shape in same]

    def empty_shapes(self) -> Shapes:
        """Return packed shapes that match nothing."""
        none, searched = np.empty((0, 3), np.int64), (*self._among(()).arrays, *self._searched.known)
        return pack(Shapes(none, none, none, np.empty((0, 1), np.uint64), *searched))

    def _together(self, among: _Candidates, shapes: tuple[Shape, ...], released: bytes) -> Shapes:
        asks, at, lanes, templates = [], [], [], []
        for shape in shapes:
            is_own, begin = shape.place == AT_POSITION, cell_at(shape)
            previous = released if shape.previous else None
            asks.append((OWN if is_own else shape.place - 1, shape.oriented, shape.area))
            at.append((self._bins(shape), begin // 8, begin % 8 * 8))
            lanes.append(self._lanes(among, shape, (None, *_BARE[1:]), previous))
            templates.append(padded(_BARE.canonical(shape, Cell(0, 0, 0, 0), (), previous), begin))
        of_groups, searched = np.array(lanes, np.int64), (*among.arrays, *self._searched.known)
        return pack(Shapes(np.array(asks), np.array(at), of_groups, np.array(templates), *searched))

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
        """Yield matches, best first.

        Args:
            released: hash H of the previous node, for chained nodes.
            budget: reduced by each try; the search ends when it is used up.
        """
        among, doubt = self._among(nodes), pose_uncertainty(self._config, seen)
        for shapes, arrays in self._parts(among, released):
            if arrays is not None:
                yield from self._at_once(among, shapes, arrays, seen, released, doubt, budget)
                continue
            for shape in shapes:
                tried = variants(shape, self._mission.header.coding, seen, heard)
                for rest, alike in groupby(tried, partial(_rest, shape)):
                    batch, previous = tuple(alike), released if shape.previous else None
                    message = partial(batch[0].canonical, shape, messages=batch[0].messages, previous=previous)
                    if shape.place:
                        lanes = np.array(self._lanes(among, shape, rest, previous), np.int64)
                        yield from self._around(among, shape, batch, message, lanes, seen, doubt, budget)
                    else:
                        yield from self._as_it_is(among, shape, batch, message, budget)

    def _at_once(
        self,
        among: _Candidates,
        shapes: tuple[Shape, ...],
        arrays: Shapes,
        seen: Experience,
        released: bytes,
        doubt: PoseUncertainty,
        budget: Budget,
    ) -> Iterator[Found]:
        """Yield matches of shapes that need only a place."""
        rows, begin = rows_of(seen.landmarks), (0, 0)
        while True:
            s, k, pair, row, left, numbers, after = search_shapes(begin, arrays, rows, doubt, self.steps, budget.left)
            budget.spend(budget.left - left)
            if s < 0:
                return
            begin, shape = (s, after), shapes[s]
            landmark = seen.landmarks[k] if shape.place in LANDMARK_PLACES else None
            one, previous = _BARE._replace(landmark=landmark), released if shape.previous else None
            message = partial(one.canonical, shape, previous=previous)
            yield among.found(pair, row, shape, one, Cell(*numbers), message)

    def _around(
        self,
        among: _Candidates,
        shape: Shape,
        batch: tuple[Variant, ...],
        message: Callable[[Cell], bytes],
        lanes: I64x1,
        seen: Experience,
        doubt: PoseUncertainty,
        budget: Budget,
    ) -> Iterator[Found]:
        """Yield matches of variants whose hashes differ only in the cell, searched around the cell for each group."""
        landmarks = [one.landmark for one in batch if one.landmark]
        own = np.array([(OWN, seen.x_m, seen.y_m, np.nan, np.nan)] * len(batch))
        rows, at, first = rows_of(landmarks) if landmarks else own, cell_at(shape), 0
        things = np.where((True, True, shape.oriented, shape.area), rows[:, 1:], np.nan)
        template = Message(padded(message(Cell(0, 0, 0, 0)), at), at // 8, at % 8 * 8)
        among_what = among.arrays, self.steps, self._bins(shape), self._searched.known, lanes
        while first >= 0:
            pair, row, left, numbers, first = search_cells(
                first, things, not landmarks, doubt, *among_what, budget.left, template
            )
            budget.spend(budget.left - left)
            if pair >= 0:
                one = batch[pair // len(BIN_STEPS) // len(among.groups)]
                yield among.found(pair, row, shape, one, Cell(*numbers), message)

    def _as_it_is(
        self,
        among: _Candidates,
        shape: Shape,
        batch: tuple[Variant, ...],
        message: Callable[[Cell], bytes],
        budget: Budget,
    ) -> Iterator[Found]:
        """Yield matches of variants without a place, by one hash."""
        digest = sha3_256(message(Cell(0, 0)))
        for variant, group in product(batch, among.groups):
            if budget.left <= 0:
                return
            budget.spend(1)
            marks = [self._mission.nodes[v].aliases[a].mark for v, a in group.aliases]
            if digest in marks:
                yield _found(group, marks.index(digest), shape, variant, Cell(0, 0), message)


def _is_bare(shape: Shape) -> bool:
    """Return True if a shape needs a place and no other observable, apart from the previous node."""
    wanted = shape.text, shape.sensors, shape.messages, shape.action, shape.time
    return bool(shape.place) and not any(wanted)


def _rest(shape: Shape, one: Variant) -> tuple[object, ...]:
    """Return all values besides the cell that a variant's hash depends on."""
    return one.landmark.text if shape.text and one.landmark else None, *one[1:]


def _found(
    group: _Group, place: int, shape: Shape, one: Variant, cell: Cell, message: Callable[[Cell], bytes]
) -> Found:
    node, alias = group.aliases[place]
    return Found(Claim(node, alias, shape, group.offset, cell, message(cell)), one.landmark, one.action)
