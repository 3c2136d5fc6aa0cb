"""The hash search: everything that a robot can try at one moment, in order, until something matches.

Positions in a spiral around the estimate, then, if nothing matched, small turns of the heading; windows of time around
the clock's; actions of the pool; combinations of readings and messages. The number of trials is itself an output: it
tells how far the estimate was off (Encoded graphs §VI-F).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.crypto.sha3 import Targets, find_patched, sha3_256

from . import sealed
from .angles import turn_about
from .canonical import AT_POSITION, Shape, canonical, cell_at, place_bytes
from .gate import Hint
from .observable import LANDMARK_TYPES, MM_PER_M, Action, Cell, Experience, Landmark, Offset, cell_of, window_of
from .records import EncodedMission

READINGS_LIMIT = 16  # of one experience; combinations of more would let a chatty sensor eat the budget
MEMO_LIMIT = 1 << 16
WINDOWS = (0, -1, 1)


@dataclass(slots=True)
class Budget:
    """Tries that are left in this step, and those made."""

    left: int
    used: int = 0

    def spend(self, tries: int) -> None:
        """Count tries."""
        self.left -= tries
        self.used += tries


@dataclass(frozen=True, slots=True)
class Found:
    """A match: which alias of which node, and what it was made of.

    Args:
        cell: of the landmark or the robot; the middle of it is where the thing truly is.
        offset: of the cells.
        observed: the landmark as it was seen, before any turn.
        turn_rad: by which the heading was turned for the match.
        canonical: the bytes that were hashed.
        salt: that went into the KDF (sealed profile).
        key: what opens the node (sealed profile).
    """

    node: int
    alias: int
    shape: Shape
    cell: Cell
    offset: Offset
    observed: Landmark | None
    action: Action | None
    turn_rad: float
    canonical: bytes
    salt: bytes = b""
    key: bytes = b""


@dataclass(frozen=True, slots=True)
class Variant:
    """One combination to try, apart from the position: what else goes into the hash."""

    landmark: Landmark | None
    sensors: tuple[bytes, ...]
    action: Action | None
    window: int | None
    messages: tuple[bytes, ...]


@lru_cache(maxsize=64)
def spiral(rings: int) -> tuple[tuple[int, int], ...]:
    """Steps (dx, dy) outwards from (0, 0), ring after ring, (2 * rings + 1)^2 of them.

    Source: Encoded graphs §VI-B ("gradually done in a spiral manner").
    """
    steps = [(0, 0)]
    for ring in range(1, rings + 1):
        side = range(-ring, ring)
        steps += [(ring, i + 1) for i in side]
        steps += [(-i - 1, ring) for i in side]
        steps += [(-ring, -i - 1) for i in side]
        steps += [(i + 1, -ring) for i in side]
    return tuple(steps)


@lru_cache(maxsize=64)
def _spiral_arrays(rings: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    steps = np.array(spiral(rings), np.int64)
    return steps[:, 0].copy(), steps[:, 1].copy()


def rings_of(config: MissionConfig, coding: CodingConfig, tries: int) -> int:
    """Rings that cover the tolerance, or that the budget has room for."""
    wanted = math.floor(config.tolerance_m * MM_PER_M / coding.delta_mm + 1e-9)
    return min(wanted, (math.isqrt(max(tries, 1)) + 1) // 2)


def turns_of(config: MissionConfig) -> tuple[float, ...]:
    """Turns of the heading to try, nearest first."""
    count = math.floor(config.heading_tolerance_deg / config.heading_step_deg + 1e-9)
    step = math.radians(config.heading_step_deg)
    return tuple(sign * i * step for i in range(1, count + 1) for sign in (1, -1))


def as_seen(landmark: Landmark, seen: Experience, turn_rad: float) -> Landmark:
    """The landmark, had the robot's heading been so much further round."""
    if not turn_rad:
        return landmark
    x, y = turn_about(landmark.x_m, landmark.y_m, seen.x_m, seen.y_m, turn_rad)
    orientation = None if landmark.orientation_rad is None else landmark.orientation_rad + turn_rad
    return replace(landmark, x_m=x, y_m=y, orientation_rad=orientation)


def fits(shape: Shape, landmark: Landmark) -> bool:
    """Whether the landmark has what the shape asks for."""
    return (
        shape.place == 1 + LANDMARK_TYPES.index(landmark.type)
        and (not shape.oriented or landmark.orientation_rad is not None)
        and (not shape.area or landmark.area_m2 is not None)
        and (not shape.text or landmark.text is not None)
    )


def distance_m(seen: Experience, landmark: Landmark) -> float:
    """From the robot to a landmark."""
    dx, dy = landmark.x_m - seen.x_m, landmark.y_m - seen.y_m
    return math.sqrt(dx * dx + dy * dy)


def variants(shape: Shape, coding: CodingConfig, seen: Experience, heard: tuple[bytes, ...]) -> Iterator[Variant]:
    """All combinations of what was experienced that have this shape."""
    landmarks: list[Landmark | None] = [None]
    if 1 <= shape.place < AT_POSITION:
        landmarks = [landmark for landmark in seen.landmarks if fits(shape, landmark)]
    now = window_of(coding, seen.t_s)
    windows = [now + step for step in WINDOWS] if shape.time else [None]
    actions = list(seen.actions) if shape.action else [None]
    sensors = combinations(dict.fromkeys(seen.sensors[:READINGS_LIMIT]), shape.sensors)
    messages = list(combinations(reversed(heard), shape.messages))
    for landmark, reading, action, window, message in product(landmarks, sensors, actions, windows, messages):
        yield Variant(landmark, reading, action, window, message)


def cell_seen(shape: Shape, coding: CodingConfig, offset: Offset, seen: Experience, landmark: Landmark | None) -> Cell:
    """The cell of a seen landmark, or of the robot; of the landmark only what the shape asks for."""
    if landmark is None:
        return cell_of(coding, offset, seen.x_m, seen.y_m)
    wanted = replace(
        landmark,
        orientation_rad=landmark.orientation_rad if shape.oriented else None,
        area_m2=landmark.area_m2 if shape.area else None,
    )
    return cell_of(coding, offset, wanted.x_m, wanted.y_m, wanted)


@dataclass(frozen=True, slots=True)
class _Group:
    """Aliases that are searched with the same hashes: their cells are counted from the same offset."""

    offset: Offset
    reach_dm: int
    targets: Targets
    aliases: tuple[tuple[int, int], ...]


class PaperSearch:
    """The search in the paper profile: thousands of fast hashes, against all candidates at once.

    It remembers what it hashed. That changes how long a search takes, never what it finds or how many tries it counts,
    so two searches of one mission agree whatever they have seen before.
    """

    def __init__(self, mission: EncodedMission, config: MissionConfig) -> None:
        self._mission = mission
        self._config = config
        self._groups: dict[tuple[int, ...], list[_Group]] = {}
        self._memo: dict[tuple[bytes, int, int], tuple[int, int] | None] = {}

    def _grouped(self, nodes: tuple[int, ...]) -> list[_Group]:
        if nodes not in self._groups:
            by_offset: dict[tuple[Offset, int], list[tuple[int, int]]] = {}
            for node in nodes:
                record = self._mission.nodes[node]
                for a, alias in enumerate(record.aliases):
                    by_offset.setdefault((alias.offset, record.reach_dm), []).append((node, a))
            if len(self._groups) >= 256:
                self._groups.clear()
                self._memo.clear()
            self._groups[nodes] = [
                _Group(
                    offset, reach, Targets([self._mission.nodes[v].aliases[a].mark for v, a in aliases]), tuple(aliases)
                )
                for (offset, reach), aliases in by_offset.items()
            ]
        return self._groups[nodes]

    def run(
        self,
        nodes: tuple[int, ...],
        seen: Experience,
        heard: tuple[bytes, ...],
        released: bytes,
        turns: tuple[float, ...],
        budget: Budget,
    ) -> Iterator[Found]:
        """Matches, best first.

        Args:
            nodes: candidates.
            seen: now.
            heard: messages.
            released: H of the node before, for chained nodes.
            turns: of the heading, in the order to try them; 0 first.
            budget: is spent; when nothing is left the search ends.
        """
        header = self._mission.header
        groups = self._grouped(nodes)
        for turn in turns:
            for shape in header.shapes:
                if turn and not 1 <= shape.place < AT_POSITION:
                    continue
                for variant in variants(shape, header.coding, seen, heard):
                    landmark = variant.landmark and as_seen(variant.landmark, seen, turn)
                    for group in groups:
                        if landmark and group.reach_dm and distance_m(seen, landmark) * 10 > group.reach_dm:
                            continue
                        if budget.left <= 0:
                            return
                        found = self._try(shape, variant, landmark, group, seen, released, turn, budget)
                        if found:
                            yield found

    def _try(
        self,
        shape: Shape,
        variant: Variant,
        landmark: Landmark | None,
        group: _Group,
        seen: Experience,
        released: bytes,
        turn: float,
        budget: Budget,
    ) -> Found | None:
        coding = self._mission.header.coding
        centre = cell_seen(shape, coding, group.offset, seen, landmark)

        def message(cell: Cell) -> bytes:
            return canonical(
                place_bytes(shape, cell, landmark.text if landmark else None),
                sensors=variant.sensors,
                action=variant.action,
                window=variant.window,
                messages=variant.messages,
                previous=released if shape.previous else None,
            )

        if shape.place:
            rings = rings_of(self._config, coding, budget.left)
            key = (message(centre), id(group), rings)
            if key in self._memo:
                hit = self._memo[key]
            else:
                dx, dy = _spiral_arrays(rings)
                xs, ys = (centre.x + dx).astype(np.uint32), (centre.y + dy).astype(np.uint32)
                patches = xs.astype(np.uint64) | ys.astype(np.uint64) << np.uint64(32)
                template = message(centre._replace(x=0, y=0))
                hit = find_patched(template, cell_at(shape), patches, group.targets)
                self._remember(key, hit)
            budget.spend((2 * rings + 1) ** 2 if hit is None else hit[0] + 1)
            if hit is None:
                return None
            step, place = hit
            dx_, dy_ = spiral(rings)[step]
            cell = centre._replace(x=centre.x + dx_, y=centre.y + dy_)
        else:
            cell = Cell(0, 0)
            budget.spend(1)
            digest = sha3_256(message(cell))
            marks = [self._mission.nodes[v].aliases[a].mark for v, a in group.aliases]
            if digest not in marks:
                return None
            place = marks.index(digest)
        node, alias = group.aliases[place]
        return Found(node, alias, shape, cell, group.offset, variant.landmark, variant.action, turn, message(cell))

    def _remember(self, key: tuple[bytes, int, int], hit: tuple[int, int] | None) -> None:
        if len(self._memo) >= MEMO_LIMIT:
            self._memo.clear()
        self._memo[key] = hit


@dataclass(frozen=True, slots=True)
class Candidate:
    """One alias of a sealed node whose gate the robot holds."""

    node: int
    alias: int
    gate: bytes
    hint: Hint


def search_sealed(  # noqa: C901  # one nest of loops, in the order of likelihood
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
    turns: tuple[float, ...],
    tried: frozenset[bytes],
    newly_tried: set[bytes],
    budget: Budget,
) -> Iterator[Found]:
    """Matches in the sealed profile: a few slow tries, the likeliest first, none of them twice.

    Args:
        mission: sealed.
        config: how far to search.
        candidates: whose gates are held, the likeliest first.
        seen: now.
        heard: messages.
        turns: of the heading, in the order to try them; 0 first.
        tried: digests of (gate, observation) that failed in earlier steps.
        newly_tried: gets those that fail now.
        budget: is spent; what is left over comes in the next step, if it is still there to be seen.
    """
    header = mission.header
    coding = header.coding
    rings = rings_of(config, coding, 1 << 20)
    for turn in turns:
        jobs = []
        for candidate in candidates:
            shape = candidate.hint.shape
            if turn and not 1 <= shape.place < AT_POSITION:
                continue
            reach_dm = mission.nodes[candidate.node].reach_dm
            for variant in variants(shape, coding, seen, heard):
                landmark = variant.landmark and as_seen(variant.landmark, seen, turn)
                if landmark and reach_dm and distance_m(seen, landmark) * 10 > reach_dm:
                    continue
                centre = cell_seen(shape, coding, candidate.hint.offset, seen, landmark) if shape.place else Cell(0, 0)
                salt = sealed.node_salt(candidate.gate, variant.messages, header, candidate.node, candidate.alias)
                jobs.append((candidate, variant, landmark, centre, salt))
        # Ring by ring over all of them: what is near its estimate is far likelier than what is not.
        for k, (dx, dy) in enumerate(spiral(rings)):
            for candidate, variant, landmark, centre, salt in jobs:
                shape = candidate.hint.shape
                # Cells of 0.4 m and bins of 15 degrees forgive what a turn would mend elsewhere.
                if k and (turn or not shape.place):
                    continue
                cell = centre._replace(x=centre.x + dx, y=centre.y + dy)
                observed = canonical(
                    place_bytes(shape, cell, landmark.text if landmark else None),
                    sensors=variant.sensors,
                    action=variant.action,
                    window=variant.window,
                )
                name = sha3_256(salt + observed)[:16]
                if name in tried or name in newly_tried:
                    continue
                if budget.left <= 0:
                    return
                budget.spend(1)
                mark, key = sealed.try_observation(header, observed, salt)
                if mark == mission.nodes[candidate.node].aliases[candidate.alias].mark:
                    offset = candidate.hint.offset
                    yield Found(
                        candidate.node,
                        candidate.alias,
                        shape,
                        cell,
                        offset,
                        variant.landmark,
                        variant.action,
                        turn,
                        observed,
                        salt,
                        key,
                    )
                else:
                    newly_tried.add(name)
