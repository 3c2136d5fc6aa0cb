"""A driver of two wheels for a robot's own process, to be made yours: docs/deploy/index.md.

`Bench` has no hardware: its wheels turn in a computed world, so that all of it is tried before there is a robot.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

from phalanx.daemon.driver import Driver

TOP_MMPS, AXLE_MM = 300.0, 70.0


class Bench(Driver):
    """Wheels that are computed; the first robots stand in a row, 500 mm from each other."""

    def __init__(self, rob_id: int) -> None:
        super().__init__(rob_id)
        self.x_mm, self.y_mm, self.angle = 500.0 * rob_id, 1000.0, 0.0
        self.left = self.right = 0.0
        self.at_s = time.monotonic()

    def sense(self) -> Mapping[str, float]:
        """Where it is: yours asks a camera, a lighthouse or its own odometry. x to the right, y down, mm."""
        now_s = time.monotonic()
        dt_s, self.at_s = now_s - self.at_s, now_s
        ahead_mm = (self.left + self.right) / 2 * TOP_MMPS * dt_s
        self.x_mm -= ahead_mm * math.sin(self.angle)
        self.y_mm += ahead_mm * math.cos(self.angle)
        self.angle = (self.angle + (self.left - self.right) * TOP_MMPS * dt_s / AXLE_MM) % math.tau
        return {"x_mm": self.x_mm, "y_mm": self.y_mm, "direction_deg": math.degrees(self.angle)}

    def drive(self, command: Mapping[str, float]) -> None:
        """What the a-node let through: yours writes it to the motors' driver. Percent; red, green and blue to 255."""
        self.left, self.right = command["left"] / 100, command["right"] / 100

    def stop(self) -> None:
        """Yours switches its motors off."""
        self.left = self.right = 0.0
