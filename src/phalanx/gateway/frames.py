"""Frames: everything that happened in one tick, for all robots at once (docs/spec/vocabulary.md).

A tick is one frame if that fits a small message, and several frames otherwise; each can be read without the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.link.envelope import encode_json
from phalanx.robot import Led, Point, Robot

from .places import AROUND_CHARS, RECORD_CHARS, Places, in_places
from .vocabulary import Notice, status, tell_led, tell_places, tell_robot

FULL_EVERY_S = 1.0
QUIET_S = 0.25  # with the tick that follows: a page that hears nothing for 0.8 s tells its visitor
BATTERY_STEP_MV = 20  # a fifth of what a page shows
FRAME_BYTES = 60  # of a frame without its lists
# Of what changed of robots, in a tick: with places two kilobytes for a hundred robots, sixteen for a thousand.
CHANGES_BYTES, CHANGES_BYTES_EACH = 1000, 7
KEY_BYTES = 6  # of a list besides its name and elements
NOWHERE = 1e7  # mm: pages show no robot beyond


@dataclass(frozen=True, slots=True)
class Tick:
    """What happened in a tick: in small frames, whole, and for those who read the older words."""

    frames: tuple[dict[str, Any], ...]
    joined: tuple[Robot, ...]
    left: tuple[str, ...]
    changed: bool
    whole: dict[str, Any]  # one frame, however long


class Frames:
    """Compares the swarm with what visitors were told last, and numbers its robots.

    Args:
        limit_bytes: of a small frame's JSON; None: there are no small frames.
    """

    def __init__(self, limit_bytes: int | None) -> None:
        self._limit_bytes = limit_bytes and limit_bytes - FRAME_BYTES
        self._seq = self._ticks = 0
        self._numbers: dict[str, int] = {}
        self._next_number = 0
        self._told: dict[str, _Slow] = {}
        self._rows = np.zeros((0, 4), np.int64)
        self._full_at_s: float | None = None
        self._said_at_s = 0.0
        self._held = False
        self._in_turn = False  # not all that changed was told in the last tick
        self._last_told = ""

    def number(self, address: str) -> int:
        """What frames call this robot: shorter than its address, and told with it in every list of robots."""
        number = self._numbers.get(address)
        if number is None:
            number = self._numbers[address] = self._next_number
            self._next_number += 1
        return number

    def next(
        self,
        robots: Sequence[Robot],
        now_s: float,
        uptime_s: float,
        more: Mapping[str, Sequence[Any]] | None = None,
        *,
        held: bool = False,
    ) -> Tick | None:
        """The frames of this tick, or None if there is nothing to say and the last one is younger than `QUIET_S`.

        Of `uptime_s`, which is monotonic, every robot's place comes once in `FULL_EVERY_S`; `more` are further lists to
        be told, by their names. `held` robots stand still by the operator's word: every frame says so.
        """
        full = self._full_at_s is None or uptime_s - self._full_at_s >= FULL_EVERY_S
        rows = self._rows_of(robots)
        moved = rows if full else rows[_differ(rows, self._rows)]
        told = {robot.address: _slow(robot, now_s, self._told.get(robot.address)) for robot in robots}
        joined, left, changed = [], [], []
        if self._full_at_s is not None:
            joined = [robot for robot in robots if robot.address not in self._told]
            left = [address for address in self._told if address not in told]
            changed = self._changes(told, len(encode_json(more)) if more else 0)
        news_at_all = full or len(moved) or joined or left or changed or (more and any(more.values()))
        news_at_all = news_at_all or held != self._held
        if not news_at_all and uptime_s - self._said_at_s < QUIET_S:
            return None
        news = [tell_robot(robot, now_s, 0) | {"n": self.number(robot.address)} for robot in joined]
        lists: dict[str, Sequence[Any]] = {
            "left": left,
            "joined": news,
            "changed": changed,
            **(more or {}),
        }
        places = in_places(moved)
        frames = []
        if self._limit_bytes:
            frames = [self._frame(words, held) for words in self._packed(lists, places, self._limit_bytes)]
        whole: dict[str, Any] = {key: items for key, items in lists.items() if items}
        if places:
            whole["places"] = [some.piece(0, len(some)) for some in places]
        # Last: what cannot be told now, because a driver says nonsense, is still to be told at the next tick.
        self._rows, self._told, self._held = rows, told, held
        self._said_at_s = uptime_s
        for address in left:
            del self._numbers[address]
        if full:
            self._full_at_s = uptime_s
        self._ticks += 1
        said = _notice(self._ticks - 1, whole, held)
        return Tick(tuple(frames), tuple(joined), tuple(left), bool(changed), said)

    def _changes(self, told: dict[str, _Slow], others_bytes: int) -> list[dict[str, Any]]:
        """Return what changed of robots, as much as fits a tick; `told` keeps what was told before of the rest.

        A storm of routes once was 300 Mbit/s. Robots take turns: the next tick begins behind the last one told.
        """
        addresses = list(told)
        in_turn = self._in_turn and self._last_told in told
        first = addresses.index(self._last_told) + 1 if in_turn else 0
        left_bytes = max(CHANGES_BYTES, CHANGES_BYTES_EACH * len(told)) - others_bytes
        changes: list[dict[str, Any]] = []
        self._in_turn = False
        for address in addresses[first:] + addresses[:first]:
            before = self._told.get(address)
            if before is None or before is told[address]:
                continue
            change = None if self._in_turn else _change(address, before, told[address])
            left_bytes -= len(encode_json(change)) + 1 if change else 0
            if self._in_turn or (changes and left_bytes < 0):
                self._in_turn = True
                told[address] = before
            elif change:
                changes.append(change)
                self._last_told = address
        return changes

    def nothing(self, *, held: bool) -> dict[str, Any]:
        """Return a whole frame without news: on sessions there is one each tick, as gaps would tell who stands."""
        self._ticks += 1
        return _notice(self._ticks - 1, {}, held)

    def _packed(
        self, lists: Mapping[str, Sequence[Any]], places: Sequence[Places], limit_bytes: int
    ) -> list[dict[str, Any]]:
        """The lists in order, then the places, in as few frames as hold them; a long element has one of its own."""
        frames: list[dict[str, Any]] = [{}]
        used = 0
        for key, items in lists.items():
            for item in items:
                size = len(encode_json(item)) + 1
                named = 0 if key in frames[-1] else len(key) + KEY_BYTES
                if used and used + named + size > limit_bytes:
                    frames.append({})
                    used, named = 0, len(key) + KEY_BYTES
                frames[-1].setdefault(key, []).append(item)
                used += named + size
        for some in places:
            told = 0
            while told < len(some):
                records = min(len(some) - told, (limit_bytes - AROUND_CHARS - used) // RECORD_CHARS)
                if records > 0:
                    frames[-1].setdefault("places", []).append(some.piece(told, told + records))
                    told += records
                    used += AROUND_CHARS + RECORD_CHARS * records
                if told < len(some):
                    frames.append({})
                    used = 0
        return frames

    def _frame(self, words: dict[str, Any], held: bool) -> dict[str, Any]:
        self._seq += 1
        return _notice(self._seq - 1, words, held)

    def _rows_of(self, robots: Sequence[Robot]) -> NDArray[np.int64]:
        """Number, x, y (mm) and direction (degrees) of each robot, by number: (robots, 4)."""
        said = [(self.number(r.address), r.at.x_mm, r.at.y_mm, r.direction_deg) for r in robots]
        exact = np.array(said, np.float64).reshape(-1, 4)
        # A driver that knows no place says NaN: that robot stays where it was last, and the others are told.
        rows = np.rint(exact[(np.abs(exact) < NOWHERE).all(axis=1)]).astype(np.int64)
        return rows[np.argsort(rows[:, 0])]


def _notice(seq: int, words: dict[str, Any], held: bool) -> dict[str, Any]:
    return {"cmd": int(Notice.FRAME), "data": {"seq": seq, **words} | ({"held": True} if held else {})}


def _differ(rows: NDArray[np.int64], before: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which rows are not among those of `before`; both by number."""
    if not len(before):
        return np.ones(len(rows), np.bool_)
    beside = np.minimum(np.searchsorted(before[:, 0], rows[:, 0]), len(before) - 1)
    differ: NDArray[np.bool_] = np.any(before[beside] != rows, axis=1)
    return differ


class _Slow(NamedTuple):
    """Fields of one robot that change seldom. Equal ones stay the same tuple: that is soon compared."""

    led: Led
    route: tuple[Point, ...]
    threshold_mm: float
    battery_mv: int
    status: int
    has_trail: bool


def _slow(robot: Robot, now_s: float, before: _Slow | None) -> _Slow:
    battery_mv = round(robot.battery_v * 1000)
    if before is not None and abs(battery_mv - before.battery_mv) < BATTERY_STEP_MV:
        battery_mv = before.battery_mv
    silent = int(status(robot, now_s))
    now = _Slow(robot.led, robot.route, robot.threshold_mm, battery_mv, silent, bool(robot.history))
    return before if before is not None and now == before else now


def _change(address: str, before: _Slow | None, now: _Slow) -> dict[str, Any] | None:
    if before is None or before is now:
        return None
    change: dict[str, Any] = {}
    if now.led != before.led:
        change["rgb_led"] = tell_led(now.led)
    if now.route != before.route:
        change["waypoints"] = tell_places(now.route)
        if bool(now.route) != bool(before.route):
            change["mode"] = int(bool(now.route))
    if round(now.threshold_mm) != round(before.threshold_mm):
        change["waypoints_threshold"] = round(now.threshold_mm)
    if now.battery_mv != before.battery_mv:
        change["battery_mv"] = now.battery_mv
    if now.status != before.status:
        change["status"] = now.status
    if before.has_trail and not now.has_trail:
        change["history_cleared"] = True
    return {"address": address, **change} if change else None
