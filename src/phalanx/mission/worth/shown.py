"""Candidates that a floor plan gives an attacker for a node, likeliest first.

The attack and the audit both use this list, so that the audit counts what the attack tries.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import CodingConfig
from phalanx.mission.authoring.findable import mark_lookalikes, sighted
from phalanx.mission.authoring.survey import most_spacious_start
from phalanx.mission.file.canonical import AT_POSITION, Shape, shape_of
from phalanx.mission.graph import Draft
from phalanx.mission.landmarks import FloorPlan, Site, look_alikes_of
from phalanx.mission.landmarks.sites import landmarks_of
from phalanx.mission.observable import (
    APART_M,
    APART_MAX,
    MM_PER_M,
    OFFSET_RAD,
    Cell,
    Landmark,
    Offset,
    Position,
    cell_of,
    number_or_nan,
)

# Scales of the errors between a floor plan and the places in the mission.
DRAWN_M, DRAWN_RAD = 0.05, math.radians(2.5)
# Largest misfit from one criterion: the true place may violate one, as in another edition of the plan, or with a
# direction given by hand.
MOST = 16.0


class Before(NamedTuple):
    """Knowledge from the previous opened node: its place, and the direction of the next node."""

    x_m: float
    y_m: float
    direction_rad: float
    sectors: int


@dataclass(frozen=True, eq=False)
class PlanCandidates:
    """All candidate places in a floor plan.

    Args:
        things: positions and landmarks, the start first.
        rows: (n, 4) x, y, orientation or NaN, and distance to the next look-alike in units of APART_M.
        rounded_mm: the compiler rounded offsets to multiples of this.
    """

    things: tuple[Landmark | Position, ...]
    rows: NDArray[np.float64]
    rounded_mm: int

    @cached_property
    def _kinds(self) -> NDArray[np.int64]:
        """Return (3, n) the fields `place`, `oriented` and `area` of the things' shapes."""
        shapes = [shape_of((thing,)) for thing in self.things]
        return np.array([(each.place, each.oriented, each.area) for each in shapes], np.int64).reshape(-1, 3).T

    def cells(self, coding: CodingConfig, before: Before | None, shape: Shape, offset: Offset) -> Iterator[Cell]:
        """Yield the cells in which an alias may be, likeliest first, each once.

        Args:
            shape, offset: from the alias's hint in its gate.
        """
        place, oriented, area = self._kinds
        among = np.flatnonzero((place == shape.place) & (oriented >= shape.oriented) & (area >= shape.area))
        rows = self.rows[among]
        misfit = (among != 0).astype(np.float64)  # prefer the start, if it has the right shape
        # Rounding moved the places from the middles of their cells by at most half a step.
        off = np.abs(_rest(rows[:, :2] - np.array(offset.natural[:2]), coding.delta_mm / MM_PER_M))
        misfit += _square(np.maximum(off - self.rounded_mm / MM_PER_M / 2, 0.0), DRAWN_M).sum(axis=1)
        if shape.oriented:
            misfit += _square(_rest(rows[:, 2] - offset.orientation * OFFSET_RAD, coding.bin_rad), DRAWN_RAD)
        if shape.place != AT_POSITION:
            misfit += _square(rows[:, 3] - offset.apart, 1.0)
        if before is not None:
            misfit += _off_way(before, rows)
        tried: set[Cell] = set()
        for i in among[np.argsort(misfit, kind="stable")]:
            cell = cell_in(coding, shape, offset, self.things[i])
            if cell not in tried:
                tried.add(cell)
                yield cell


def cell_in(coding: CodingConfig, shape: Shape, offset: Offset, thing: Landmark | Position) -> Cell:
    """Return the cell of a thing, without orientation and area if the shape has none."""
    cell = cell_of(coding, offset, thing.x_m, thing.y_m, thing if isinstance(thing, Landmark) else None)
    return cell._replace(bin=cell.bin if shape.oriented else -1, area=cell.area if shape.area else -1)


def candidates_in(plan: FloorPlan, rounded_mm: int) -> PlanCandidates:
    """Return the candidates in a floor plan: landmarks as drawn, landmarks as a lidar sees them, and positions.

    Args:
        rounded_mm: `BuildOptions.offset_mm` of the mission.
    Raises: UsageError: the plan has no start and no single space to choose one in.
    """
    sites, alike = landmarks_of(plan), look_alikes_of(plan)
    looked_at, beside = sighted(plan, sites)
    seen = [site for site in (each.with_aliases(each.site.aliases) for each in looked_at) if site is not None]
    start = plan.start or most_spacious_start(plan)
    known: list[Landmark | Position] = [Position(start[0], start[1])]
    known += [*_apart(sites, alike), *_apart(seen, (*alike, *beside))]
    known += [Position(thing.x_m, thing.y_m) for thing in known if isinstance(thing, Landmark)]
    return PlanCandidates(tuple(known), np.array([_row(thing) for thing in known], np.float64), rounded_mm)


def _apart(sites: Sequence[Site], alike: Iterable[Landmark]) -> Iterator[Landmark]:
    """Return the landmarks with their distances to the next look-alike, computed as by the compiler."""
    draft = Draft("plan")
    for i, alias in enumerate(dict.fromkeys(alias for site in sites for alias in site.aliases)):
        draft.node(str(i), alias, start=True)
    nodes = mark_lookalikes(draft.mission(), alike).nodes if draft.nodes else ()
    return (thing for node in nodes for thing in node.see[0] if isinstance(thing, Landmark))


def _row(thing: Landmark | Position) -> tuple[float, float, float, float]:
    if isinstance(thing, Position):
        return thing.x_m, thing.y_m, math.nan, float(APART_MAX)
    apart = math.floor(min(thing.apart_m / APART_M + 1e-9, APART_MAX))
    return thing.x_m, thing.y_m, number_or_nan(thing.orientation_rad), float(apart)


def _rest(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the differences of values to the nearest multiples of a step."""
    return values - step * np.round(values / step)


def _square(off: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    return np.minimum(np.square(off / scale), MOST)


def _off_way(before: Before, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the misfit of places to the direction of the way."""
    dx, dy = rows[:, 0] - before.x_m, rows[:, 1] - before.y_m
    off = _rest(np.arctan2(dy, dx) - before.direction_rad, math.tau)
    return np.minimum(
        np.square(off / (math.pi / before.sectors + DRAWN_M / np.maximum(np.hypot(dx, dy), DRAWN_M))), MOST
    )
