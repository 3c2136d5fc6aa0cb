"""Readings that a mission robot's s-node chains: odometry, the scan's hash, and the free range of each sector.

A reading is a `mission_reading` (phalanx.wire.table); a scan has u16 per beam. Odometry begins at 0, 0, 0 and is never
corrected. A sector's byte is the range of the nearest hit in steps of 2 cm, rounded down; 255 is 5.1 m and more. Other
sensors' readings follow the ranges, each as a `sensed`, and are hashed with them.
Source: docs/spec/mission.md (Under audit).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x1, U8x1, U16x1
from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.mission.landmarks.scan import LaserScan, clip_ranges
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import KIND_MISSION_READING, MISSION_READING, RANGE

_HEAD = MISSION_READING.form
HEAD_BYTES = _HEAD.size
PER_M, PER_RAD = 10_000, 1_000_000
MM_PER_M = 1000
CLEAR_STEP_M = 0.02
CLEAR = 255
SECTOR_RAD = math.radians(3)
SILENT, MISS = 0, 0xFFFF
SENSED_MAX_BYTES = 1024  # of other sensors, per reading
MOST_M, MOST_RAD = 200_000.0, 2000.0
_WORD = np.dtype(RANGE.dtype)  # made once: making it at each step takes longer than parsing a scan
_CLEAR_STEP_MM = round(CLEAR_STEP_M * MM_PER_M)


@kernel
def _words_of(ranges: F64x1, words: U16x1) -> None:
    for k in range(len(ranges)):
        millimetres = np.rint(ranges[k] * MM_PER_M)
        words[k] = SILENT if np.isnan(millimetres) else int(min(millimetres, float(MISS)))


@kernel
def _ranges_of(words: U16x1, ranges: F64x1, least_m: float, most_m: float) -> None:
    for k in range(len(words)):
        if words[k] == SILENT:
            ranges[k] = np.nan
        else:
            ranges[k] = np.inf if words[k] == MISS else int(words[k]) / float(MM_PER_M)
    clip_ranges(ranges, least_m, most_m)


@kernel
def _room_in(words: U16x1, each: int, clear: U8x1) -> None:
    for sector in range(len(clear)):
        nearest = int(MISS)
        for k in range(sector * each, (sector + 1) * each):
            if words[k] != SILENT:
                nearest = min(nearest, int(words[k]))
        clear[sector] = min(int(CLEAR), nearest // _CLEAR_STEP_MM)


@dataclass(frozen=True, slots=True)
class Reading:
    """A parsed reading."""

    pose: tuple[float, float, float]  # x, y, heading by odometry, odometry frame
    travelled_m: float  # distance driven since the start, forwards and backwards
    scan_sha1: bytes
    clear: NDArray[np.uint8]  # (sectors,) free ranges in steps of CLEAR_STEP_M


def scan_sha1(raw: bytes) -> bytes:
    """Return the hash of a scan for a reading. Source: docs/spec/mission.md (Under audit)."""
    return hashlib.sha1(raw, usedforsecurity=False).digest()


def with_hash_of(reading: bytes, raw: bytes) -> bytes:
    """Return the reading with the hash of another scan, as an s-node would make it."""
    head = list(_HEAD.unpack_from(reading))
    head[-1] = scan_sha1(raw)
    return _HEAD.pack(*head) + reading[HEAD_BYTES:]


@dataclass(frozen=True, slots=True)
class Sensors:
    """Sensors of a mission's robots, the same for all and known to auditors."""

    # The lidar whose scans are hashed
    lidar: LidarConfig = LidarConfig()  # noqa: RUF009  # frozen
    # Extraction of landmarks from scans
    extraction: ExtractionConfig = ExtractionConfig()  # noqa: RUF009  # frozen

    # Beams of one sector: about 3 degrees, equal for all sectors
    beams_per_sector: int = field(init=False, compare=False)
    sectors: int = field(init=False, compare=False)  # number of sectors, a byte each in a reading
    # Lengths of a scan and of a reading, cached because each step needs them
    scan_bytes: int = field(init=False, compare=False)
    reading_bytes: int = field(init=False, compare=False)

    def __post_init__(self) -> None:
        beams, step_rad = self.lidar.beams, self.lidar.angle_increment_rad
        divisors = (count for count in range(1, beams + 1) if beams % count == 0)
        each = min(divisors, key=lambda count: abs(count * step_rad - SECTOR_RAD))
        sizes = (each, beams // each, RANGE.size * beams, HEAD_BYTES + beams // each)
        for name, size in zip(("beams_per_sector", "sectors", "scan_bytes", "reading_bytes"), sizes, strict=True):
            object.__setattr__(self, name, size)

    def scan_of(self, raw: bytes) -> LaserScan:
        """Decode a scan of u16 per beam, as robots and auditors use it for extraction."""
        lidar = self.lidar
        ranges = np.empty(lidar.beams)
        words = np.frombuffer(raw, _WORD, lidar.beams)
        _ranges_of(words, ranges, float(lidar.range_min_m), float(lidar.range_max_m))
        return LaserScan.of(ranges, lidar)

    def parse(self, raw: bytes) -> Reading:
        """Parse a reading. Raises: MalformedRecord: wrong length or kind."""
        if len(raw) != self.reading_bytes or raw[0] != KIND_MISSION_READING:
            raise MalformedRecord("not a mission robot's reading")
        _, _, _, x, y, heading, travelled, sha1 = _HEAD.unpack_from(raw)
        clear = np.frombuffer(bytearray(raw[HEAD_BYTES:]), np.uint8)
        pose = x / PER_M, y / PER_M, heading / PER_RAD
        return Reading(pose, travelled / MM_PER_M, sha1, clear)

    # --- the s-node's side ---

    def raw_of(self, scan: LaserScan, entries: Iterable[bytes] = ()) -> bytes:
        """Encode a scan, followed by the entries of other sensors that fit into SENSED_MAX_BYTES."""
        words = np.empty(len(scan.ranges_m), _WORD)
        _words_of(scan.ranges_m, words)
        raw, most = words.tobytes(), self.scan_bytes + SENSED_MAX_BYTES
        for entry in entries:
            if len(raw) + len(entry) <= most:
                raw += entry
        return raw

    def make(
        self, rob_id: int, t_ms: int, odometry: tuple[float, float, float], travelled_m: float, raw: bytes
    ) -> bytes:
        """Return the reading to chain, at `t_ms` of the s-node's clock. Raises: UsageError: odometry is out of range.

        Args:
            odometry: x and y in metres and heading in radians, odometry frame.
        """
        x_m, y_m, heading_rad = odometry
        if not (max(abs(x_m), abs(y_m)) < MOST_M and abs(heading_rad) < MOST_RAD and 0 <= travelled_m < MOST_M):
            raise UsageError("odometry is beyond 200 km or 2000 rad", "restart the robot")
        head = _HEAD.pack(
            KIND_MISSION_READING,
            rob_id,
            t_ms,
            round(x_m * PER_M),
            round(y_m * PER_M),
            round(heading_rad * PER_RAD),
            round(travelled_m * MM_PER_M),
            scan_sha1(raw),
        )
        clear = np.empty(self.sectors, np.uint8)
        _room_in(np.frombuffer(raw, _WORD, self.lidar.beams), self.beams_per_sector, clear)
        return head + clear.tobytes()
