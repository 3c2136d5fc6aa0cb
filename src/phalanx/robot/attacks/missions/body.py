"""What happens to the body: wheels that turn and do not move the robot as they should. Faults, or somebody's oil."""

from __future__ import annotations

from typing import ClassVar

from .between import Between


class DeadWheel(Between):
    """One wheel turns in the air: odometry says straight on, and the robot goes round in circles."""

    def wheels(self) -> tuple[float, float]:
        """The left one is dead."""
        return (0.0, 1.0) if self.lies else (1.0, 1.0)


class Slip(Between):
    """Both wheels slip: the robot goes half as far as it believes."""

    SHARE: ClassVar[float] = 0.5

    def wheels(self) -> tuple[float, float]:
        """Half of it."""
        return (self.SHARE, self.SHARE) if self.lies else (1.0, 1.0)
