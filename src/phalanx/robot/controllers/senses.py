"""Lidar and bumpers of simulated robots, declared by a controller's class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phalanx.config.parameter import check_limits, within
from phalanx.wire.typed_records import Reading

RANGE = np.dtype(np.float32).newbyteorder("<")  # on any machine


@dataclass(frozen=True, slots=True, kw_only=True)
class Senses:
    """A lidar and bumpers; angles are counterclockwise from east in the world frame, as point masses have no heading.

    The 27 bytes of a reading are followed by `beams` ranges from the robot's centre, m, f32 little-endian, infinity if
    nothing is within `range_m`. Then follow `bumpers` bytes, 1 for a sector that touches something.
    Raises: UsageError: a value is out of range.
    """

    beams: int = within(0, 0, 360)
    range_m: float = within(10.0, 0.1, 1e3)
    bumpers: int = within(0, 0, 16)

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def size(self) -> int:
        """Return the number of bytes after the fixed fields of a reading."""
        return RANGE.itemsize * self.beams + self.bumpers

    def is_readable(self, beside: bytes) -> bool:
        """Return whether these bytes are valid: no negative or NaN range, and each bumper 0 or 1."""
        if len(beside) != self.size:
            return False
        ranges_m, touches = self._both(beside)
        return all(each >= 0.0 for each in ranges_m) and all(each <= 1 for each in touches)

    def ranges_m(self, reading: Reading) -> tuple[float, ...]:
        """Return the range of each beam, m; infinity for nothing in range."""
        return self._both(reading.beside)[0]

    def touches(self, reading: Reading) -> tuple[bool, ...]:
        """Return whether each bumper touches something."""
        return tuple(map(bool, self._both(reading.beside)[1]))

    def _both(self, beside: bytes) -> tuple[tuple[float, ...], bytes]:
        end = RANGE.itemsize * self.beams
        return tuple(np.frombuffer(beside, RANGE, self.beams).tolist()), beside[end : end + self.bumpers]
