"""What a mission robot's s-node chains: odometry in its own frame, the scan's hash, and how much room there is around.

A reading is the record `mission_reading` of phalanx.wire.table, a scan u16 a beam. Odometry begins at 0, 0, 0 and is
never corrected. A sector's byte is the nearest hit in it, in steps of 2 cm rounded down; 255 is 5.1 m and more. That is
all an s-node has to do: a hash, and a minimum over whole numbers. Source: docs/spec/mission.md (Under audit).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.errors import UsageError
from phalanx.mission.landmarks.scan import LaserScan
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import KIND_MISSION_READING, MISSION_READING

_HEAD = MISSION_READING.form
HEAD_BYTES = _HEAD.size
PER_M, PER_RAD = 10_000, 1_000_000
MM_PER_M = 1000
CLEAR_STEP_M = 0.02
CLEAR = 255
SILENT, MISS = 0, 0xFFFF
MOST_M, MOST_RAD = 200_000.0, 2000.0
# What a beam's word says, by that word: metres, and steps of room.
_RANGES_M = np.arange(MISS + 1) / float(MM_PER_M)
_RANGES_M[[SILENT, MISS]] = np.nan, np.inf
_STEPS = np.minimum(np.arange(MISS + 1) // round(CLEAR_STEP_M * MM_PER_M), CLEAR).astype(np.uint8)
_STEPS[SILENT] = CLEAR


@dataclass(frozen=True, slots=True)
class Reading:
    """A reading, parsed."""

    x_m: float  # odometry, its own frame
    y_m: float  # likewise
    heading_rad: float  # likewise
    travelled_m: float  # way since the start, forwards and backwards
    scan_sha1: bytes
    clear: NDArray[np.uint8]  # (sectors,) uint8, see the table

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y, heading by odometry, its own frame."""
        return self.x_m, self.y_m, self.heading_rad


def scan_sha1(raw: bytes) -> bytes:
    """What a reading says of its scan. Source: docs/spec/mission.md (Under audit)."""
    return hashlib.sha1(raw, usedforsecurity=False).digest()


def with_hash_of(reading: bytes, raw: bytes) -> bytes:
    """The reading, had the scan been this one: what only an s-node may say."""
    head = list(_HEAD.unpack_from(reading))
    head[-1] = scan_sha1(raw)
    return _HEAD.pack(*head) + reading[HEAD_BYTES:]


@dataclass(frozen=True, slots=True)
class Sensors:
    """How the robots of a mission see: the same for all, and known to auditors.

    Raises: UsageError: the sectors do not divide the beams.
    """

    # Whose scans are hashed
    lidar: LidarConfig = LidarConfig()  # noqa: RUF009  # frozen
    beams_per_sector: int = 12  # that one byte of room stands for
    # What is made of them
    extraction: ExtractionConfig = ExtractionConfig()  # noqa: RUF009  # frozen

    def __post_init__(self) -> None:
        if self.beams_per_sector < 1 or self.lidar.beams % self.beams_per_sector:
            raise UsageError(f"sectors of {self.beams_per_sector} beams", f"a divisor of {self.lidar.beams}")

    @property
    def sectors(self) -> int:
        """Bytes of room in a reading."""
        return self.lidar.beams // self.beams_per_sector

    @property
    def reading_bytes(self) -> int:
        """Length of a reading."""
        return HEAD_BYTES + self.sectors

    def scan_of(self, raw: bytes) -> LaserScan:
        """The scan in these bytes, of which there must be two for each beam: what robots and auditors extract from."""
        words = np.frombuffer(raw, "<u2")
        assert len(words) == self.lidar.beams, "whoever unpacks a scan looks at its length"
        lidar = self.lidar
        return LaserScan(
            _RANGES_M[words], lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m
        )

    def parse(self, raw: bytes) -> Reading:
        """The reading in these bytes. Raises: MalformedRecord: its length or its kind is another's."""
        if len(raw) != self.reading_bytes or raw[0] != KIND_MISSION_READING:
            raise MalformedRecord("not a mission robot's reading")
        _, _, _, x, y, heading, travelled, sha1 = _HEAD.unpack_from(raw)
        clear = np.frombuffer(bytearray(raw[HEAD_BYTES:]), np.uint8)
        return Reading(x / PER_M, y / PER_M, heading / PER_RAD, travelled / MM_PER_M, sha1, clear)

    # --- the s-node's side ---

    def raw_of(self, scan: LaserScan) -> bytes:
        """The scan's bytes."""
        words = np.minimum(np.rint(scan.ranges_m * MM_PER_M), MISS)
        words[np.isnan(words)] = SILENT
        return words.astype("<u2").tobytes()

    def make(
        self, rob_id: int, t_ms: int, odometry: tuple[float, float, float], travelled_m: float, raw: bytes
    ) -> bytes:
        """The reading that goes into the chain.

        Args:
            t_ms: of the s-node's clock.
            odometry: x and y in metres and heading in radians, its own frame.
        Raises: UsageError: the robot has gone further than numbers go.
        """
        x_m, y_m, heading_rad = odometry
        if not (max(abs(x_m), abs(y_m)) < MOST_M and abs(heading_rad) < MOST_RAD and 0 <= travelled_m < MOST_M):
            raise UsageError("odometry beyond 200 km", "restart the robot")
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
        steps = _STEPS[np.frombuffer(raw, "<u2")]
        return head + np.minimum.reduceat(steps, range(0, len(steps), self.beams_per_sector)).tobytes()
