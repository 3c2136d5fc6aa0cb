"""A driver of two wheels for a robot's own process, to be made yours: docs/guides/deploy/index.md.

`Bench` has no hardware, so that all of it is tried before there is a robot: its wheels turn in a computed world, and
`motors.py` beside this file stands for the board that has the motors. `motors-1.txt` shows what robot 1's wheels do.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from phalanx.daemon.driver import Driver

TOP_MMPS, AXLE_MM = 300.0, 70.0


class Bench(Driver):
    """Computed wheels; the first robots stand in a row, 500 mm from each other."""

    def __init__(self, rob_id: int) -> None:
        super().__init__(rob_id)
        self.x_mm, self.y_mm, self.angle = 500.0 * rob_id, 1000.0, 0.0
        self.left = self.right = 0
        self.at_s = time.monotonic()
        here = Path(__file__).parent
        self.motors = subprocess.Popen(  # yours opens a serial line
            [sys.executable, here / "motors.py", here / f"motors-{rob_id}.txt"],
            stdin=subprocess.PIPE,
            start_new_session=True,
        )

    def sense(self) -> Mapping[str, float]:
        """Return where the robot is: x to the right, y down, mm. Yours asks a camera, a lighthouse or odometry.

        Raise `NoReading` of phalanx.daemon.driver, with the reason, while that is not known.
        """
        now_s = time.monotonic()
        dt_s, self.at_s = now_s - self.at_s, now_s
        left_mmps, right_mmps = self.left * TOP_MMPS / 100, self.right * TOP_MMPS / 100
        self.x_mm -= (left_mmps + right_mmps) / 2 * dt_s * math.sin(self.angle)
        self.y_mm += (left_mmps + right_mmps) / 2 * dt_s * math.cos(self.angle)
        self.angle = (self.angle + (left_mmps - right_mmps) * dt_s / AXLE_MM) % math.tau
        return {"x_mm": self.x_mm, "y_mm": self.y_mm, "direction_deg": math.degrees(self.angle)}

    def drive(self, command: Mapping[str, float]) -> None:
        """Send the wheels, in percent, to the motors. `command` has red, green and blue too, 0 to 255."""
        self._turn(int(command["left"]), int(command["right"]))

    def stop(self) -> None:
        """Stop the wheels."""
        self._turn(0, 0)

    def close(self) -> None:
        """Leave the motors."""
        self.motors.communicate()

    def _turn(self, left: int, right: int) -> None:
        self.left, self.right = left, right
        assert self.motors.stdin
        self.motors.stdin.write(b"%d %d\n" % (left, right))
        self.motors.stdin.flush()
