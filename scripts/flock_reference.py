"""Compute the flocking reference that bti-fig8 and bti-fig9 are compared with. It shares no code with Phalanx.

    python scripts/flock_reference.py            write tests/data/flock_reference.csv and the condensed CSV
    python scripts/flock_reference.py --check    compare both files with what is computed; 1 if they differ

25 robots start on a grid and go to a goal; in some series one of them lies about the others. Time advances by
0.05 s. A robot broadcasts its state every 1.5 s, and steers every 0.25 s by what it last heard of each other one.

Source: Olfati-Saber, "Flocking for multi-agent dynamic systems", IEEE TAC 2006 (the law, equation numbers below);
RoboRebound Table 3 (parameters) and §5.3 (the lie). Ours, BSD-3-Clause, as Phalanx.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
WHOLE = ROOT / "tests/data/flock_reference.csv"
CONDENSED = ROOT / "src/phalanx/data/flock_reference.csv"
CONDENSED_HEAD = """\
# Distance to the goal of the honest robots, 25 on a 5 x 5 grid over 100 x 100 m, d = 20 m, goal (500, 500).
# Computed by scripts/flock_reference.py, which shares no code with this package; condensed from the whole one in tests.
# Where attacked, robot 12 of 0..24 lies from 15 s on (in the last to 25 s, when it is switched off). BSD-3-Clause.
series,t_s,mean_m,least_m,most_m
"""
SERIES_OF_CONDENSED = {
    "honest": "base_linear_d20",
    "attacked": "attack_random1_broadcast_d20",
    "stopped_at_25s": "attack_random1_broadcast_stop25_d20",
}

# The law's parameters. Source: RoboRebound Table 3.
EPSILON, A, B, BUMP_FROM = 0.1, 5.0, 5.0, 0.2
C = (A - B) / np.sqrt(4 * A * B)
C1_ALPHA, C2_ALPHA, C1_GAMMA, C2_GAMMA = 0.005, 0.05, 0.001, 0.06
SPACING_M = 20.0
INTERACTION_M = 1.2 * SPACING_M
LARGEST_MPS2 = 5.0

ROBOTS_A_SIDE = 5
ROBOTS = ROBOTS_A_SIDE**2
ARENA_M = 100.0
GOAL_M = np.array((500.0, 500.0))
RANGE_M = 10 ** ((16.0206 - 36.05 + 82) / 30)  # 116.33 m, the preamble threshold of ns-3
STEP_S, STEPS = 0.05, 3000
STEPS_PER_CONTROL = 5  # lies are sent as often
STATE_S = 1.5
FORGET_S = 4.5
SAMPLE_S = 5.0
SEED = 1  # decides when in 1.5 s each robot broadcasts, and which name a lie uses
NEVER_HEARD = -1e9

LIAR = 12  # the middle robot
LIES_FROM_S = 15.0
LIE_AT_M, LIE_MARGIN_M, LIE_MPS = 150.0, 2.0, 1.0  # the paper's z, epsilon and c


@dataclass(frozen=True)
class Series:
    """What happens in one run.

    Args:
        sigmoid_goal: the pull to the goal is bounded, as in the law's paper; else proportional to the distance.
        lies_as: names that the liar uses when it lies to a robot: "all" others, the "next" id, one drawn ("random"),
            or "" without a liar.
        to_victim_only: only the robot that is lied to hears it; else all robots in the liar's range do.
        until_s: when the liar is switched off.
    """

    sigmoid_goal: bool = False
    lies_as: str = ""
    to_victim_only: bool = False
    until_s: float = np.inf


SERIES = {
    "base_linear_d20": Series(),
    "base_sigma1_d20": Series(sigmoid_goal=True),
    "attack_all_targeted_d20": Series(lies_as="all", to_victim_only=True),
    "attack_next_broadcast_d20": Series(lies_as="next"),
    "attack_stop25_d20": Series(lies_as="all", to_victim_only=True, until_s=25.0),
    "attack_random1_broadcast_d20": Series(lies_as="random"),
    "attack_random1_broadcast_stop25_d20": Series(lies_as="random", until_s=25.0),
}


def sigma_norm(squared: Floats | float) -> Floats:
    """Return the sigma norm of vectors, from their squared lengths (eq. 8)."""
    return np.asarray((np.sqrt(1 + EPSILON * squared) - 1) / EPSILON)


def sigma_1(x: Floats) -> Floats:
    """Return x bounded by -1 and 1 (eq. 15)."""
    return np.asarray(x / np.sqrt(1 + x * x))


def bump(z: Floats) -> Floats:
    """Return 1 up to BUMP_FROM, 0 from 1 on, and a smooth way between them (eq. 10)."""
    falling = 0.5 * (1 + np.cos(np.pi * (z - BUMP_FROM) / (1 - BUMP_FROM)))
    return np.where(z < BUMP_FROM, 1.0, np.where(z < 1, falling, 0.0))


def phi(z: Floats) -> Floats:
    """Return the force between two robots, over how much their distance exceeds the wanted one (eq. 15)."""
    return np.asarray(0.5 * ((A + B) * sigma_1(z + C) + (A - B)))


def force_of_neighbours(at_m: Floats, speed_mps: Floats, heard: Heard, valid: NDArray[np.bool_]) -> Floats:
    """Return (N, 2) accelerations: keep the spacing, and match velocities (eq. 23)."""
    apart_m = heard.at_m - at_m[:, None, :]
    squared = (apart_m**2).sum(-1)
    weight = bump(sigma_norm(squared) / sigma_norm(INTERACTION_M * INTERACTION_M)) * valid
    force = weight * phi(sigma_norm(squared) - sigma_norm(SPACING_M * SPACING_M))
    direction = apart_m / np.sqrt(1 + EPSILON * squared)[..., None]
    consensus = (weight[..., None] * (heard.speed_mps - speed_mps[:, None, :])).sum(1)
    return np.asarray(C1_ALPHA * (force[..., None] * direction).sum(1) + C2_ALPHA * consensus)


def force_of_goal(at_m: Floats, speed_mps: Floats, *, sigmoid: bool) -> Floats:
    """Return (N, 2) accelerations to the goal (eq. 24)."""
    error_m = at_m - GOAL_M
    if sigmoid:
        return np.asarray(-C1_GAMMA * error_m / np.sqrt(1 + (error_m**2).sum(1, keepdims=True)) - C2_GAMMA * speed_mps)
    return np.asarray(-C1_GAMMA * error_m - C2_GAMMA * speed_mps)


class Heard:
    """What each robot (first axis) last heard of each other one (second axis)."""

    def __init__(self) -> None:
        self.at_m = np.zeros((ROBOTS, ROBOTS, 2))
        self.speed_mps = np.zeros((ROBOTS, ROBOTS, 2))
        self.when_s = np.full((ROBOTS, ROBOTS), NEVER_HEARD)

    def hear(self, by: NDArray[np.intp], of: int, at_m: Floats, speed_mps: Floats, now_s: float) -> None:
        """Replace what these robots know of one robot."""
        self.at_m[by, of], self.speed_mps[by, of], self.when_s[by, of] = at_m, speed_mps, now_s


def names_for(victim: int, lies_as: str, random: np.random.Generator) -> list[int]:
    """Return the robots in whose name the liar lies to a victim."""
    others = [robot for robot in range(ROBOTS) if robot not in (victim, LIAR)]
    if lies_as == "all":
        return others
    if lies_as == "next":
        return [next(robot % ROBOTS for robot in range(victim + 1, victim + ROBOTS) if robot % ROBOTS in others)]
    return [int(random.choice(others))]


def lie(
    heard: Heard,
    at_m: Floats,
    in_range: NDArray[np.bool_],
    series: Series,
    random: np.random.Generator,
    now_s: float,
) -> None:
    """Tell each robot in range that others stand in its way to the goal. Source: RoboRebound §5.3."""
    from_goal_m = at_m - GOAL_M
    distance_m = np.linalg.norm(from_goal_m, axis=1)
    away = from_goal_m / np.maximum(distance_m, 1e-9)[:, None]
    near = (distance_m <= LIE_AT_M)[:, None]
    places_m = np.where(near, at_m - away, GOAL_M + (LIE_AT_M - LIE_MARGIN_M) * away)
    ears = np.flatnonzero(in_range[:, LIAR])
    for victim in ears.tolist():
        for name in names_for(victim, series.lies_as, random):
            by = np.array([victim]) if series.to_victim_only else ears[ears != name]
            heard.hear(by, name, places_m[victim], LIE_MPS * away[victim], now_s)


def distances_m(series: Series) -> Iterator[tuple[float, Floats]]:
    """Yield (time, (N,) distances to the goal) every SAMPLE_S."""
    random = np.random.default_rng(SEED)
    along = np.arange(ROBOTS_A_SIDE) * ARENA_M / (ROBOTS_A_SIDE - 1)
    at_m = np.stack(np.meshgrid(along, along), -1).reshape(-1, 2)
    speed_mps, pull = np.zeros((ROBOTS, 2)), np.zeros((ROBOTS, 2))
    next_state_s = random.uniform(0, STATE_S, ROBOTS)
    heard, off = Heard(), False
    for step in range(STEPS + 1):
        now_s = step * STEP_S
        apart_m = np.sqrt(((at_m[:, None] - at_m[None]) ** 2).sum(-1))
        in_range = (apart_m <= RANGE_M) & ~np.eye(ROBOTS, dtype=bool)
        lies = bool(series.lies_as) and LIES_FROM_S <= now_s < series.until_s
        for robot in np.flatnonzero(next_state_s <= now_s + 1e-9).tolist():
            if off and robot == LIAR:
                continue
            next_state_s[robot] += STATE_S
            ears = in_range[:, robot].copy()
            ears[LIAR] &= not off
            heard.hear(np.flatnonzero(ears), robot, at_m[robot], speed_mps[robot], now_s)
        if step % STEPS_PER_CONTROL == 0:
            if lies:
                lie(heard, at_m, in_range, series, random, now_s)
            off = off or (bool(series.lies_as) and now_s >= series.until_s)
            pull = force_of_neighbours(at_m, speed_mps, heard, (now_s - heard.when_s) <= FORGET_S)
            pull = pull + force_of_goal(at_m, speed_mps, sigmoid=series.sigmoid_goal)
            pull = np.clip(pull, -LARGEST_MPS2, LARGEST_MPS2)
            if off:
                pull[LIAR] = speed_mps[LIAR] = 0
            if now_s % SAMPLE_S < STEP_S / 2:
                yield now_s, np.linalg.norm(at_m - GOAL_M, axis=1)
        at_m = at_m + speed_mps * STEP_S + 0.5 * pull * STEP_S * STEP_S
        speed_mps = speed_mps + pull * STEP_S


def both_files() -> tuple[str, str]:
    """Return the contents of WHOLE and CONDENSED."""
    whole = ["series,t_s,robot,is_attacker,distance_m"]
    short = {name: words for words, name in SERIES_OF_CONDENSED.items()}
    lines: dict[str, list[str]] = {words: [] for words in SERIES_OF_CONDENSED}
    for name, series in SERIES.items():
        honest = np.arange(ROBOTS) != (LIAR if series.lies_as else -1)
        for now_s, each_m in distances_m(series):
            whole += [
                f"{name},{now_s:.2f},{robot},{int(not honest[robot])},{distance_m:.3f}"
                for robot, distance_m in enumerate(each_m.tolist())
            ]
            if name in short:
                rounded_m = [round(distance_m, 3) for distance_m in each_m[honest].tolist()]
                mean, least, most = fmean(rounded_m), min(rounded_m), max(rounded_m)
                lines[short[name]].append(f"{short[name]},{now_s:g},{mean:.3f},{least:.3f},{most:.3f}")
    condensed = [line for words in lines.values() for line in words]
    return "\r\n".join(whole) + "\r\n", CONDENSED_HEAD + "\n".join(condensed) + "\n"


def main() -> int:
    """Write both files, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    check = parser.parse_args().check
    differ = 0
    for path, text in zip((WHOLE, CONDENSED), both_files(), strict=True):
        if check and path.read_bytes() != text.encode():
            print(f"{path} is not what this script computes", file=sys.stderr)
            differ += 1
        elif not check:
            path.write_bytes(text.encode())
    return int(differ > 0)


if __name__ == "__main__":
    raise SystemExit(main())
