"""Common part of perimeter and tracking protocols: moving objects are reported, and a few robots go to each.

A sensor reports the nearest object within `SIGHT_STEPS`. The latest report of an object counts, preferably the robot's
own. The `party` nearest robots go to the object, all others to their posts. Reports expire after `FRESH_PERIODS`, and
only the last of each robot is stored, so a compromised robot can invent only one object at a time.
Source: RoboRebound §2.1, §2.3.
"""

from __future__ import annotations

import hashlib
import math
from abc import abstractmethod
from functools import lru_cache
from typing import ClassVar, NamedTuple

from phalanx.wire.protocols import KIND_SIGHTING, NOWHERE, SEEN, SIGHTED, SIGHTING
from phalanx.wire.record import MalformedRecord

from .peer_bodies import FIRST_VALUE, ID, fields_of, is_fine
from .peers import PeerController
from .protocol import Point, Stage, Task, squared_m
from .python_controller import Output, Send

SIGHT_STEPS = 0.5  # range of the sensor, as a share of the grid's spacing
FRESH_PERIODS = 2  # lifetime of a report, in periods of broadcasts


class Sighted(NamedTuple):
    """Last report of a robot: when it was received, and number and position of the object."""

    at_ms: int = 0
    number: int = NOWHERE
    x_m: float = 0.0
    y_m: float = 0.0


class SightController(PeerController):
    """Robot that goes to an object if it is among the nearest, and else to its post; `holds` is the object's number.

    Class attributes:
        party: number of robots that go to one object.

    Attributes:
        sighted: last report of each robot by id, including its own.
    """

    party: ClassVar[int]

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id, task)
        self.middle_m = middle_m(task)
        self.sighted = dict.fromkeys(range(1, len(task.starts_m) + 1), Sighted())
        self._now_ms = 0  # time of the current reading, which is not part of the state

    def things(self) -> dict[int, Point]:
        """Return the position of each object by its latest report; of simultaneous reports, prefer our own."""
        fresh_ms = FRESH_PERIODS * self.period_ms
        latest: dict[int, tuple[int, bool, int, Point]] = {}
        for rob_id, report in self.sighted.items():
            if report.number != NOWHERE and 0 <= self._now_ms - report.at_ms <= fresh_ms:
                key = report.at_ms, rob_id == self.rob_id, rob_id, (report.x_m, report.y_m)
                latest[report.number] = max(key, latest.get(report.number, key))
        return {number: place_m for number, (*_, place_m) in sorted(latest.items())}

    def turn(self, t_ms: int, place_m: Point) -> None:
        """Choose the object of this robot; the objects nearest to the centre get their robots first."""
        self.holds = NOWHERE
        free = {rob_id: (each.x_m, each.y_m) for rob_id, each in self.others.items() if not self.is_silent(each, t_ms)}
        free[self.rob_id] = place_m
        things = self.things()
        for number in sorted(things, key=lambda number: (squared_m(things[number], self.middle_m), number)):
            nearest = sorted((squared_m(at_m, things[number]), rob_id) for rob_id, at_m in free.items())
            for _, rob_id in nearest[: self.party]:
                del free[rob_id]
            if self.rob_id not in free:
                self.holds = number
                return

    def target_point(self) -> Point:
        """Return the position of its object, or its post."""
        return self.things().get(self.holds, self.task.waits_m[self.rob_id - 1])

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Store the report of another robot of the mission, and handle the packet as other protocols do."""
        fields = fields_of(SIGHTING, packet)
        if fields and fields[ID] in self.others:
            self.sighted[fields[ID]] = Sighted(t_ms, *fields[FIRST_VALUE:])
        super().on_recv(t_ms, packet)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """Store the robot's own sighting, drive, and broadcast the sighting when a broadcast is due."""
        self._now_ms = t_ms
        packet = self._report(t_ms, reading)
        if packet and (fields := fields_of(SIGHTING, packet)):
            self.sighted[self.rob_id] = Sighted(t_ms, *fields[FIRST_VALUE:])
        outputs = super().on_input(step, t_ms, reading)
        return [*outputs, Send(packet)] if packet and len(outputs) > 1 else outputs

    def _report(self, t_ms: int, reading: bytes) -> bytes:
        """Return the packet about the object in a reading; b"" if there is none."""
        place_m, beside = self.body.where(reading), self.body.beside(reading)
        if place_m is None or len(beside) != SEEN.size:
            return b""
        number, dx_m, dy_m = SEEN.form.unpack(beside)
        x_m, y_m = place_m
        if number == NOWHERE or not (is_fine(x_m + dx_m) and is_fine(y_m + dy_m)):
            return b""
        return SIGHTING.form.pack(KIND_SIGHTING, self.rob_id, t_ms, number, x_m + dx_m, y_m + dy_m)

    def encode(self) -> bytes:
        """Encode a `peer_memory`, then a `sighted` for each robot including this one."""
        return super().encode() + b"".join(SIGHTED.form.pack(*each) for each in self.sighted.values())

    def decode(self, encoding: bytes) -> None:
        """Restore a checkpoint. Raises: MalformedRecord: not a state of this robot."""
        end = len(encoding) - SIGHTED.size * len(self.sighted)
        super().decode(encoding[: max(0, end)])
        reports = [Sighted(*each) for each in SIGHTED.form.iter_unpack(encoding[end:])]
        if not all(is_fine(each.x_m) and is_fine(each.y_m) for each in reports):
            raise MalformedRecord("the position of a sighting is out of range")
        self.sighted = dict(zip(self.sighted, reports, strict=True))


class SightStage(Stage):
    """Stage with moving objects, which records robots near them."""

    seen_bytes = SEEN.size

    @abstractmethod
    def things(self, t_s: float) -> dict[int, Point]:
        """Return the positions of all objects that are present; see `Stage`."""

    @abstractmethod
    def near(self, rob_id: int, t_s: float, number: int, away_m: float) -> None:
        """Record that an honest robot sees an object at this distance, m."""

    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """Return the nearest object if it is in sight, to compromised robots too."""
        self.now_s, things = max(self.now_s, t_s), self.things(t_s)
        away_m = {number: math.dist(at_m, place_m) for number, at_m in things.items()}
        number = min(away_m, key=lambda each: (away_m[each], each), default=NOWHERE)
        if away_m.get(number, math.inf) > SIGHT_STEPS * self.task.step_m:
            return SEEN.form.pack(NOWHERE, 0.0, 0.0)
        x, y = things[number]
        if not lies:
            self.near(rob_id, t_s, number, away_m[number])
        return SEEN.form.pack(number % NOWHERE, x - place_m[0], y - place_m[1])


def middle_m(task: Task) -> Point:
    """Return the centroid of the posts, m."""
    x_m = y_m = 0.0
    for x, y in task.waits_m:
        x_m, y_m = x_m + x, y_m + y
    return x_m / len(task.waits_m), y_m / len(task.waits_m)


@lru_cache(256)
def drawn(words: str) -> tuple[float, float]:
    """Return two pseudo-random numbers in [0, 1) that depend on `words` only, with any version of any library."""
    number = int(hashlib.sha256(words.encode()).hexdigest(), 16)
    return (number >> 224) / (1 << 32), (number >> 192) % (1 << 32) / (1 << 32)
