"""The common part of patrols and explorers: places, each taken on by one robot, and which robot was where when.

A robot claims the place it goes to; of two that claim the same, the one with the lower id goes there. A robot that says
it was at a place is believed from its next message on, if that comes a turn later: one that comes sooner is another's
in its name. If it falls silent within `doubt_ms` it is doubted for good, for by P1 compromised robots are stopped by
then.

Source: RoboRebound §2.1 (they split up the region), §3.2 (bounded-time interaction); docs/guides/protocols.md.
"""

from __future__ import annotations

import math
from abc import abstractmethod

from phalanx.wire.protocols import NOWHERE, VISIT, WAITING
from phalanx.wire.record import MalformedRecord

from .peers import SILENT_PERIODS, PeerController
from .protocol import Point, Stage, Task, squared_m

NEAR = 0.25  # of a step: so near to a place one is there
NEAR_APART = 0.5  # where robots keep apart, one that stands at a place leaves no more room
PLACES_A_SIDE = 6
# Of the time between a robot's words: of two that come sooner, one is not its own, wherever the false one lies between.
TURN_AT_LEAST = 0.75


def near_m(task: Task) -> float:
    """Return how near to a place a robot is there."""
    return (NEAR_APART if task.keeps_apart else NEAR) * task.step_m


def place_m(task: Task, place: int) -> Point:
    """Return a place's coordinates, m: a square grid of the robots' step, from the origin."""
    x_m, y_m = task.origin_m
    return x_m + place % PLACES_A_SIDE * task.step_m, y_m + place // PLACES_A_SIDE * task.step_m


PLACES = range(PLACES_A_SIDE * PLACES_A_SIDE)


class PlaceController(PeerController):
    """A robot that goes from place to place.

    Attributes:
        visits: of each place, when somebody was there last, ms, and who; 0 for nobody.
        waiting: by id of each other: when it said where it was, ms (0: nothing waits), where, and its believed place.
    """

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id, task)
        self.visits = [(0, 0)] * len(PLACES)
        self.waiting = dict.fromkeys(self.others, (0, NOWHERE, NOWHERE))

    @abstractmethod
    def worth(self, t_ms: int, place: int, away_m: float) -> float | None:
        """Return the worth of going to a place at a distance; None for nothing."""

    def turn(self, t_ms: int, at_m: Point) -> None:
        """It is at its place, or takes on another."""
        left_m = math.sqrt(squared_m(at_m, place_m(self.task, self.holds)))
        if self.holds != NOWHERE and left_m < near_m(self.task):
            self.here, self.holds = self.holds, NOWHERE
            self.visits[self.here] = t_ms, self.rob_id
        heard = {rob_id: each for rob_id, each in self.others.items() if not self.is_silent(each, t_ms)}
        taken = {each.holds: rob_id for rob_id, each in heard.items()}
        if taken.get(self.holds, self.rob_id) < self.rob_id:
            self.holds = NOWHERE
        if self.holds == NOWHERE:
            taken.update((each.here, rob_id) for rob_id, each in heard.items())
            away_m = {place: math.sqrt(squared_m(at_m, place_m(self.task, place))) for place in PLACES}
            worth = {place: self.worth(t_ms, place, away_m[place]) for place in PLACES if place not in taken}
            choices = ((each, place) for place, each in worth.items() if each is not None)
            self.holds = max(choices, default=(0.0, NOWHERE))[1]

    def last_visit_ms(self, t_ms: int, place: int) -> int:
        """When somebody was there who is believed; 0 for never."""
        at_ms, rob_id = self.visits[place]
        other = self.others.get(rob_id)
        return 0 if other and self.is_silent(other, t_ms) and self._may_lie(at_ms, other.heard_ms) else at_ms

    def _may_lie(self, at_ms: int, heard_ms: int) -> bool:
        """Return whether a robot last heard then may have been stopped for its claim at `at_ms`."""
        return heard_ms - at_ms < self.task.doubt_ms

    def told(self, rob_id: int, t_ms: int, before_ms: int) -> None:
        """Somebody says where it is; where it said to be a turn ago, it was."""
        at_ms, place, been = self.waiting[rob_id]
        if t_ms - before_ms > SILENT_PERIODS * self.period_ms:
            self.visits = [
                (0, 0) if who == rob_id and self._may_lie(was_ms, before_ms) else (was_ms, who)
                for was_ms, who in self.visits
            ]
            at_ms = 0
        alone = t_ms - before_ms >= TURN_AT_LEAST * self.period_ms
        if at_ms and alone:
            self.visits[place], been = (at_ms, rob_id), place
        here = self.others[rob_id].here
        waits = alone and here != been and here in PLACES
        self.waiting[rob_id] = (t_ms, here, been) if waits else (0, NOWHERE, been)

    def aim(self) -> Point:
        """The place that it has taken on, or has."""
        place = self.holds if self.holds in PLACES else self.here
        return place_m(self.task, place) if place in PLACES else self.task.starts_m[self.rob_id - 1]

    def encode(self) -> bytes:
        """A `peer_memory`, a `visit` of each place behind it, and a `waiting` of each other robot."""
        visits = b"".join(VISIT.form.pack(*each) for each in self.visits)
        return super().encode() + visits + b"".join(WAITING.form.pack(*each) for each in self.waiting.values())

    def decode(self, encoding: bytes) -> None:
        """Back to a checkpoint. Raises: MalformedRecord: not one of this robot's."""
        visits_end = len(encoding) - WAITING.size * len(self.waiting)
        end = max(0, visits_end - VISIT.size * len(PLACES))
        super().decode(encoding[:end])
        self.visits = [(at_ms, rob_id) for at_ms, rob_id in VISIT.form.iter_unpack(encoding[end:visits_end])]
        waiting = WAITING.form.iter_unpack(encoding[visits_end:])
        self.waiting = dict(zip(self.waiting, waiting, strict=True))
        if self.holds != NOWHERE and self.holds not in PLACES:
            raise MalformedRecord(f"no place {self.holds}")
        if any(at_ms and place not in PLACES for at_ms, place, _ in self.waiting.values()):
            raise MalformedRecord("somebody waits at no place")


class PlaceStage(Stage):
    """Visits of robots to places, with times; the protocol scores them."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.visits: list[list[tuple[float, int]]] = [[] for _ in PLACES]

    def look(self, rob_id: int, t_s: float, at_m: Point, *, lies: bool) -> bytes:
        """A robot near a place is there."""
        self.now_s = max(self.now_s, t_s)
        origin_m, step_m = self.task.origin_m, self.task.step_m
        column, row = (round((each - first) / step_m) for each, first in zip(at_m, origin_m, strict=True))
        if not lies and 0 <= column < PLACES_A_SIDE and 0 <= row < PLACES_A_SIDE:
            place = row * PLACES_A_SIDE + column
            x, y = place_m(self.task, place)
            if math.hypot(x - at_m[0], y - at_m[1]) < near_m(self.task):
                self.visits[place].append((t_s, rob_id))
        return b""

    def marks(self) -> list[Point]:
        """The places."""
        return [place_m(self.task, place) for place in PLACES]
