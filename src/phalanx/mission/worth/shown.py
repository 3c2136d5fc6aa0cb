"""List what a floor plan tells an attacker: candidate landmarks of a node, likeliest first.

The attack and the audit both ask here, so that the audit counts what the attack tries.
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

# So far what a plan shows may be from where the mission's author has it.
DRAWN_M, DRAWN_RAD = 0.05, math.radians(2.5)
# What does not fit in one way may still be meant: the plan is another edition, or a direction was given by hand.
MOST = 16.0


class Before(NamedTuple):
    """Knowledge from the previous opened node: its place, and the sector in which the next node lies."""

    x_m: float
    y_m: float
    direction_rad: float
    sectors: int


@dataclass(frozen=True, eq=False)
class Shown:
    """All that may be meant, as a floor plan shows it.

    Args:
        things: landmarks, and the places where a robot may have to be: its start first.
        rows: (n, 4) x, y, orientation or NaN, and how far it is to the next that looks the same, in steps of APART_M.
        rounded_mm: the compiler's offsets are rounded to multiples of so much.
    """

    things: tuple[Landmark | Position, ...]
    rows: NDArray[np.float64]
    rounded_mm: int

    @cached_property
    def _kinds(self) -> NDArray[np.int64]:
        """(3, n) the things' place, and whether they have an orientation and an area, as shapes say it."""
        shapes = [shape_of((thing,)) for thing in self.things]
        return np.array([(each.place, each.oriented, each.area) for each in shapes], np.int64).reshape(-1, 3).T

    def cells(self, coding: CodingConfig, before: Before | None, shape: Shape, offset: Offset) -> Iterator[Cell]:
        """The cells of an alias in which it may be, each once.

        Args:
            shape, offset: the alias's, as its gate tells them.
        """
        place, oriented, area = self._kinds
        among = np.flatnonzero((place == shape.place) & (oriented >= shape.oriented) & (area >= shape.area))
        rows = self.rows[among]
        misfit = (among != 0).astype(np.float64)  # robots begin at the start, if it may be
        # Rounding moved them from the middles of their cells, by half a step at most.
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
    """The cell of a thing, of which a node tells no more than its shape says."""
    cell = cell_of(coding, offset, thing.x_m, thing.y_m, thing if isinstance(thing, Landmark) else None)
    return cell._replace(bin=cell.bin if shape.oriented else -1, area=cell.area if shape.area else -1)


def shown_by(plan: FloorPlan, rounded_mm: int) -> Shown:
    """Extract an attacker's landmarks from a floor plan: as drawn, and as lidars see them.

    Args:
        rounded_mm: as the mission was built (`BuildOptions.offset_mm`).
    Raises: UsageError: the plan says not where robots begin, and has no one space to choose from.
    """
    sites, alike = landmarks_of(plan), look_alikes_of(plan)
    looked_at, beside = sighted(plan, sites)
    seen = [site for site in (each.left(each.site.aliases) for each in looked_at) if site is not None]
    start = plan.start or most_spacious_start(plan)
    known: list[Landmark | Position] = [Position(start[0], start[1])]
    known += [*_apart(sites, alike), *_apart(seen, (*alike, *beside))]
    known += [Position(thing.x_m, thing.y_m) for thing in known if isinstance(thing, Landmark)]
    return Shown(tuple(known), np.array([_row(thing) for thing in known], np.float64), rounded_mm)


def _apart(sites: Sequence[Site], alike: Iterable[Landmark]) -> Iterator[Landmark]:
    """Landmarks, each with how far it is to the next that looks the same, as the compiler reckons."""
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
    """How far values are from the nearest multiple of a step."""
    return values - step * np.round(values / step)


def _square(off: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    return np.minimum(np.square(off / scale), MOST)


def _off_way(before: Before, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """How badly places fit the direction of the way."""
    dx, dy = rows[:, 0] - before.x_m, rows[:, 1] - before.y_m
    off = _rest(np.arctan2(dy, dx) - before.direction_rad, math.tau)
    return np.minimum(
        np.square(off / (math.pi / before.sectors + DRAWN_M / np.maximum(np.hypot(dx, dy), DRAWN_M))), MOST
    )
