"""Compare a robot's rarely changing fields with those that visitors have (docs/spec/vocabulary.md)."""

from __future__ import annotations

from typing import Any, NamedTuple

from phalanx.robot import Led, Point, Robot

from .vocabulary import status, tell_led

BATTERY_STEP_MV = 20  # a fifth of the resolution on pages


class Slow(NamedTuple):
    """Rarely changing fields of one robot. Equal values stay the same object, so comparison is fast."""

    led: Led
    route: tuple[Point, ...]
    threshold_mm: int
    battery_mv: int
    status: int

    def is_but_for_route(self, other: Slow) -> bool:
        """Return whether everything but the route is equal."""
        return self._replace(route=other.route) == other


def slow_of(robot: Robot, now_s: float, before: Slow | None) -> Slow:
    """Return a robot's fields; `before` are those that visitors have."""
    battery_mv = round(robot.battery_v * 1000)
    if before is not None and abs(battery_mv - before.battery_mv) < BATTERY_STEP_MV:
        battery_mv = before.battery_mv
    now = Slow(robot.led, robot.route, round(robot.threshold_mm), battery_mv, int(status(robot, now_s)))
    return before if before is not None and now == before else now


def change_of(address: str, before: Slow, now: Slow, *, cleared: bool) -> dict[str, Any] | None:
    """Return the fields except the route that visitors lack, or None; `cleared`: its trail was cleared."""
    change: dict[str, Any] = {}
    if now.led != before.led:
        change["rgb_led"] = tell_led(now.led)
    if now.threshold_mm != before.threshold_mm:
        change["waypoints_threshold"] = now.threshold_mm
    if now.battery_mv != before.battery_mv:
        change["battery_mv"] = now.battery_mv
    if now.status != before.status:
        change["status"] = now.status
    if cleared:
        change["history_cleared"] = True
    return {"address": address, **change} if change else None
