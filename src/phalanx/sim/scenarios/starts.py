"""Where a scenario's robots stand at first."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from phalanx.errors import UsageError

if TYPE_CHECKING:
    from .scenario import Scenario

WHEELS = "wheels"  # the controller that obeys orders


def starts_of(scenario: Scenario) -> list[tuple[float, float]]:
    """N places, m, in the order of ids. Raises: UsageError: robots on wheels do not fit into their area."""
    n, step_m, row = scenario.robots, scenario.grid_step_m, scenario.robots_per_edge
    if scenario.controller == WHEELS:
        corner_m = [(side_m - step_m * (row - 1)) / 2 for side_m in scenario.area_m]
        if min(corner_m) <= 0:
            raise UsageError(f"area_m has no room for {n} robots", "a larger one, or a smaller grid_step_m")
        return [(corner_m[0] + i % row * step_m, corner_m[1] + i // row * step_m) for i in range(n)]
    if scenario.formation == "ring":
        radius_m, turn = step_m / 2 / math.sin(math.pi / max(n, 2)), math.tau / n
        around = [(math.cos(i * turn), math.sin(i * turn)) for i in range(n)]
        # To the millimetre: a cosine's last bit is not the same on all machines.
        return [(round(radius_m * (1 + x), 3), round(radius_m * (1 + y), 3)) for x, y in around]
    edge = n if scenario.formation == "line" else row
    apart_m = edge * step_m + math.ceil(scenario.radio.range_m)
    return [
        (i % edge * step_m + nth * apart_m, i // edge * step_m)
        for nth, robots in enumerate(scenario.grids)
        for i in range(robots)
    ]
