"""Parameters of encoded missions: how things are put into cells (in the file), and how hard a robot tries (its own)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from phalanx.errors import UsageError

from .lidar import EXACT_M, LidarConfig
from .parameter import check_limits, within

TWO_PI = 2.0 * math.pi
WORST_KDF_BYTES = 1 << 25  # what one try may take of a robot's memory: N = 2^15 at r = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class CodingConfig:
    """How observations become whole numbers; stored in the mission's file.

    Raises: UsageError: a value is out of range. Source: Encoded graphs §IV-A, §VI-B; docs/spec/mission.md.
    """

    delta_mm: int = within(100, 1, 10_000)  # edge of a cell; the paper's simulations use 100, its camera 20
    heading_bins: int = within(24, 8, 360)  # in a full turn, even; 24 are 15 degrees each
    sectors: int = within(120, 4, 3600)  # directions from one node to the next that are told apart
    window_ms: int = within(10_000, 1, 1 << 31)  # length of a window of time
    area_cm2: int = within(20_000, 100, 10_000_000)  # edge of a bin of areas, in steps of 0.01 m2 (100 cm2)
    kdf_log2_n: int = within(12, 1, 15)  # scrypt's cost (sealed profile): 12 takes about 10 ms a try and 4 MiB
    kdf_r: int = within(8, 1, 32)  # scrypt's block size

    def __post_init__(self) -> None:
        check_limits(self)
        if self.heading_bins % 2:
            raise UsageError(f"{self.heading_bins} heading bins", "an even number: a doorway has half as many")
        if 128 * self.kdf_r << self.kdf_log2_n > WORST_KDF_BYTES:
            raise UsageError(f"scrypt with N = 2^{self.kdf_log2_n}, r = {self.kdf_r}", "at most 32 MiB a try")

    @property
    def bin_rad(self) -> float:
        """Width of a bin of headings."""
        return TWO_PI / self.heading_bins

    @property
    def area_m2(self) -> float:
        """Width of a bin of areas."""
        return self.area_cm2 / 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    """How hard a robot tries, and when it gives up.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §VI-B (tolerance); docs/spec/mission.md (the rest).
    """

    sigmas: float = within(3.5, 1.0, 10.0)  # what is farther from the estimate than so many deviations is not tried
    tolerance_m: float = within(2.0, 0.0, 10.0)  # nor what is farther than this, however unsure the robot is
    # A landmark that is farther off is not decoded: what a degree of heading makes of it reaches to the next one.
    decode_m: float = within(6.0, 0.1, 1000.0)
    place_m: float = within(0.5, 0.0, 10.0)  # less sure of its own place than this, it is at none
    agree_m: float = within(0.3, 0.0, 10.0)  # what is so near is the same thing
    drift_base_m: float = within(0.25, 0.0, 10.0)  # a fix may move the robot by so much at any time ...
    drift_per_m: float = within(0.1, 0.0, 10.0)  # ... and by so much more for every metre since the last one
    # How exactly landmarks are seen, and drawn in maps: near by, for every metre, and their orientation
    sight_m: float = within(0.05, 1e-3, 10.0)
    sight_per_m: float = within(0.005, 0.0, 1.0)
    sight_deg: float = within(2.5, 0.01, 90.0)
    # A pose is never surer than so; one that is nearly as sure is left alone
    sure_m: float = within(0.05, 1e-3, 10.0)
    sure_deg: float = within(1.0, 0.01, 90.0)
    # How wrong odometry may be: always, of the way, of turns and in degrees per metre; and by chance
    odometry_way: float = within(0.05, 0.0, 1.0)
    odometry_turn: float = within(0.05, 0.0, 1.0)
    odometry_curve_deg: float = within(0.1, 0.0, 90.0)
    odometry_way_m: float = within(0.02, 0.0, 1.0)  # with the root of the way in metres
    odometry_turn_deg: float = within(0.8, 0.0, 90.0)  # with the root of the turn in radians
    odometry_per_m_deg: float = within(0.2, 0.0, 90.0)  # with the root of the way in metres
    # Things of one look, of a kind and turned alike, that nobody surveyed; 0 where the whole building is drawn
    strangers_per_m2: float = within(0.0, 0.0, 1000.0)
    kdf_tries: int = within(4, 1, 100_000)  # slow tries in one step (sealed profile): 4 take 40 ms at N = 2^12
    hash_tries: int = within(200_000, 1, 1 << 30)  # fast tries in one step (paper profile)
    tried_limit: int = within(4096, 16, 1 << 20)  # tries that are remembered, so that they are not made again
    arrive_m: float = within(0.7, 0.01, 10.0)  # so near is there, at a node decoded before
    # Without a validation for so long, back to the last validated state; a node may say otherwise.
    timeout_s: float = within(60.0, 0.1, 1e6)
    rounds: int = within(2, 0, 255)  # so often ways that were blocked are tried again, when no other is left
    messages_kept: int = within(8, 1, 64)  # encoded messages that are remembered; the oldest is forgotten first

    def __post_init__(self) -> None:
        check_limits(self)

    def seen_by(self, lidar: LidarConfig) -> MissionConfig:
        """These parameters for who sees by such a lidar, as they are up to 1 cm of noise.

        The end of a face is off by twice the noise of a range, and again by as much when it is seen again. Walls are
        longer by the root of the noise (`ExtractionConfig.for_noise`), and so turned by as much more.
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
