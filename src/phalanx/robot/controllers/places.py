"""Common part of patrol and exploration: places, each assigned to one robot, and the history of visits.

A robot claims the place that it goes to; of two robots with the same claim, the one with the lower id goes there. A
visit that a robot reports counts from its next message on, if that comes a broadcast period later: an earlier message
shows that another robot uses its id. If a robot falls silent within `doubt_ms` of a visit, the visit is ignored for
good, because by P1 compromised robots are stopped by then.

Source: RoboRebound §2.1 (they split up the region), §3.2 (bounded-time interaction); docs/guides/protocols.md.
"""

from __future__ import annotations

import math
from abc import abstractmethod

from phalanx.wire.protocols import NOWHERE, VISIT, WAITING
from phalanx.wire.record import MalformedRecord

from .peers import SILENT_PERIODS, PeerController
from .protocol import Point, Stage, Task, squared_m

NEAR = 0.25  # distance at which a place counts as reached, in units of the grid's spacing
NEAR_APART = 0.5  # the same if robots keep apart: a robot that stands at a place keeps others farther away
PLACES_A_SIDE = 6
# Shortest time between a robot's messages, as a share of the period: if it is shorter, one of the two is forged.
TURN_AT_LEAST = 0.75


def near_m(task: Task) -> float:
    """Return the distance at which a robot has reached a place, m."""
    return (NEAR_APART if task.keeps_apart else NEAR) * task.step_m


def place_m(task: Task, place: int) -> Point:
    """Return a place's coordinates, m: places form a square grid with the robots' spacing, from the origin."""
    x_m, y_m = task.origin_m
    return x_m + place % PLACES_A_SIDE * task.step_m, y_m + place // PLACES_A_SIDE * task.step_m


PLACES = range(PLACES_A_SIDE * PLACES_A_SIDE)


class PlaceController(PeerController):
    """Robot that goes from place to place.

    Attributes:
        visits: for each place, time of the last visit, ms, and the visitor's id; (0, 0) for none.
        waiting: for each other robot: time, ms (0 for none), and place of its unconfirmed visit; its confirmed place.
    """

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id, task)
        self.visits = [(0, 0)] * len(PLACES)
        self.waiting = dict.fromkeys(self.others, (0, NOWHERE, NOWHERE))

    @abstractmethod
    def worth(self, t_ms: int, place: int, away_m: float) -> float | None:
        """Return the value of going to a place at a distance; None if the place needs no visit."""

    def turn(self, t_ms: int, at_m: Point) -> None:
        """Record the arrival at the claimed place, and claim another if needed."""
        left_m = math.sqrt(squared_m(at_m, place_m(self.task, self.holds)))
        if self.holds != NOWHERE and left_m < near_m(self.task):
            self.here, self.holds = self.holds, NOWHERE
            self.visits[self.here] = t_ms, self.rob_id
        active = {rob_id: each for rob_id, each in self.others.items() if not self.is_silent(each, t_ms)}
        taken = {each.holds: rob_id for rob_id, each in active.items()}
        if taken.get(self.holds, self.rob_id) < self.rob_id:
            self.holds = NOWHERE
        if self.holds == NOWHERE:
            taken.update((each.here, rob_id) for rob_id, each in active.items())
            away_m = {place: math.sqrt(squared_m(at_m, place_m(self.task, place))) for place in PLACES}
            worth = {place: self.worth(t_ms, place, away_m[place]) for place in PLACES if place not in taken}
            choices = ((each, place) for place, each in worth.items() if each is not None)
            self.holds = max(choices, default=(0.0, NOWHERE))[1]

    def last_visit_ms(self, t_ms: int, place: int) -> int:
        """Return the time of the last visit that counts, ms; 0 for none."""
        at_ms, rob_id = self.visits[place]
        other = self.others.get(rob_id)
        return 0 if other and self.is_silent(other, t_ms) and self._may_lie(at_ms, other.heard_ms) else at_ms

    def _may_lie(self, at_ms: int, heard_ms: int) -> bool:
        """Return whether a robot that fell silent at `heard_ms` may have been stopped for a lie at `at_ms`."""
        return heard_ms - at_ms < self.task.doubt_ms

    def told(self, rob_id: int, t_ms: int, before_ms: int) -> None:
        """Handle a claim: confirm the visit that the robot reported before, and store the new one as unconfirmed."""
        at_ms, place, confirmed = self.waiting[rob_id]
        if t_ms - before_ms > SILENT_PERIODS * self.period_ms:
            self.visits = [
                (0, 0) if who == rob_id and self._may_lie(was_ms, before_ms) else (was_ms, who)
                for was_ms, who in self.visits
            ]
            at_ms = 0
        in_time = t_ms - before_ms >= TURN_AT_LEAST * self.period_ms
        if at_ms and in_time:
            self.visits[place], confirmed = (at_ms, rob_id), place
        here = self.others[rob_id].here
        is_new = in_time and here != confirmed and here in PLACES
        self.waiting[rob_id] = (t_ms, here, confirmed) if is_new else (0, NOWHERE, confirmed)

    def target_point(self) -> Point:
        """Return the position of the claimed place, or of the current one."""
        place = self.holds if self.holds in PLACES else self.here
        return place_m(self.task, place) if place in PLACES else self.task.starts_m[self.rob_id - 1]

    def encode(self) -> bytes:
        """Encode a `peer_memory`, then a `visit` for each place and a `waiting` for each other robot."""
        visits = b"".join(VISIT.form.pack(*each) for each in self.visits)
        return super().encode() + visits + b"".join(WAITING.form.pack(*each) for each in self.waiting.values())

    def decode(self, encoding: bytes) -> None:
        """Restore a checkpoint. Raises: MalformedRecord: not a state of this robot."""
        visits_end = len(encoding) - WAITING.size * len(self.waiting)
        end = max(0, visits_end - VISIT.size * len(PLACES))
        super().decode(encoding[:end])
        self.visits = [(at_ms, rob_id) for at_ms, rob_id in VISIT.form.iter_unpack(encoding[end:visits_end])]
        waiting = WAITING.form.iter_unpack(encoding[visits_end:])
        self.waiting = dict(zip(self.waiting, waiting, strict=True))
        if self.holds != NOWHERE and self.holds not in PLACES:
            raise MalformedRecord(f"claim of unknown place {self.holds}")
        if any(at_ms and place not in PLACES for at_ms, place, _ in self.waiting.values()):
            raise MalformedRecord("unconfirmed visit of an unknown place")


class PlaceStage(Stage):
    """Stage that records visits of robots to places with times; each protocol computes its score from them."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.visits: list[list[tuple[float, int]]] = [[] for _ in PLACES]

    def look(self, rob_id: int, t_s: float, at_m: Point, *, lies: bool) -> bytes:
        """Record a visit if an honest robot is near a place."""
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
        """Return the positions of the places."""
        return [place_m(self.task, place) for place in PLACES]
