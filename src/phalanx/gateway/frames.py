"""Frames: everything that happened in one tick, for all robots at once (docs/spec/vocabulary.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from phalanx.robot import Robot

from .vocabulary import Notice, status, tell_led, tell_robot, tell_route

FULL_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame, and what happened in it for those who read the older words."""

    payload: dict[str, Any]
    joined: tuple[Robot, ...]
    left: tuple[str, ...]
    changed: bool


class Frames:
    """Compares the swarm with what visitors were told last."""

    def __init__(self) -> None:
        self._seq = 0
        self._told: dict[str, Robot] = {}
        self._rows: dict[str, list[Any]] = {}
        self._had_history: set[str] = set()
        self._full_at_s: float | None = None

    def next(self, robots: Sequence[Robot], now_s: float, uptime_s: float) -> Frame | None:
        """The next frame, or None if there is nothing to say and the last one is less than a second old.

        Args:
            robots: the swarm now.
            now_s: seconds since 1970.
            uptime_s: monotonic seconds; a full frame comes once in `FULL_EVERY_S` of them.
        """
        first = self._full_at_s is None
        full = self._full_at_s is None or uptime_s - self._full_at_s >= FULL_EVERY_S
        rows = {robot.address: _row(robot, now_s) for robot in robots}
        moved = [row for address, row in rows.items() if full or row != self._rows.get(address)]
        changed = [change for robot in robots if (change := self._change(robot))]
        joined = () if first else tuple(robot for robot in robots if robot.address not in self._told)
        left = tuple(address for address in self._told if address not in rows)
        if not (moved or changed or joined or left or full):
            return None
        data: dict[str, Any] = {"seq": self._seq, "robots": moved}
        if changed:
            data["changed"] = changed
        if joined:
            data["joined"] = [tell_robot(robot, now_s, 0) for robot in joined]
        if left:
            data["left"] = list(left)
        self._seq += 1
        self._rows = rows
        # The history is the swarm's own list and goes on growing: what was told of it is only whether it was there.
        self._told = {robot.address: robot for robot in robots}
        self._had_history = {robot.address for robot in robots if robot.history}
        if full:
            self._full_at_s = uptime_s
        return Frame({"cmd": int(Notice.FRAME), "data": data}, joined, left, bool(changed))

    def _change(self, robot: Robot) -> dict[str, Any] | None:
        before = self._told.get(robot.address)
        if before is None:
            return None
        change: dict[str, Any] = {}
        if robot.led != before.led:
            change["rgb_led"] = tell_led(robot.led)
        if robot.route != before.route:
            change["waypoints"] = tell_route(robot.route)
        if robot.threshold_mm != before.threshold_mm:
            change["waypoints_threshold"] = round(robot.threshold_mm)
        if not robot.history and robot.address in self._had_history:
            change["history_cleared"] = True
        return {"address": robot.address, **change} if change else None


def _row(robot: Robot, now_s: float) -> list[Any]:
    return [
        robot.address,
        round(robot.at.x_mm, 1),
        round(robot.at.y_mm, 1),
        robot.direction_deg,
        round(robot.battery_v * 1000),
        int(status(robot, now_s)),
        int(bool(robot.route)),
    ]
