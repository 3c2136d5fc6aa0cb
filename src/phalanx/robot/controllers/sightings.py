"""The common part of guards and trackers: things that move, reported by robots that see them; a few go to each.

A sensor reports the nearest thing within `SIGHT_STEPS`. Of one thing the latest message counts, so a robot's own eyes
come first. The `party` nearest robots go to it, all others to their posts. Messages are forgotten after
`FRESH_PERIODS`, and of each robot only the last is known: a compromised robot never invents more than one thing.
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

from .peer_bodies import BEHIND_T, ID, fields_of, is_fine
from .peers import PeerController
from .protocol import Point, Stage, Task, squared_m
from .python_controller import Output, Send

SIGHT_STEPS = 0.5  # of the robots' own step: so far a sensor sees
FRESH_PERIODS = 2  # of broadcasts: so long a word counts


class Sighted(NamedTuple):
    """The last message of a robot on a thing that it sees: heard when, which thing, and where it is."""

    at_ms: int = 0
    number: int = NOWHERE
    x_m: float = 0.0
    y_m: float = 0.0


class SightController(PeerController):
    """A robot that goes to a thing if few are nearer, and else to its post; it `holds` the thing's number.

    Class attributes:
        party: so many robots go to one thing.

    Attributes:
        sighted: by id, its own too: what was said last.
    """

    party: ClassVar[int]

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id, task)
        self.middle_m = middle_m(task)
        self.sighted = dict.fromkeys(range(1, len(task.starts_m) + 1), Sighted())
        self._now_ms = 0  # of the reading that is being answered: nothing to remember

    def things(self) -> dict[int, Point]:
        """Return each reported object's place: the latest report, of two equal ones our own."""
        fresh_ms = FRESH_PERIODS * self.period_ms
        latest: dict[int, tuple[int, bool, int, Point]] = {}
        for rob_id, said in self.sighted.items():
            if said.number != NOWHERE and 0 <= self._now_ms - said.at_ms <= fresh_ms:
                word = said.at_ms, rob_id == self.rob_id, rob_id, (said.x_m, said.y_m)
                latest[said.number] = max(word, latest.get(said.number, word))
        return {number: place_m for number, (*_, place_m) in sorted(latest.items())}

    def turn(self, t_ms: int, place_m: Point) -> None:
        """The thing that this robot is among the nearest to; those nearest to the middle have theirs first."""
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

    def aim(self) -> Point:
        """Return the place of its object, or its post."""
        return self.things().get(self.holds, self.task.waits_m[self.rob_id - 1])

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Store the sighting of another robot of the mission as well."""
        said = fields_of(SIGHTING, packet)
        if said and said[ID] in self.others:
            self.sighted[said[ID]] = Sighted(t_ms, *said[BEHIND_T:])
        super().on_recv(t_ms, packet)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        """It drives by what it sees, and says so in its turn."""
        self._now_ms = t_ms
        packet = self._frame(t_ms, reading)
        if packet and (said := fields_of(SIGHTING, packet)):
            self.sighted[self.rob_id] = Sighted(t_ms, *said[BEHIND_T:])
        outputs = super().on_input(step, t_ms, reading)
        return [*outputs, Send(packet)] if packet and len(outputs) > 1 else outputs

    def _frame(self, t_ms: int, reading: bytes) -> bytes:
        place_m, beside = self.body.where(reading), self.body.beside(reading)
        if place_m is None or len(beside) != SEEN.size:
            return b""
        number, dx_m, dy_m = SEEN.form.unpack(beside)
        x_m, y_m = place_m
        if number == NOWHERE or not (is_fine(x_m + dx_m) and is_fine(y_m + dy_m)):
            return b""
        return SIGHTING.form.pack(KIND_SIGHTING, self.rob_id, t_ms, number, x_m + dx_m, y_m + dy_m)

    def encode(self) -> bytes:
        """A `peer_memory`, and a `sighted` of each robot behind it, its own too."""
        return super().encode() + b"".join(SIGHTED.form.pack(*each) for each in self.sighted.values())

    def decode(self, encoding: bytes) -> None:
        """Back to a checkpoint. Raises: MalformedRecord: not one of this robot's."""
        end = len(encoding) - SIGHTED.size * len(self.sighted)
        super().decode(encoding[: max(0, end)])
        said = [Sighted(*each) for each in SIGHTED.form.iter_unpack(encoding[end:])]
        if not all(is_fine(each.x_m) and is_fine(each.y_m) for each in said):
            raise MalformedRecord("something is seen nowhere")
        self.sighted = dict(zip(self.sighted, said, strict=True))


class SightStage(Stage):
    """Things that move by themselves, and who is near them."""

    seen_bytes = SEEN.size

    @abstractmethod
    def things(self, t_s: float) -> dict[int, Point]:
        """See `Stage`: each that is still there."""

    @abstractmethod
    def near(self, rob_id: int, t_s: float, number: int, away_m: float) -> None:
        """A robot that does not lie is so near to a thing, at most as far as it sees."""

    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """The nearest thing, if it is in sight; a compromised robot sees it as well."""
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
    """Of the posts, m."""
    x_m = y_m = 0.0
    for x, y in task.waits_m:
        x_m, y_m = x_m + x, y_m + y
    return x_m / len(task.waits_m), y_m / len(task.waits_m)


@lru_cache(256)
def drawn(words: str) -> tuple[float, float]:
    """Two shares of one, the same for the same words with any version of any library."""
    number = int(hashlib.sha256(words.encode()).hexdigest(), 16)
    return (number >> 224) / (1 << 32), (number >> 192) % (1 << 32) / (1 << 32)
