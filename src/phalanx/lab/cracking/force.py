"""Brute-force attack on a captured mission graph, with a floor plan or only the size of the area.

Each generator yields after every batch, so that the caller can stop at any time. This module reads no clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import CodingConfig
from phalanx.crypto.sha3 import Targets, find_patched
from phalanx.mission.angles import TWO_PI
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import AT_POSITION, Shape, canonical, cell_at, place_bytes
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import LANDMARK_TYPES, MM_PER_M, Cell, Experience, Landmark, Offset, bins_of, middle_of
from phalanx.mission.walk.claims import Claim, Found, unlock
from phalanx.mission.walk.gate import Gate, StartKey
from phalanx.mission.walk.opening import open_found
from phalanx.mission.worth.shown import Before, PlanCandidates

BATCH = 1 << 16  # cells of one batch of fast hashes
KDF_BATCH = 64
Box = tuple[float, float, float, float]
Spread = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
_Held = tuple[int, Gate, Before | None]  # a node, its gate, and knowledge from its predecessor


@dataclass(frozen=True, slots=True)
class GuessedNode:
    """A guessed node and its position."""

    node: int
    kind: str
    x_m: float
    y_m: float
    orientation_rad: float | None


@dataclass(frozen=True, slots=True)
class TriedBatch:
    """Result of one batch: candidates tried, candidates in all as far as known now, and nodes found."""

    tries: int
    of: int
    found: tuple[GuessedNode, ...] = ()


def _patches(coding: CodingConfig, offset: Offset, box: Box) -> NDArray[np.uint64]:
    """Return (n,) x and y of all cells of a box, packed as in the canonical bytes."""
    delta = coding.delta_mm / MM_PER_M
    x0, y0, x1, y1 = box
    xs = np.arange(math.floor((x0 - offset.x / MM_PER_M) / delta), math.ceil((x1 - offset.x / MM_PER_M) / delta) + 1)
    ys = np.arange(math.floor((y0 - offset.y / MM_PER_M) / delta), math.ceil((y1 - offset.y / MM_PER_M) / delta) + 1)
    gx, gy = np.meshgrid(xs.astype(np.uint32).astype(np.uint64), ys.astype(np.uint32).astype(np.uint64))
    return np.ascontiguousarray((gx | gy << np.uint64(32)).ravel())


def _bins(coding: CodingConfig, shape: Shape, box: Box) -> list[tuple[int, int]]:
    """Return all pairs of orientation bin and area bin to try."""
    turns = range(bins_of(coding, LANDMARK_TYPES[shape.place - 1])) if shape.oriented else [-1]
    largest = (box[2] - box[0]) * (box[3] - box[1]) / 2
    areas = range(math.ceil(largest / coding.area_m2) + 1) if shape.area else [-1]
    return [(turn, area) for area in areas for turn in turns]


def can_guess(shape: Shape) -> bool:
    """Return whether a shape contains only a position, so that the size of the map suffices to guess it."""
    return bool(shape.place) and not (shape.text or shape.sensors or shape.messages or shape.action or shape.time)


def crack_paper(mission: EncodedMission, box: Box) -> Iterator[TriedBatch]:
    """Try every position in a box against every node of a paper mission, cheap shapes first."""
    coding = mission.header.coding
    groups: dict[Offset, dict[bytes, int]] = {}
    for node, record in enumerate(mission.nodes):
        for alias in record.aliases:
            groups.setdefault(alias.offset, {})[alias.mark] = node
    shapes = [shape for shape in mission.header.shapes if can_guess(shape)]
    shapes.sort(key=lambda shape: len(_bins(coding, shape, box)))
    # The hash input of a chained node includes its predecessor's hash, which is public.
    marks: list[bytes | None] = [alias.mark for record in mission.nodes for alias in record.aliases]
    per_bin = sum(len(_patches(coding, offset, box)) for offset in groups)
    total = sum(per_bin * len(_bins(coding, shape, box)) * (len(marks) if shape.previous else 1) for shape in shapes)
    for shape in shapes:
        for (turn, area), previous in product(_bins(coding, shape, box), marks if shape.previous else [None]):
            cell = Cell(0, 0, turn, area)
            message = canonical(place_bytes(shape, cell), previous=previous)
            for offset, wanted in groups.items():
                patches, targets, nodes = _patches(coding, offset, box), Targets(list(wanted)), list(wanted.values())
                for start in range(0, len(patches), BATCH):
                    batch, at, found = patches[start : start + BATCH], 0, list[GuessedNode]()
                    while (hit := find_patched(message, cell_at(shape), batch[at:], targets)) is not None:
                        patch = int(batch[at + hit[0]])
                        x, y = (int(np.int32(np.uint32(part & 0xFFFFFFFF))) for part in (patch, patch >> 32))
                        found.append(_cracked(coding, nodes[hit[1]], shape, offset, cell._replace(x=x, y=y)))
                        at += hit[0] + 1
                    yield TriedBatch(len(batch), total, tuple(found))


def _cracked(coding: CodingConfig, node: int, shape: Shape, offset: Offset, cell: Cell) -> GuessedNode:
    x_m, y_m, orientation = middle_of(coding, offset, cell)
    kind = "position" if shape.place == AT_POSITION else LANDMARK_TYPES[shape.place - 1]
    return GuessedNode(node, kind, x_m, y_m, orientation)


def crack_sealed(
    mission: EncodedMission, key: StartKey, box: Box, spread: Spread = map, plan: PlanCandidates | None = None
) -> Iterator[TriedBatch]:
    """Try every position in a box against every known gate; each opened node reveals further gates.

    Args:
        key: captured with the robot, or included in the file; without one there is nothing to try.
        plan: landmarks of a floor plan, tried first, one by one; all positions follow when no gate is left for them.
    """
    # A manipulated key could name nodes or aliases that are not in the file.
    waiting: list[_Held] = [(node, gate, None) for node, gate in key.gates.items() if node < len(mission.nodes)]
    later: list[_Held] = []  # nodes that are not among the plan's landmarks
    seen = set(key.gates)
    coding, known = mission.header.coding, 0
    while waiting or later:
        shown = plan if waiting else None
        node, gate, before = (waiting or later).pop(0)
        gate = replace(gate, hints=gate.hints[: len(mission.nodes[node].aliases)])
        if shown is None:
            hints = [hint for hint in gate.hints if can_guess(hint.shape)]
            sizes = (len(_patches(coding, each.offset, box)) * len(_bins(coding, each.shape, box)) for each in hints)
            left, size = sum(sizes), KDF_BATCH
            jobs = _jobs(mission, node, gate, partial(_everywhere, coding, box, before))
        else:
            claims = list(_jobs(mission, node, gate, partial(shown.cells, coding, before)))
            left, size, jobs = len(claims), 1, iter(claims)
        known += left
        while batch := list(islice(jobs, size)):
            left -= len(batch)
            keys = spread(partial(unlock, mission), batch)
            hit = next(((claim, key) for claim, key in zip(batch, list(keys), strict=True) if key is not None), None)
            if hit is None:
                yield TriedBatch(len(batch), known)
                continue
            claim, secret_key = hit
            known -= left
            cracked = _cracked(coding, node, claim.shape, claim.offset, claim.cell)
            yield TriedBatch(len(batch), known, (cracked,))
            landmark = None
            if claim.shape.place != AT_POSITION:
                landmark = Landmark(cracked.kind, cracked.x_m, cracked.y_m, cracked.orientation_rad)
            opened = open_found(mission, Found(claim, landmark, key=secret_key), Experience(0.0, 0.0, 0.0, 0.0))
            for way in opened.ways:
                if way.target not in seen and way.gate is not None:
                    seen.add(way.target)
                    share = sealed.onward(gate.share, way.gate.share, mission.header, node, way.target)
                    at, to_rad = opened.place_m, way.direction_rad
                    after = None if at is None or to_rad is None else Before(*at, to_rad, coding.sectors)
                    waiting.append((way.target, replace(way.gate, share=share), after))
            break
        else:
            if shown is not None:
                later.append((node, gate, before))


def _jobs(
    mission: EncodedMission, node: int, gate: Gate, cells: Callable[[Shape, Offset], Iterable[Cell]]
) -> Iterator[Claim]:
    """Yield every candidate, alias by alias."""
    for alias, hint in enumerate(gate.hints):
        if not can_guess(hint.shape):
            continue
        salt = sealed.node_salt(gate.share, (), mission.header, node, alias)
        for cell in cells(hint.shape, hint.offset):
            yield Claim(node, alias, hint.shape, hint.offset, cell, canonical(place_bytes(hint.shape, cell)), salt)


def _everywhere(coding: CodingConfig, box: Box, before: Before | None, shape: Shape, offset: Offset) -> Iterator[Cell]:
    """Yield all cells of a box, sorted by angle to the direction from the predecessor if that is known."""
    cells = _patches(coding, offset, box)
    xs = (cells & np.uint64(0xFFFFFFFF)).astype(np.uint32).astype(np.int32)
    ys = (cells >> np.uint64(32)).astype(np.uint32).astype(np.int32)
    order = np.arange(len(xs))
    if before is not None:
        delta = coding.delta_mm / MM_PER_M
        dx, dy = xs * delta + offset.x / MM_PER_M - before.x_m, ys * delta + offset.y / MM_PER_M - before.y_m
        off = np.abs((np.arctan2(dy, dx) - before.direction_rad + math.pi) % TWO_PI - math.pi)
        order = np.argsort(off, kind="stable")
    for i in order:
        for turn, area in _bins(coding, shape, box):
            yield Cell(int(xs[i]), int(ys[i]), turn, area)
