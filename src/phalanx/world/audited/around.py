"""Simulate lidars and bumpers of point masses: distances to obstacles and other robots, and contacts.

Robots are discs that touch at `contact_m`. Source: docs/guides/own-controller.md (lidar and bumpers).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.robot.controllers.senses import RANGE, Senses

from .world import World


class Around:
    """The lidars and bumpers of a world's robots, as their controller's class declares them."""

    def __init__(self, world: World, senses: Senses, contact_m: float) -> None:
        self._world, self._senses, self._contact_m = world, senses, contact_m
        angles = np.arange(senses.beams) * (2 * np.pi / max(1, senses.beams))
        self._beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)  # (B, 2)
        self._boxes = world.boxes[:, :2], world.boxes[:, 2:]  # least and greatest corners

    def look(self, rob_id: int, _t_s: float, place_m: tuple[float, float], *, lies: bool) -> bytes:
        """Return the bytes after the motion in a robot's reading; a compromised robot's sensors measure the same."""
        del lies
        here = np.array(place_m)
        others = np.delete(self._world.pos, rob_id - 1, axis=0)[: len(self._world.fleet.robot) - 1]
        radius = np.full((len(others), 1), self._contact_m / 2)
        discs = np.concatenate([self._world.discs, np.concatenate([others, radius], axis=1)])
        return self._ranges(here, discs).astype(RANGE).tobytes() + self._touched(here, discs).tobytes()

    def _ranges(self, here: NDArray[np.float64], discs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance along each beam, (B,), m; infinity if nothing is in range."""
        rel = discs[:, :2] - here
        along = self._beams @ rel.T  # (B, K)
        chord = discs[:, 2] ** 2 - ((rel**2).sum(axis=1) - along**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            near = along - np.sqrt(chord)
            hit = np.where((chord >= 0) & (along + np.sqrt(chord) >= 0), np.maximum(near, 0.0), np.inf)
            # Distances along the beam at which it enters and leaves each of a box's two strips.
            to = [(side - here)[None] / self._beams[:, None] for side in self._boxes]  # (B, K, 2)
            first, last = np.minimum(*to), np.maximum(*to)
        inside = (self._boxes[0] <= here) & (here <= self._boxes[1])
        # A beam parallel to a strip is always in it, or never.
        first = np.where(np.isnan(first), np.where(inside, -np.inf, np.inf), first).max(axis=2, initial=-np.inf)
        last = np.where(np.isnan(last), np.where(inside, np.inf, -np.inf), last).min(axis=2, initial=np.inf)
        box = np.where((first <= last) & (last >= 0), np.maximum(first, 0.0), np.inf)
        least = np.minimum(hit.min(axis=1, initial=np.inf), box.min(axis=1, initial=np.inf))
        return np.where(least <= self._senses.range_m, least, np.inf)

    def _touched(self, here: NDArray[np.float64], discs: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return 1 for each bumper that touches something, (bumpers,)."""
        touched = np.zeros(self._senses.bumpers, np.uint8)
        if not len(touched):
            return touched
        to_discs, to_boxes = discs[:, :2] - here, np.clip(here, *self._boxes) - here
        near = np.linalg.norm(to_discs, axis=1) <= discs[:, 2] + self._contact_m / 2
        at = np.concatenate([to_discs[near], to_boxes[np.linalg.norm(to_boxes, axis=1) <= self._contact_m / 2]])
        sectors = np.rint(np.arctan2(at[:, 1], at[:, 0]) / (2 * np.pi / len(touched))).astype(int) % len(touched)
        touched[sectors] = 1
        return touched
