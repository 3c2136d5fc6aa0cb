"""State updates: all changes of one tick, for all robots at once (docs/spec/vocabulary.md).

With padding, an update has at most 2 KiB for a hundred robots and 16 KiB for a thousand. Changes that do not fit wait
for a later update.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.robot import Point, Robot
from phalanx.wire.sessions import PADDED

from .outbox import KEY_BYTES, Batch, Entry, Outbox
from .places import NOWHERE, Places, encode_route, group_places
from .robot_changes import Slow, change_of, slow_of
from .shields import MOST_AUDITS
from .vocabulary import Notice, robot_json

FULL_EVERY_S = 1.0
FRAME_BYTES = 60  # of an update without its lists
# Length of an update as JSON, per UNIT_ROBOTS robots. If all robots move, half of it is places.
UNIT_BYTES, UNIT_ROBOTS = 2048, 125
CHANGES_BYTES = 900  # per unit, reserved for changes other than places
# Lists of which only the newest item of each robot is sent, and those of which only the newest item is sent.
BY_ROBOT = frozenset({"shields", "walks", "drivers"})
NEWEST = frozenset({"mission", "work", "things"})


def tick_bytes(robots: int) -> int:
    """Return the longest JSON of an update: padded, it has 2 KiB for each 125 robots."""
    return UNIT_BYTES * _units(robots) - PADDED.size


def _units(robots: int) -> int:
    return max(1, -(-robots // UNIT_ROBOTS))


@dataclass(frozen=True, slots=True)
class Tick:
    """The update of one tick, and the changes that published clients need."""

    frame: dict[str, Any]
    joined: tuple[Robot, ...]
    left: tuple[str, ...]
    changed: bool


class StateUpdates:
    """Compares the swarm with what visitors were sent, and numbers its robots."""

    def __init__(self) -> None:
        self._ticks = 0
        self._numbers: dict[str, int] = {}
        self._next_number = 0
        # The state that visitors have, and the current state.
        self._known: dict[str, Slow] = {}
        self._now: dict[str, tuple[Robot, Slow]] = {}
        self._now_s = 0.0
        self._with_trail: set[str] = set()
        self._cleared: set[str] = set()  # robots whose cleared trail is not sent yet
        self._outbox = Outbox()
        self._events = count()
        self._mission: Any = None
        self._rows = np.zeros((0, 4), np.int64)  # places that visitors have
        self._next_place = 0  # number of the robot whose place is next in turn
        self._full_at_s: float | None = None

    def number(self, address: str) -> int:
        """Return a robot's number in updates: shorter than its address, and in every list of robots."""
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
    ) -> Tick:
        """Return the update of this tick, also without changes: gaps would reveal which robots stand still.

        Every robot's place is sent once in `FULL_EVERY_S` of `uptime_s`, which is monotonic. `more` has further lists
        by name. `held`: the operator has stopped all robots, which every update repeats.
        """
        full = self._full_at_s is None or uptime_s - self._full_at_s >= FULL_EVERY_S
        rows, before = self._rows_of(robots), self._rows[:0] if full else self._rows
        moved = rows[_differ(rows, before)]
        self._look(robots, now_s)
        self._add(more or {})
        batch, sent, places = self._within(tick_bytes(len(robots)) - FRAME_BYTES, moved, _units(len(robots)))
        whole: dict[str, Any] = dict(batch.lists)
        if places:
            whole["places"] = [some.encode() for some in places]
        # Last: if an invalid value of a driver raises above, nothing is marked as sent.
        known = before[np.isin(before[:, 0], rows[:, 0]) & ~np.isin(before[:, 0], sent[:, 0])]
        self._rows = _by_number(np.concatenate([known, sent]))
        joined = tuple(self._now[each["address"]][0] for each in batch.lists.get("joined", ()))
        self._outbox.sent(batch)
        if full:
            self._full_at_s = uptime_s
        self._ticks += 1
        data = {"seq": self._ticks - 1, **whole} | ({"held": True} if held else {})
        changed = "changed" in whole or "routes" in whole
        return Tick({"cmd": int(Notice.FRAME), "data": data}, joined, tuple(whole.get("left", ())), changed)

    def _look(self, robots: Sequence[Robot], now_s: float) -> None:
        """Put changes of robots that visitors lack into the outbox."""
        known, with_trail = self._known, {robot.address for robot in robots if robot.history}
        self._now_s = now_s
        self._now = {robot.address: (robot, slow_of(robot, now_s, known.get(robot.address))) for robot in robots}
        if self._full_at_s is None:  # the first update: visitors request the list of robots
            self._known = {address: slow for address, (_, slow) in self._now.items()}
        self._cleared |= (self._with_trail - with_trail) & self._known.keys() & self._now.keys()
        self._with_trail = with_trail
        # In the order of the robots, so that the order is deterministic.
        for address, (_, slow) in self._now.items():
            before = self._known.get(address)
            if before is None or address in self._cleared or not (before is slow or before.is_but_for_route(slow)):
                self._put_robot(address)
            if before is not None and before.route != slow.route:
                self._put_route(address)
        for address in self._known:
            if address not in self._now:
                self._put_robot(address)

    def _put_robot(self, address: str) -> None:
        self._outbox.put(("robot", address), lambda: self._robot_news(address))

    def _put_route(self, address: str) -> None:
        self._outbox.put(("route", address), lambda: self._route_news(address))

    def _robot_news(self, address: str) -> Iterable[Entry]:
        """Return an entry if a robot joined, left or changed, with its state at the time of sending."""
        before, now = self._known.get(address), self._now.get(address)
        if now is None:
            return (Entry("left", address, lambda: self._forget(address)),) if before else ()
        robot, slow = now
        if before is None:  # the route is sent separately, as it can be long
            joined = robot_json(robot._replace(route=()), self._now_s, 0) | {"n": self.number(address)}
            return (Entry("joined", joined, lambda: self._learn(address, slow._replace(route=()))),)
        told = slow._replace(route=before.route)
        change = change_of(address, before, told, cleared=address in self._cleared)
        return (Entry("changed", change, lambda: self._learn(address, told)),) if change else ()

    def _route_news(self, address: str) -> Iterable[Entry]:
        before, now = self._known.get(address), self._now.get(address)
        if before is None or now is None or before.route == now[1].route:
            return ()
        route = now[1].route
        told = encode_route(self.number(address), route)
        return (Entry("routes", told, lambda: self._learn_route(address, route)),)

    def _learn(self, address: str, known: Slow) -> None:
        is_new = address not in self._known
        self._known[address] = known
        self._cleared.discard(address)
        if is_new and self._now[address][1].route:
            self._put_route(address)

    def _learn_route(self, address: str, route: tuple[Point, ...]) -> None:
        self._known[address] = self._known[address]._replace(route=route)

    def _forget(self, address: str) -> None:
        self._known.pop(address, None)
        number = self._numbers.pop(address, None)
        for name in BY_ROBOT:
            self._outbox.forget((name, number))
        self._cleared.discard(address)

    def _add(self, more: Mapping[str, Sequence[Any]]) -> None:
        """Put further lists into the outbox. Raises: ValueError, TypeError: an item is not JSON; it is left out."""
        for name, items in more.items():
            for item in items:
                if name == "mission" and item[:1] != self._mission:
                    self._mission = item[:1]
                    self._outbox.forget_all("lit")
                self._outbox.put_item(self._key(name, item), name, item)

    def _key(self, name: str, item: Any) -> tuple[Any, ...]:
        if name in BY_ROBOT:
            return name, item[0]
        if name in NEWEST:
            return (name,)
        event = next(self._events)
        # The number of waiting audits is limited: new ones replace the oldest.
        return name, event % MOST_AUDITS if name == "audits" else event

    def _within(
        self, limit_bytes: int, moved: NDArray[np.int64], units: int
    ) -> tuple[Batch, NDArray[np.int64], list[Places]]:
        """Return the changes from the outbox and the places that fit, the latter as rows and packed.

        Each side can use the space that the other leaves. If both need more, places leave `CHANGES_BYTES` per unit.
        """
        places = group_places(moved)
        wanted = sum(some.chars for some in places) + len("places") + KEY_BYTES
        batch = self._outbox.next(limit_bytes - min(wanted, limit_bytes - CHANGES_BYTES * units))
        # No places of robots that visitors do not know: they would request the whole list.
        joined = {each["n"] for each in batch.lists.get("joined", ())}
        unknown = {self._numbers[address] for address in self._now if address not in self._known} - joined
        if unknown:
            moved = moved[~np.isin(moved[:, 0], list(unknown))]
            places = group_places(moved)
        left_bytes = limit_bytes - batch.size - len("places") - KEY_BYTES
        if sum(some.chars for some in places) > left_bytes:
            moved = self._in_turn(moved, left_bytes)
            places = group_places(moved)
        return batch, moved, places

    def _in_turn(self, moved: NDArray[np.int64], limit_bytes: int) -> NDArray[np.int64]:
        """Return as many rows as fit, sorted by number, starting with those that waited longest."""
        first = int(np.searchsorted(moved[:, 0], self._next_place))
        turns = np.roll(moved, -first, axis=0)
        fits, too_many = 0, len(turns) + 1
        while too_many - fits > 1:
            some = (fits + too_many) // 2
            chars = sum(each.chars for each in group_places(_by_number(turns[:some])))
            fits, too_many = (some, too_many) if chars <= limit_bytes else (fits, some)
        if fits:
            self._next_place = int(turns[fits - 1, 0]) + 1
        return _by_number(turns[:fits])

    def _rows_of(self, robots: Sequence[Robot]) -> NDArray[np.int64]:
        """Return number, x, y (mm) and direction (degrees) of each robot, sorted by number: (robots, 4)."""
        rows_now = [(self.number(r.address), r.at.x_mm, r.at.y_mm, r.direction_deg) for r in robots]
        exact = np.array(rows_now, np.float64).reshape(-1, 4)
        # NaN from a driver means an unknown place: that robot keeps its last one.
        rows = np.rint(exact[(np.abs(exact) < NOWHERE).all(axis=1)]).astype(np.int64)
        return _by_number(rows)


def _differ(rows: NDArray[np.int64], before: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which rows are not in `before`; both are sorted by number."""
    if not len(before):
        return np.ones(len(rows), np.bool_)
    beside = np.minimum(np.searchsorted(before[:, 0], rows[:, 0]), len(before) - 1)
    differ: NDArray[np.bool_] = np.any(before[beside] != rows, axis=1)
    return differ


def _by_number(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return rows[np.argsort(rows[:, 0])]
