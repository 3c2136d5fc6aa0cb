"""The hash search: all combinations of observables that a robot can try at one moment, in order.

It tries positions in a spiral around the estimate and bins of headings, both within the uncertainty of the pose; the
present time window and those beside it; the robot's actions; combinations of readings and messages. The number of
trials is an output too: it shows how far the estimate was off (Encoded graphs §VI-F).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission.file.canonical import AT_POSITION, Shape, canonical, place_bytes
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

from .cells import BIN_STEPS, RINGS, PoseUncertainty, bins_beside, level_of
from .fix import distance_m, sight_of

READINGS_LIMIT = 16  # readings used of one experience: combinations of more would let one sensor use up the budget
WINDOWS = (0, -1, 1)
LANDMARK_PLACES = range(1, AT_POSITION)


@dataclass(slots=True)
class Budget:
    """Tries left in this step, and tries used."""

    left: int
    used: int = 0

    def spend(self, tries: int) -> None:
        """Count tries."""
        self.left -= tries
        self.used += tries


class Variant(NamedTuple):
    """One combination of observables to try, without the cell."""

    landmark: Landmark | None
    sensors: tuple[bytes, ...]
    action: Action | None
    window: int | None
    messages: tuple[bytes, ...]

    def canonical(
        self, shape: Shape, cell: Cell, messages: tuple[bytes, ...] = (), previous: bytes | None = None
    ) -> bytes:
        """Return the canonical bytes of the combination in a cell; only the paper profile has the other arguments."""
        place = place_bytes(shape, cell, self.landmark.text if self.landmark else None)
        return canonical(
            place,
            sensors=self.sensors,
            action=self.action,
            window=self.window,
            messages=messages,
            previous=previous,
        )


def pose_uncertainty(config: MissionConfig, seen: Experience) -> PoseUncertainty:
    """Return the uncertainty of the pose in an experience, which limits the search."""
    place = float(seen.x_m), float(seen.y_m)
    return PoseUncertainty(*place, pose_spread(seen.spread), sight_of(config), config.sigmas, config.tolerance_m)


def is_around(
    shape: Shape,
    coding: CodingConfig,
    doubt: PoseUncertainty,
    landmark: Landmark | None,
    centre: Cell,
    offset: Offset,
    cell: Cell,
) -> bool:
    """Return True if the landmark, or the robot, that was seen in cell `centre` may truly be in `cell`."""
    rings, steps, bins = region(shape, coding, doubt, landmark, offset)
    return (
        max(abs(cell.x - centre.x), abs(cell.y - centre.y)) <= rings
        and cell.bin in {centre.bin if centre.bin < 0 else (centre.bin + step) % bins for step in steps}
        and cell.area == centre.area
    )


def region(
    shape: Shape, coding: CodingConfig, doubt: PoseUncertainty, landmark: Landmark | None, offset: Offset
) -> tuple[int, list[int], int]:
    """Return (rings of cells to search, steps of bins to search, total number of bins)."""
    if not shape.place:
        return 0, [0], 1
    x, y = (landmark.x_m, landmark.y_m) if landmark else (doubt.x_m, doubt.y_m)
    turn = number_or_nan(landmark.orientation_rad if landmark and shape.oriented else None)
    steps = steps_of(coding)
    rings = RINGS[level_of(np.array([x, y, turn, math.nan]), landmark is None, steps, doubt)]
    up, down = bins_beside(float(turn), offset.natural[2], steps[2], doubt)
    bins = bins_of(coding, LANDMARK_TYPES[shape.place - 1]) if landmark else 1
    return rings, [step for step, is_meant in zip(BIN_STEPS, (True, up, down), strict=True) if is_meant], bins


def fits(shape: Shape, landmark: Landmark) -> bool:
    """Return True if a landmark has the type and all attributes of a shape."""
    return (
        landmark.type == LANDMARK_TYPES[shape.place - 1]
        and (not shape.oriented or landmark.orientation_rad is not None)
        and (not shape.area or landmark.area_m2 is not None)
        and (not shape.text or landmark.text is not None)
    )


def variants(shape: Shape, coding: CodingConfig, seen: Experience, heard: tuple[bytes, ...]) -> Iterator[Variant]:
    """Yield all combinations of the observables in an experience that have this shape."""
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
    """Yield the variants within reach, each with the cell of its landmark, or of the robot."""
    for variant in variants(shape, coding, seen, heard):
        landmark = variant.landmark
        if landmark and reach_dm and distance_m(seen, landmark) * 10 > reach_dm:
            continue
        if landmark:
            cell = cell_of(coding, offset, landmark.x_m, landmark.y_m, landmark)
            # Keep only the attributes that the shape has.
            cell = Cell(cell.x, cell.y, cell.bin if shape.oriented else -1, cell.area if shape.area else -1)
        else:
            cell = cell_of(coding, offset, seen.x_m, seen.y_m) if shape.place else Cell(0, 0)
        yield variant, cell
