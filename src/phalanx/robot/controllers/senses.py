"""A lidar and bumpers, which robots have if their controller's class declares them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phalanx.config.parameter import check_limits, within
from phalanx.wire.typed_records import Reading

RANGE = np.dtype(np.float32).newbyteorder("<")  # on any machine


@dataclass(frozen=True, slots=True, kw_only=True)
class Senses:
    """A point mass has no heading: all is from the east on, counterclockwise, in the world's frame.

    Behind the 27 bytes of a reading stand `beams` ranges, f32 little-endian, m from the robot's middle, infinity where
    nothing is within `range_m`; and `bumpers` bytes, a sector each, 1 where it touches something.

    Raises: UsageError: a value is out of range.
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
        return all(each >= 0.0 for each in self._ranges(beside)) and all(each <= 1 for each in self._bumpers(beside))

    def ranges_m(self, reading: Reading) -> tuple[float, ...]:
        """Return how far it is to what each beam hits; infinity for nothing in range."""
        return self._ranges(reading.beside)

    def touches(self, reading: Reading) -> tuple[bool, ...]:
        """Return whether each bumper touches something."""
        return tuple(map(bool, self._bumpers(reading.beside)))

    def _ranges(self, beside: bytes) -> tuple[float, ...]:
        return tuple(np.frombuffer(beside, RANGE, self.beams).tolist())

    def _bumpers(self, beside: bytes) -> bytes:
        return np.frombuffer(beside, np.uint8, self.bumpers, RANGE.itemsize * self.beams).tobytes()
