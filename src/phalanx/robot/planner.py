"""Planners advise guarded robots, and the guard decides (docs/guides/guard.md).

A planner is any program: it may use chance, a clock, a network, a learned policy. Nobody replays it; only its advice
is in the log. It may run elsewhere (`Adviser`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from phalanx.wire.guarded import KIND_WISH, WISH
from phalanx.wire.record import LARGEST_F32
from phalanx.wire.table import KIND_SENSOR, KIND_STATE, SENSOR, STATE

from .controllers.python_controller import OwnMistake, kind_of

if TYPE_CHECKING:
    from .signer import AdviceSigner

Pair = tuple[float, float]
MakePlanner = Callable[[int, Pair], "Planner"]
FARTHEST = 1e6  # what a guard takes for a reading
# Of two clocks: what delays and a drift of 500 ppm make of a reading's date.
AHEAD_MS, DRIFT = 1000, 2000
MOST_BYTES = max(SENSOR.size, STATE.size)


class Planner(ABC):
    """An adviser of one robot.

    Args:
        rob_id: 1..65535.
        goal_m: where the scenario would have it go, x and y.
    """

    def __init__(self, rob_id: int, goal_m: Pair) -> None:
        self.rob_id, self.goal_m = rob_id, goal_m

    @abstractmethod
    def advise(self, t_s: float, position_m: Pair, velocity_mps: Pair) -> Sequence[float] | None:
        """Return the velocity that it wants, m/s, x and y, or None; called at each reading, `t_s` its time.

        Two numbers are advice whatever they are: the guard shortens what is too fast, and ignores NaN and infinity.
        """

    def hear(self, t_s: float, rob_id: int, position_m: Pair, velocity_mps: Pair) -> None:  # noqa: B027 - may not care
        """Another robot says where it is and where it goes; it may lie."""


class ToGoal(Planner):
    """Straight to the goal, slower near it: an honest planner that does not look where it goes."""

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float]:
        """Return the way to the goal as a velocity; the guard knows how fast that may be."""
        return [to - at for to, at in zip(self.goal_m, position_m, strict=True)]


def advice_of(planner: Planner, t_ms: int, reading: bytes) -> bytes:
    """Return a planner's advice on a reading, as it is logged; b"" for nothing.

    Raises: OwnMistake: it returned something else. What the planner raises goes on to the caller.
    """
    if len(reading) != SENSOR.size:
        return b""
    _, _, _, x, y, vx, vy = SENSOR.form.unpack(reading)
    told = planner.advise(t_ms / 1000, (x, y), (vx, vy))
    if told is None:
        return b""
    try:
        wished = [float(number) for number in told]
    except (TypeError, ValueError):
        wished = []
    if len(wished) != 2:
        hint = "two numbers, m/s along x and y, or None"
        raise OwnMistake(f"advise returned {kind_of(told)}", hint, planner, "advise")
    return WISH.form.pack(KIND_WISH, *_as_f32(*wished))


def forward_state(planner: Planner, t_ms: int, packet: bytes) -> None:
    """Pass a broadcast to a planner, if it is a robot's state."""
    if len(packet) == STATE.size and packet[0] == KIND_STATE:
        _, rob_id, _, x, y, vx, vy = STATE.form.unpack(packet)
        planner.hear(t_ms / 1000, rob_id, (x, y), (vx, vy))


def _as_f32(x: float, y: float) -> Pair:
    """Return the vector, or one in its direction if an f32 does not hold it: `struct` refuses that."""
    largest = max(abs(x), abs(y))
    if not LARGEST_F32 < largest < math.inf:
        return x, y
    return x / largest * LARGEST_F32, y / largest * LARGEST_F32


class Adviser:
    """A planner for each of the robots 1 to `robots`: it receives what they sense and hear, and answers with advice.

    What a robot sends is what its computer says, and that may be taken over. So a reading that makes no sense is not
    shown to the planner. And where advice is signed, a reading that is dated ahead is not answered, or what is signed
    now could be used later: the first reading of each robot says by how much its clock and ours differ, for good. A
    robot that dates all its readings ahead by the same time is indistinguishable from one with another clock.

    Args:
        make: for a robot's id and `goal_m`.
        signer: signs what planners wish; None for advice that anybody may give.
        clock_ms: this side's, which goes on.
        at: where robots are whose place is known, by their ids; the others are where they speak first.
    """

    def __init__(
        self,
        make: MakePlanner,
        goal_m: Pair,
        robots: int,
        signer: AdviceSigner | None,
        clock_ms: Callable[[], float],
        at: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        self._make, self._goal_m, self._robots = make, goal_m, robots
        self._signer, self._clock_ms, self._at = signer, clock_ms, at
        self._planners: dict[int, Planner] = {}
        self._speaks: dict[Hashable, int] = {}  # who was the last to send a robot's readings, and of which
        self._latest_ms: dict[int, int] = {}
        self._first: dict[int, tuple[str, float, int]] = {}  # from where a robot's first reading came, and both clocks

    def answer(self, sender: Hashable, host: str, said: bytes) -> bytes:
        """Return the answer to this packet: advice, or b"" for nothing. What a planner raises goes on.

        Args:
            sender: a key that tells senders apart.
            host: where that is; for signed advice a robot stays where it was first.
        """
        if len(said) == STATE.size and said[0] == KIND_STATE:
            robot = self._speaks.get(sender)
            if robot and _makes_sense(said):
                forward_state(self._planners[robot], self._latest_ms[robot], said)
            return b""
        if len(said) != SENSOR.size or said[0] != KIND_SENSOR or not _makes_sense(said):
            return b""
        _, robot, t_ms, *_ = SENSOR.form.unpack(said)
        if not 1 <= robot <= self._robots or self._at.get(robot, host) != host:
            return b""
        if self._signer and not self._is_its_time(robot, host, t_ms):
            return b""
        if robot not in self._planners:
            self._planners[robot] = self._make(robot, self._goal_m)
        self._speaks = {each: of for each, of in self._speaks.items() if of != robot} | {sender: robot}
        self._latest_ms[robot] = t_ms
        wish = advice_of(self._planners[robot], t_ms, said)
        return self._signer.sign(robot, t_ms, wish) if wish and self._signer else wish

    def _is_its_time(self, robot: int, host: str, t_ms: int) -> bool:
        """Return whether the robot is where it was first heard, and its clock went no faster than ours since then."""
        now_ms = self._clock_ms()
        there, began_ms, first_ms = self._first.setdefault(robot, (host, now_ms, t_ms))
        since_ms = now_ms - began_ms
        return there == host and t_ms - first_ms <= since_ms + since_ms / DRIFT + AHEAD_MS


def _makes_sense(said: bytes) -> bool:
    *_, x, y, vx, vy = SENSOR.form.unpack(said)  # a broadcast's form is the same
    return all(abs(number) <= FARTHEST for number in (x, y, vx, vy))  # NaN is not
