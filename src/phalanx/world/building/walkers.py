"""People who walk about in a building: discs that a lidar sees and that hide walls and codes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan

RADIUS_M = 0.25
SPEED_MPS = (0.5, 1.4)
# A person turns before a wall so far away.
ROOM_M = RADIUS_M + 0.15
PEOPLE_MAX = 1000
STEP_S = 0.25  # at top speed 0.35 m
_TRIES = 10_000


class Walkers:
    """People at random places of a floor plan, each walking straight on until a wall comes.

    Raises: UsageError: there is no room for so many.
    """

    def __init__(self, plan: FloorPlan, count: int, random: np.random.Generator) -> None:
        if not 0 <= count <= PEOPLE_MAX:
            raise UsageError(f"{count} people", f"0 to {PEOPLE_MAX}")
        self._plan = plan
        self._random = random
        self._places = np.array([free_place(plan, ROOM_M, random) for _ in range(count)]).reshape(-1, 2)
        self._headings = random.uniform(-math.pi, math.pi, count)
        self._speeds = random.uniform(*SPEED_MPS, count)

    @property
    def discs(self) -> NDArray[np.float64]:
        """(count, 3): where they are, metres, map frame, and the radius."""
        return np.column_stack([self._places, np.full(len(self._places), RADIUS_M)])

    def step(self, dt_s: float) -> None:
        """Lets them walk for a moment, or for several, one after the other."""
        while dt_s > STEP_S:
            self._step(STEP_S)
            dt_s -= STEP_S
        self._step(dt_s)

    def _step(self, dt_s: float) -> None:
        looks = np.column_stack([np.cos(self._headings), np.sin(self._headings)])
        after = self._places + (self._speeds * dt_s)[:, None] * looks
        x0, y0, x1, y1 = self._plan.bounds
        for i, (x, y) in enumerate(after.tolist()):
            # A step is shorter than the room before a wall: nobody comes to its other side.
            if x0 <= x <= x1 and y0 <= y <= y1 and self._plan.clearance_m(x, y) >= ROOM_M:
                self._places[i] = x, y
            else:
                self._headings[i] = self._random.uniform(-math.pi, math.pi)


def free_place(plan: FloorPlan, room_m: float, random: np.random.Generator) -> tuple[float, float]:
    """A random place in a floor plan with so much room around it. Raises: UsageError: none was found."""
    x0, y0, x1, y1 = plan.bounds
    for _ in range(_TRIES):
        x, y = random.uniform(x0, x1), random.uniform(y0, y1)
        if plan.clearance_m(x, y) >= room_m and plan.inside(x, y):
            return x, y
    raise UsageError(f"{plan.name} has no place with {room_m:g} m of room")
