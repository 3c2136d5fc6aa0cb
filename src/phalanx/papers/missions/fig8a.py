"""Encoded graphs Fig. 8a: a path of 150 s by odometry alone, by doorways, by all landmarks, and the true path."""

from __future__ import annotations

import numpy as np

from phalanx.papers.statement import Statement, quantiles
from phalanx.papers.table import Rows, Table, by_seed, seed_of
from phalanx.world.building.odometry import NoiseModel, OdometryNoise

from .drive import TICK_S, encoded, path_errors_m, record, replay

COLUMNS = (
    "t_s", "true_x_m", "true_y_m", "odometry_x_m", "odometry_y_m", "doorways_x_m", "doorways_y_m", "all_x_m", "all_y_m",
)  # fmt: skip
cases = by_seed
NOISE = OdometryNoise(0.03, 0.05, NoiseModel.FIXED)
# "any values below 0.15 m represent virtually zero error", Encoded graphs §VI-B
ZERO_M = 0.15
WAYS = ("odometry", "doorways", "all")


def measure_case(case: str, _tell: object = None) -> Rows:
    """Return the paths of one seed, a row for each tick of the lidar."""
    seed = seed_of(case)
    drive = record(seed)
    doors = replay(drive, encoded(("doorway",)), NOISE, seed)
    everything = replay(drive, encoded(), NOISE, seed)
    times_s = np.arange(len(drive.poses)) * TICK_S
    places = (drive.poses, doors.odometry, doors.estimates, everything.estimates)
    return np.column_stack([times_s, *(poses[:, :2] for poses in places)])


def compare(table: Table) -> list[Statement]:
    """Compare our measurements with Fig. 8a."""
    alone, *encoded_m = (path_errors_m(table, way) for way in WAYS)
    share = np.array([np.mean(errors <= ZERO_M) for errors in encoded_m[-1]])
    last = np.array([errors[-1] for errors in alone])
    out = [
        Statement(
            what="odometry alone at 150 s, error, m",
            paper="accumulates drift; 0 to 3 (axis of Fig. 8b)",
            ours=quantiles(last, ".2f"),
            agrees=bool(np.all(last > 1.0)),
            why="more than 1 m in every seed; fixed factor 1 + sigma (the paper does not say; phalanx docs adr/0019)",
        )
    ]
    for landmarks, remark, errors_m in zip(
        ("doorways only", "all landmarks"), (": the paper calls it virtually zero", ""), encoded_m, strict=True
    ):
        medians = np.array([np.median(errors) for errors in errors_m])
        out.append(
            Statement(
                what=f"{landmarks}, median error, m",
                paper="follows the truth",
                ours=quantiles(medians, ".3f"),
                agrees=bool(np.all(medians <= ZERO_M)),
                why=f"at most {ZERO_M} m{remark}",
            )
        )
    out.append(
        Statement(
            what="all landmarks, share of time within 0.15 m, %",
            ours=quantiles(100 * share, ".1f"),
            agrees=bool(np.all(share >= 0.95)),
            why="95 % in every seed",
        )
    )
    return out
