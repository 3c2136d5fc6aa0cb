"""What robots of one's own sense beside where they are: a lidar and bumpers, if their controller's class says so."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.config.parameter import check_limits, within

RANGE_BYTES = 4


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
        """So many bytes stand behind a reading."""
        return RANGE_BYTES * self.beams + self.bumpers
