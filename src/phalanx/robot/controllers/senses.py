"""A lidar and bumpers, which robots have if their controller's class declares them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phalanx.config.parameter import check_limits, within
from phalanx.wire.typed_records import Reading

RANGE = np.dtype(np.float32).newbyteorder("<")  # on any machine


@dataclass(frozen=True, slots=True, kw_only=True)
class Senses:
    """A lidar and bumpers; all is counterclockwise from the east of the world's frame, for a point mass has no heading.

    Behind the 27 bytes of a reading stand `beams` ranges, f32 little-endian, m from the robot's middle, infinity where
    nothing is within `range_m`; and `bumpers` bytes, 1 where a sector touches. Raises: UsageError: out of range.
    """

    beams: int = within(0, 0, 360)
    range_m: float = within(10.0, 0.1, 1e3)
    bumpers: int = within(0, 0, 16)

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def size(self) -> int:
        """Return how many bytes stand behind a reading."""
        return RANGE.itemsize * self.beams + self.bumpers

    def is_readable(self, beside: bytes) -> bool:
        """Return whether these bytes are ranges, of which none is negative or a NaN, and bumpers, each 0 or 1."""
        if len(beside) != self.size:
            return False
        ranges_m, touches = self._both(beside)
        return all(each >= 0.0 for each in ranges_m) and all(each <= 1 for each in touches)

    def ranges_m(self, reading: Reading) -> tuple[float, ...]:
        """Return how far it is to what each beam hits; infinity for nothing in range."""
        return self._both(reading.beside)[0]

    def touches(self, reading: Reading) -> tuple[bool, ...]:
        """Return whether each bumper touches something."""
        return tuple(map(bool, self._both(reading.beside)[1]))

    def _both(self, beside: bytes) -> tuple[tuple[float, ...], bytes]:
        end = RANGE.itemsize * self.beams
        return tuple(np.frombuffer(beside, RANGE, self.beams).tolist()), beside[end : end + self.bumpers]
