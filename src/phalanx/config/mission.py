"""Parameters of encoded missions: quantisation, which is in the mission file, and each robot's search effort."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from phalanx.errors import UsageError

from .lidar import EXACT_M, LidarConfig
from .parameter import check_limits, within

TWO_PI = 2.0 * math.pi
WORST_KDF_BYTES = 1 << 25  # memory limit of one scrypt call on a robot: N = 2^15 at r = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class CodingConfig:
    """Quantisation of observations to integers, and cost of scrypt; stored in the mission file.

    Raises: UsageError: a value is out of range. Source: Encoded graphs §IV-A, §VI-B; docs/spec/mission.md.
    """

    delta_mm: int = within(100, 1, 10_000)  # edge of a cell; the paper's simulations use 100, its camera 20
    heading_bins: int = within(24, 8, 360)  # in a full turn, even; 24 are 15 degrees each
    sectors: int = within(120, 4, 3600)  # number of distinct directions from one node to the next
    window_ms: int = within(10_000, 1, 1 << 31)  # length of a time window
    area_cm2: int = within(20_000, 100, 10_000_000)  # width of a bin of areas, in steps of 0.01 m2 (100 cm2)
    kdf_log2_n: int = within(12, 1, 15)  # scrypt's cost (sealed profile): 12 takes about 10 ms and 4 MiB per try
    kdf_r: int = within(8, 1, 32)  # scrypt's block size

    def __post_init__(self) -> None:
        check_limits(self)
        if self.heading_bins % 2:
            raise UsageError(f"heading_bins is {self.heading_bins}", "an even number: doorways use half as many bins")
        if 128 * self.kdf_r << self.kdf_log2_n > WORST_KDF_BYTES:
            raise UsageError(
                f"scrypt with N = 2^{self.kdf_log2_n}, r = {self.kdf_r}",
                "use a smaller kdf_log2_n or kdf_r: at most 32 MiB per try",
            )

    @property
    def bin_rad(self) -> float:
        """Return the width of a heading bin."""
        return TWO_PI / self.heading_bins

    @property
    def area_m2(self) -> float:
        """Return the width of an area bin."""
        return self.area_cm2 / 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    """Search effort of a robot, its assumptions about its sensors, and its time-outs.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §VI-B (tolerance); docs/spec/mission.md (the rest).
    """

    sigmas: float = within(3.5, 1.0, 10.0)  # cells farther than this many standard deviations are not tried
    tolerance_m: float = within(2.0, 0.0, 10.0)  # cells farther than this are not tried, whatever the deviation
    # Farther landmarks are not decoded: the error of one degree of heading would reach the next landmark.
    decode_m: float = within(6.0, 0.1, 1000.0)
    place_m: float = within(0.5, 0.0, 10.0)  # largest uncertainty of a position that counts as known
    agree_m: float = within(0.3, 0.0, 10.0)  # largest distance of two sightings of the same landmark
    drift_base_m: float = within(0.25, 0.0, 10.0)  # largest correction by a position fix ...
    drift_per_m: float = within(0.1, 0.0, 10.0)  # ... plus this for every metre since the last fix
    # Standard deviation of landmarks, both in scans and on maps: constant, per metre, and of their orientation
    sight_m: float = within(0.05, 1e-3, 10.0)
    sight_per_m: float = within(0.005, 0.0, 1.0)
    sight_deg: float = within(2.5, 0.01, 90.0)
    # Smallest standard deviation of a pose; one that is almost as small is not corrected
    sure_m: float = within(0.05, 1e-3, 10.0)
    sure_deg: float = within(1.0, 0.01, 90.0)
    # Errors of odometry. Systematic: scale of distance, scale of turns, degrees per metre. Then random, 1 sigma:
    odometry_way: float = within(0.05, 0.0, 1.0)
    odometry_turn: float = within(0.05, 0.0, 1.0)
    odometry_curve_deg: float = within(0.1, 0.0, 90.0)
    odometry_way_m: float = within(0.02, 0.0, 1.0)  # times the square root of the distance in metres
    odometry_turn_deg: float = within(0.8, 0.0, 90.0)  # times the square root of the turn in radians
    odometry_per_m_deg: float = within(0.2, 0.0, 90.0)  # times the square root of the distance in metres
    # Density of unmapped objects that look like a given landmark; 0 if the map shows the whole building
    strangers_per_m2: float = within(0.0, 0.0, 1000.0)
    kdf_tries: int = within(4, 1, 100_000)  # scrypt calls per step (sealed profile): 4 take 40 ms at N = 2^12
    hash_tries: int = within(200_000, 1, 1 << 30)  # hashes per step (paper profile)
    tried_limit: int = within(4096, 16, 1 << 20)  # failed tries that are stored, so that they are not repeated
    arrive_m: float = within(0.7, 0.01, 10.0)  # distance at which a decoded node counts as reached
    # Time without a validation after which the robot returns to the last validated state, unless the node sets another.
    timeout_s: float = within(60.0, 0.1, 1e6)
    rounds: int = within(2, 0, 255)  # retries of blocked edges when no other edge is left
    messages_kept: int = within(8, 1, 64)  # encoded messages that are stored; the oldest is dropped first

    def __post_init__(self) -> None:
        check_limits(self)

    def seen_by(self, lidar: LidarConfig) -> MissionConfig:
        """Return the parameters for robots with this lidar; up to 1 cm of noise they are unchanged.

        The error of the end of a wall is twice the noise of a range, at each sighting. Walls are longer by the square
        root of the noise (`ExtractionConfig.for_noise`), and the error of their direction grows by the same factor.
        """
        if lidar.noise_m <= EXACT_M:
            return self
        off_m, turned = 2 * lidar.noise_m, math.sqrt(lidar.noise_m / EXACT_M)
        return replace(
            self,
            sight_m=math.hypot(self.sight_m, off_m),
            sure_m=math.hypot(self.sure_m, off_m),
            sight_deg=min(90.0, turned * self.sight_deg),
            sure_deg=min(90.0, turned * self.sure_deg),
        )
