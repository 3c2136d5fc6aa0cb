"""People walking in a building: discs that lidars see and that occlude walls and codes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan

RADIUS_M = 0.25
SPEED_MPS = (0.5, 1.4)
# Clearance at which a person turns before a wall.
ROOM_M = RADIUS_M + 0.15
PEOPLE_MAX = 1000
STEP_S = 0.25  # at top speed 0.35 m
_TRIES = 10_000


class Walkers:
    """People at random positions of a floor plan; each walks straight until a wall is near, then turns.

    Raises: UsageError: there is no room for so many people.
    """

    def __init__(self, plan: FloorPlan, count: int, random: np.random.Generator) -> None:
        if not 0 <= count <= PEOPLE_MAX:
            raise UsageError(f"{count} people", f"use 0 to {PEOPLE_MAX}")
        self._plan = plan
        self._random = random
        self._places = np.array([free_place(plan, ROOM_M, random) for _ in range(count)]).reshape(-1, 2)
        self._headings = random.uniform(-math.pi, math.pi, count)
        self._speeds = random.uniform(*SPEED_MPS, count)

    @property
    def discs(self) -> NDArray[np.float64]:
        """Return (count, 3) positions and radius, metres, map frame."""
        return np.column_stack([self._places, np.full(len(self._places), RADIUS_M)])

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`, in steps of at most STEP_S."""
        while dt_s > STEP_S:
            self._step(STEP_S)
            dt_s -= STEP_S
        self._step(dt_s)

    def _step(self, dt_s: float) -> None:
        directions = np.column_stack([np.cos(self._headings), np.sin(self._headings)])
        after = self._places + (self._speeds * dt_s)[:, None] * directions
        x0, y0, x1, y1 = self._plan.bounds
        for i, (x, y) in enumerate(after.tolist()):
            # A step is shorter than the clearance, so that nobody passes through a wall.
            if x0 <= x <= x1 and y0 <= y <= y1 and self._plan.clearance_m(x, y) >= ROOM_M:
                self._places[i] = x, y
            else:
                self._headings[i] = self._random.uniform(-math.pi, math.pi)


def free_place(plan: FloorPlan, room_m: float, random: np.random.Generator) -> tuple[float, float]:
    """Return a random position in a floor plan with this clearance. Raises: UsageError: none was found."""
    x0, y0, x1, y1 = plan.bounds
    for _ in range(_TRIES):
        x, y = random.uniform(x0, x1), random.uniform(y0, y1)
        if plan.clearance_m(x, y) >= room_m and plan.inside(x, y):
            return x, y
    raise UsageError(f"{plan.name} has no place with {room_m:g} m of room")
