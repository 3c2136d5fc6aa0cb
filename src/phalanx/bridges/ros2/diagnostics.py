"""Diagnostics of a robot's shield and verdicts, in the form of ROS 2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .geometry import Place

ODOM_IN_MAP = "odom in map"  # key of the pose of the odometry frame: x, y, yaw
OK, WARN, ERROR = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Told:
    """Contents of one diagnostic_msgs/DiagnosticStatus."""

    level: int
    name: str
    message: str
    values: Mapping[str, Any]


def told_of(state: Mapping[str, Any], odom_in_map: Place) -> tuple[Told, Told]:
    """Return the status of the shield and of the verdicts, from the JSON of `phalanx robot status --json`."""
    tokens, needed = state["tokens"], state["tokens_needed"]
    place = f"{odom_in_map.x_m}, {odom_in_map.y_m}, {odom_in_map.yaw_rad}"
    values = {ODOM_IN_MAP: place} | {f"robot {each['auditor']}": f"{each['left_s']:.1f} s" for each in tokens}
    if state["safe_mode"]:
        shield = Told(ERROR, "shield", f"Safe Mode: {state['why_stopped']}", values)
    elif missing := state["no_reading"]:
        shield = Told(WARN, "shield", f"no reading for {missing['for_s']:.1f} s: {missing['why']}", values)
    elif len(tokens) < needed:
        shield = Told(WARN, "shield", f"{len(tokens)} vouch, {needed} are needed", values)
    else:
        shield = Told(OK, "shield", f"{len(tokens)} vouch", values)
    refused = {f"robot {each['auditee']}: {each['reason']}": each["times"] for each in state["refused"]}
    given = {f"robot {each['auditee']}: tokens given": each["times"] for each in state["given"]}
    level, words = (WARN, "refuses robots") if refused else (OK, "refuses nobody")
    return shield, Told(level, "verdicts", words, {**refused, **given})


def place_in(words: str) -> Place | None:
    """Parse a value of ODOM_IN_MAP; None if it is invalid."""
    try:
        x_m, y_m, yaw_rad = map(float, words.split(","))
    except ValueError:
        return None
    sound = all(map(math.isfinite, (x_m, y_m, yaw_rad)))
    return Place(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad) if sound else None
