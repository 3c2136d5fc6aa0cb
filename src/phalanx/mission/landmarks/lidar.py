"""A 2-D lidar in a world of walls and people: sweeps with noise, drop-outs and a range at which it misses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x1, F64x2
from phalanx.config.lidar import LidarConfig
from phalanx.kernel import kernel

from .raycast import Beams, Tiles, cast, packed_beams, tiles_of
from .scan import LaserScan, beam_table, sort_out

Pose = tuple[float, float, float]
_NOBODY, _NOTHING = np.zeros((0, 3)), np.zeros(0)


@kernel
def _sensed(
    pose: Pose,
    tiles: Tiles,
    people: F64x2,
    beams: Beams,
    draws: tuple[F64x1, F64x1],
    wrong: tuple[float, float, float],
    ranges: F64x1,
) -> None:
    """What a lidar tells: with noise, and some beams say nothing; either where there are draws for it.

    Args:
        draws: normal, and uniform below 1, for each beam or for none.
        wrong: noise in metres, share of beams that say nothing, and the nearest range that is told.
    """
    (normals, chances), (noise_m, drop_out, least_m) = draws, wrong
    cast(pose, tiles, people, beams, ranges)
    for k in range(len(normals)):
        ranges[k] += noise_m * normals[k]
    for k in range(len(chances)):
        if chances[k] < drop_out:
            ranges[k] = np.nan
    sort_out(ranges, least_m, beams.range_max_m)


class Lidar:
    """A lidar that sees `walls`, (n, 4) ends of segments in the map frame; one object serves any number of robots."""

    def __init__(self, walls: NDArray[np.float64], config: LidarConfig | None = None) -> None:
        self.config = config or LidarConfig()
        self._tiles = tiles_of(np.asarray(walls, np.float64).reshape(-1, 4))
        first, step = self.config.angle_min_rad, self.config.angle_increment_rad
        self._wrong = float(self.config.noise_m), float(self.config.drop_out), float(self.config.range_min_m)
        table = beam_table(first, step, self.config.beams)
        self._beams = packed_beams(Beams(first, step, *table, float(self.config.range_max_m)))

    def true_ranges(self, pose: Pose, people: NDArray[np.float64] = _NOBODY) -> NDArray[np.float64]:
        """(beams,) distances without noise; +inf is a miss."""
        ranges = np.empty(self.config.beams)
        cast((float(pose[0]), float(pose[1]), float(pose[2])), self._tiles, people, self._beams, ranges)
        return ranges

    def sweep(
        self,
        pose: Pose,
        random: np.random.Generator,
        people: NDArray[np.float64] = _NOBODY,
    ) -> LaserScan:
        """A scan from a pose.

        Args:
            pose: x, y in metres and heading in radians, map frame.
            people: (m, 3) centre and radius in metres.
        """
        config = self.config
        x, y, heading = pose
        ranges = np.empty(config.beams)
        normals = random.standard_normal(config.beams) if config.noise_m else _NOTHING
        chances = random.random(config.beams) if config.drop_out else _NOTHING
        at, wrong = (float(x), float(y), float(heading)), self._wrong
        _sensed(at, self._tiles, people, self._beams, (normals, chances), wrong, ranges)
        return LaserScan.of(ranges, config)
