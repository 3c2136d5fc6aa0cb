"""Positions and paths of robots for runs of promises.py, in addition to the scenario files.

A layout gives the robots' positions at a time. `drive` moves the bodies along them during the run: commands of
controllers have no effect on bodies, everything else is simulated as usual. Positions are drawn from the seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phalanx.world.scenarios.run import Run

RANGE_M = 116.0  # of the paper's radio
STEP_S = 0.05
RELAYED_NEAR = 10  # robots that hear the relayed HELLO, beside f_max
COLUMN_S = 40.0  # until it has passed; runs end then

Places = Callable[[float], NDArray[np.float64]]


@dataclass(frozen=True)
class Layout:
    """Paths of all robots: `at(t_s)` returns positions, (N, 2) m, and is called with ascending times."""

    at: Places

    @property
    def robots(self) -> int:
        """Return how many robots there are."""
        return len(self.at(0.0))


def top_speed_mps(t_audit_s: float) -> float:
    """Return the speed up to which P2 holds for moving robots, m/s. Source: docs/promises.md."""
    return RANGE_M / (2 * t_audit_s)


def hidden(f_max: int, seed: int, _: float) -> Layout:
    """Return robots 1 to f_max near robot f_max + 1, out of range of its f_max + 2 to f_max + 9 auditors."""
    chance = np.random.default_rng([seed, 1])
    groups = [
        (f_max, -95.0, 20.0),
        (1, 0.0, 0.0),
        (f_max + 2 + int(chance.integers(8)), 85.0, 40.0),
        (f_max + 4, 170.0, 30.0),  # auditors of the auditors
        (2 * f_max + 3, -180.0, 30.0),  # and of the others
    ]
    return _still(np.concatenate([_around(chance, n, x_m, width_m) for n, x_m, width_m in groups]))


def _around(chance: np.random.Generator, n: int, x_m: float, width_m: float) -> NDArray[np.float64]:
    if not width_m:
        return np.zeros((n, 2))
    return np.column_stack([x_m + chance.uniform(-8, 8, n), chance.uniform(-width_m, width_m, n)])


def relayed(f_max: int, seed: int, _: float) -> Layout:
    """Return f_max + 10 robots close together, the first two among them, and 20 to 40 distant ones."""
    chance = np.random.default_rng([seed, 2])
    near = chance.uniform(-40, 40, (f_max + RELAYED_NEAR, 2))
    far = chance.uniform(-60, 60, (20 + int(chance.integers(21)), 2))
    return _still(np.concatenate([near, far + np.array([1000.0, 0.0])]))


def groups(f_max: int, seed: int, speed_mps: float) -> Layout:
    """Return two groups of f_max + 4 robots that pass through each other."""
    chance = np.random.default_rng([seed, 3])
    n, apart_m = f_max + 4, chance.uniform(0, 230)
    off, sign = chance.uniform(-12, 12, (2 * n, 2)), np.repeat([1.0, -1.0], n)

    def at(t_s: float) -> NDArray[np.float64]:
        return off + np.column_stack([sign * (speed_mps * t_s - apart_m), np.zeros(2 * n)])

    return Layout(at)


def convoy(f_max: int, seed: int, speed_mps: float) -> Layout:
    """Return a single robot, or a few, that drive along a row with eight robots in range."""
    chance = np.random.default_rng([seed, 4])
    n, step_m, row = (1 if seed % 2 else 3), 2 * RANGE_M / (8 + 2 * (f_max - 1)), 40 + 8 * f_max
    off = np.column_stack([RANGE_M + chance.uniform(-10, 10, n), 12 + chance.uniform(-10, 10, n)])

    def at(t_s: float) -> NDArray[np.float64]:
        end_m = (row - 1) * step_m - 2 * RANGE_M
        along = speed_mps * t_s % (2 * end_m)
        moving = off + np.array([min(along, 2 * end_m - along), 0.0])
        return np.concatenate([np.column_stack([np.arange(row) * step_m, np.zeros(row)]), moving])

    return Layout(at)


def carousel(f_max: int, seed: int, speed_mps: float) -> Layout:
    """Return two rings of robots that turn against each other."""
    chance = np.random.default_rng([seed, 5])
    n = 3 * f_max + 6
    radius_m, sign = np.repeat([0.9 * RANGE_M, 0.7 * RANGE_M], n), np.repeat([1.0, -1.0], n)
    phase = np.tile(np.arange(n) * math.tau / n, 2) + chance.uniform(-0.1, 0.1, 2 * n)

    def at(t_s: float) -> NDArray[np.float64]:
        angle = phase + sign * speed_mps * t_s / radius_m
        return np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle)])

    return Layout(at)


def column(f_max: int, seed: int, speed_mps: float) -> Layout:
    """Return a robot and a column that pass each other: f_max + 2 are always in range, each for range / (2 speed)."""
    chance = np.random.default_rng([seed, 8])
    chord_m = RANGE_M
    step_m, aside_m = chord_m / (f_max + 2.05), math.sqrt(RANGE_M**2 - (chord_m / 2) ** 2)
    n, off_m = f_max + 12 + math.ceil(2 * speed_mps * COLUMN_S / step_m), chance.uniform(0, 1)

    def at(t_s: float) -> NDArray[np.float64]:
        x_m = chord_m / 2 + (1 + off_m - np.arange(n)) * step_m + speed_mps * t_s
        robots = np.column_stack([x_m, np.full(n, aside_m)])
        return np.concatenate([[[-speed_mps * t_s, 0.0]], robots])

    return Layout(at)


def waypoints(f_max: int, seed: int, speed_mps: float) -> Layout:
    """Return robots that drive from one random position to the next."""
    chance = np.random.default_rng([seed, 6])
    n, side_m = 10 * (f_max + 2), 2.6 * RANGE_M
    place, goal = chance.uniform(0, side_m, (n, 2)), chance.uniform(0, side_m, (n, 2))
    last_s = 0.0

    def at(t_s: float) -> NDArray[np.float64]:
        nonlocal place, last_s
        way, step_m = goal - place, speed_mps * (t_s - last_s)
        left_m = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        place, last_s = place + way * np.minimum(step_m / left_m, 1.0)[:, None], t_s
        there = left_m <= step_m
        goal[there] = chance.uniform(0, side_m, (int(there.sum()), 2))
        return place.copy()

    return Layout(at)


def _still(places: NDArray[np.float64]) -> Layout:
    return Layout(lambda _: places)


LAYOUTS: dict[str, Callable[[int, int, float], Layout]] = {
    each.__name__: each for each in (hidden, relayed, groups, convoy, carousel, column, waypoints)
}


def drive(run: Run, layout: Layout, until_s: float) -> None:
    """Advance a run while moving its robots along the layout."""
    world, n = run.world, len(run.ids)
    while run.now_s < until_s:
        t_s = run.now_s
        world.pos[:n] = world.last[:n] = layout.at(t_s)
        world.vel[:n] = world.acc[:n] = 0.0
        world.moved_us[:n] = int(world.clock[0].now_us)
        run.advance(min(until_s, round(t_s + STEP_S, 6)))
