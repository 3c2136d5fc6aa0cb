"""The slow search of the sealed profile: a few tries of scrypt, the likeliest first, none twice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from phalanx.arrays import F64x1, I64x1, I64x2
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.kernel import kernel
from phalanx.mission.angles import wrap_rad_kernel
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import Shape
from phalanx.mission.file.records import EncodedMission
from phalanx.mission.observable import (
    HALF_TURN_TYPES,
    MM_PER_M,
    OFFSET_RAD,
    Cell,
    Experience,
    Landmark,
    Offset,
    middle_of,
    number_or_nan,
)
from phalanx.mission.pose.spread import Sighting, misfit

from .cells import PoseUncertainty
from .chart import max_misfit, rotation_between
from .claims import Claim, Found
from .fix import is_there
from .gate import Hint
from .search import Budget, Variant, placed, pose_uncertainty, region
from .searched import SPIRAL, spiral


@dataclass(frozen=True, slots=True)
class Candidate:
    """One alias of a sealed node whose gate the robot holds."""

    node: int
    alias: int
    gate: bytes
    hint: Hint


def search_sealed(
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
    tried: frozenset[bytes],
    newly_tried: set[bytes],
    budget: Budget,
) -> Iterator[Found]:
    """Yield matches in the sealed profile.

    Args:
        candidates: aliases to try, the likeliest first.
        tried: digests of (gate, observation) that failed in earlier steps.
        newly_tried: receives the digests that fail now.
        budget: reduced by each try; when it is used up, the next step continues with what is still in sight.
    """
    header = mission.header
    # The best fit to the estimated pose comes first, over all candidates.
    jobs = sorted(_jobs(mission, config, candidates, seen, heard), key=lambda job: job[0])

    @cache
    def salt_of(k: int, messages: tuple[bytes, ...]) -> bytes:
        candidate = candidates[k]
        return sealed.node_salt(candidate.gate, messages, header, candidate.node, candidate.alias)

    for _, k, variant, cell in jobs:
        candidate, salt = candidates[k], salt_of(k, variant.messages)
        shape = candidate.hint.shape
        observed = variant.canonical(shape, cell)
        name = sha3_256(salt + observed)
        if name in tried or name in newly_tried:
            continue
        if budget.left <= 0:
            return
        budget.spend(1)
        mark, key = sealed.try_observation(header, observed, candidate.hint, salt)
        if mark == mission.nodes[candidate.node].aliases[candidate.alias].mark:
            where = (candidate.node, candidate.alias, shape, candidate.hint.offset, cell)
            yield Found(Claim(*where, observed, salt), variant.landmark, variant.action, key)
        else:
            newly_tried.add(name)


def _jobs(
    mission: EncodedMission,
    config: MissionConfig,
    candidates: list[Candidate],
    seen: Experience,
    heard: tuple[bytes, ...],
) -> Iterator[tuple[float, int, Variant, Cell]]:
    """Yield (misfit of the middle of the cell, index of the candidate, variant, cell)."""
    coding, doubt = mission.header.coding, pose_uncertainty(config, seen)
    for k, candidate in enumerate(candidates):
        shape, offset = candidate.hint.shape, candidate.hint.offset
        reach_dm = mission.nodes[candidate.node].reach_dm
        for variant, centre in placed(shape, coding, seen, heard, offset, reach_dm):
            if variant.landmark is not None:
                for misfits, cell in cells_that_fit(shape, coding, doubt, variant.landmark, centre, offset):
                    yield misfits, k, variant, cell
                continue
            rings, _, _ = region(shape, coding, doubt, None, offset)
            for dx, dy in spiral(rings):
                cell = centre._replace(x=centre.x + dx, y=centre.y + dy)
                x, y, _ = middle_of(coding, offset, cell)
                if not shape.place or is_there(config, seen, x, y):
                    yield float(abs(dx) + abs(dy)), k, variant, cell


def cells_that_fit(
    shape: Shape, coding: CodingConfig, doubt: PoseUncertainty, landmark: Landmark, centre: Cell, offset: Offset
) -> list[tuple[float, Cell]]:
    """Return (misfit, cell) for each cell in which a landmark may truly be, ring after ring."""
    rings, steps, bins = region(shape, coding, doubt, landmark, offset)
    rows, fits = _that_fit(
        (centre.x, centre.y, centre.bin),
        rings,
        np.array(steps, np.int64),
        bins,
        (float(landmark.x_m), float(landmark.y_m), number_or_nan(landmark.orientation_rad)),
        landmark.type in HALF_TURN_TYPES,
        (offset.x, offset.y, offset.orientation),
        (coding.delta_mm, coding.bin_rad),
        doubt,
    )
    return [
        (fit, Cell(x, y, turn, centre.area)) for (x, y, turn), fit in zip(rows.tolist(), fits.tolist(), strict=True)
    ]


@kernel
def _that_fit(
    centre: tuple[int, int, int],
    rings: int,
    steps: I64x1,
    bins: int,
    thing: tuple[float, float, float],
    half: bool,
    offset: tuple[int, int, int],
    units: tuple[int, float],
    doubt: PoseUncertainty,
) -> tuple[I64x2, F64x1]:
    """Return ((k, 3) x, y and bin, (k,) misfit) of the cells around `centre` that fit.

    Args:
        steps: bins to search, relative to that of `centre`.
        thing: x, y and orientation of the landmark, as seen.
        half: the orientation counts modulo half a turn.
        offset: in stored integers.
        units: edge of a cell, mm, and width of a bin, radians.
    """
    count = (2 * rings + 1) * (2 * rings + 1)
    rows, fits, found = np.empty((count * len(steps), 3), np.int64), np.empty(count * len(steps)), 0
    for k in range(count):
        x, y = centre[0] + SPIRAL[k, 0], centre[1] + SPIRAL[k, 1]
        x_m, y_m = (x * units[0] + offset[0]) / MM_PER_M, (y * units[0] + offset[1]) / MM_PER_M
        for step in steps:
            at, turn = -1, np.nan
            if centre[2] >= 0:
                at = (centre[2] + step) % bins
                turn = rotation_between(wrap_rad_kernel(at * units[1] + offset[2] * OFFSET_RAD), thing[2], half)
                turn = np.nan if np.isnan(turn) else wrap_rad_kernel(turn)
            match = Sighting(thing[0], thing[1], x_m, y_m, turn)
            fit = misfit(doubt.spread, doubt.x_m, doubt.y_m, match, doubt.sight)
            if fit <= max_misfit(turn):
                rows[found, 0], rows[found, 1], rows[found, 2], fits[found] = x, y, at, fit
                found += 1
    return rows[:found], fits[:found]
