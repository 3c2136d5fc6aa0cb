"""Parameters of encoded missions: how things are put into cells (in the file), and how hard a robot tries (its own)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.errors import UsageError

TWO_PI = 2.0 * math.pi
WORST_KDF_BYTES = 1 << 25  # what one try may take of a robot's memory: N = 2^15 at r = 8


def _check(owner: object, limits: dict[str, tuple[float, float]]) -> None:
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:  # NaN too
            raise UsageError(f"{name} is {value}", f"{low:g} to {high:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class CodingConfig:
    """How observations become whole numbers; stored in the mission's file.

    Args:
        delta_mm: edge of a cell; the paper's simulations use 100, its camera 20.
        heading_bins: bins in a full turn, even; 24 are 15 degrees each.
        sectors: directions from one node to the next that are told apart.
        window_ms: length of a window of time.
        area_cm2: edge of a bin of areas, in steps of 0.01 m2 (100 cm2).
        kdf_log2_n: scrypt's cost (sealed profile): 12 takes about 10 ms a try and 4 MiB.
        kdf_r: scrypt's block size.
    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §IV-A, §VI-B; docs/spec/mission.md.
    """

    delta_mm: int = 100
    heading_bins: int = 24
    sectors: int = 120
    window_ms: int = 10_000
    area_cm2: int = 20_000
    kdf_log2_n: int = 12
    kdf_r: int = 8

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "delta_mm": (1, 10_000),
                "heading_bins": (8, 360),
                "sectors": (4, 3600),
                "window_ms": (1, 1 << 31),
                "area_cm2": (100, 10_000_000),
                "kdf_log2_n": (1, 15),
                "kdf_r": (1, 32),
            },
        )
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

    Args:
        tolerance_m: positions are searched up to so far from the estimate, on every axis.
        heading_tolerance_deg: headings are searched up to so far on both sides, if no position matched.
        heading_step_deg: in such steps.
        heading_retry_s: not more often than this.
        agree_m: so near must a second landmark come for a shifted heading to count, or for a fix not to be refused.
        drift_base_m: a fix may move the robot by so much at any time ...
        drift_per_m: ... and by so much more for every metre since the last one.
        kdf_tries: slow tries in one step (sealed profile): 12 take about 0.1 s at N = 2^12.
        hash_tries: fast tries in one step (paper profile).
        tried_limit: tries that are remembered, so that they are not made again.
        arrive_m: so near is there, on the way back.
        passing_m: a node decoded before counts as reached by a pose whose last fix is not longer ago than this.
        timeout_s: without a validation for so long, back to the last validated state; a node may say otherwise.
        messages_kept: encoded messages that are remembered; the oldest is forgotten first.
    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §VI-B (tolerance); docs/spec/mission.md (the rest).
    """

    tolerance_m: float = 0.5
    heading_tolerance_deg: float = 6.0
    heading_step_deg: float = 1.5
    heading_retry_s: float = 1.0
    agree_m: float = 0.3
    drift_base_m: float = 0.25
    drift_per_m: float = 0.1
    kdf_tries: int = 12
    hash_tries: int = 200_000
    tried_limit: int = 4096
    arrive_m: float = 0.7
    passing_m: float = 5.0
    timeout_s: float = 60.0
    messages_kept: int = 8

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "tolerance_m": (0.0, 10.0),
                "heading_tolerance_deg": (0.0, 30.0),
                "heading_step_deg": (0.1, 30.0),
                "heading_retry_s": (0.0, 3600.0),
                "agree_m": (0.0, 10.0),
                "drift_base_m": (0.0, 10.0),
                "drift_per_m": (0.0, 10.0),
                "kdf_tries": (1, 100_000),
                "hash_tries": (1, 1 << 30),
                "tried_limit": (16, 1 << 20),
                "arrive_m": (0.01, 10.0),
                "passing_m": (0.0, 1e6),
                "timeout_s": (0.1, 1e6),
                "messages_kept": (1, 64),
            },
        )
