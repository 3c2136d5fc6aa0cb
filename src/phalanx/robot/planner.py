"""Planners, which advise guarded robots; the guard decides (docs/guides/guard.md).

A planner may be any program: it may use random numbers, a clock, a network or a learned policy. It is not replayed:
the log has only its advice. It may run on another machine (`Adviser`).
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
FARTHEST = 1e6  # largest number that a guard accepts in a reading
# How far a reading's time may be ahead of ours: AHEAD_MS for delays, and a part in DRIFT (500 ppm) for the clocks.
AHEAD_MS, DRIFT = 1000, 2000
MOST_BYTES = max(SENSOR.size, STATE.size)


class Planner(ABC):
    """Planner of one robot.

    Args:
        rob_id: 1..65535.
        goal_m: the goal of the scenario, x and y.
    """

    def __init__(self, rob_id: int, goal_m: Pair) -> None:
        self.rob_id, self.goal_m = rob_id, goal_m

    @abstractmethod
    def advise(self, t_s: float, position_m: Pair, velocity_mps: Pair) -> Sequence[float] | None:
        """Return the advised velocity, m/s, x and y, or None; called at each reading, taken at `t_s`.

        Any two numbers are accepted: the guard shortens velocities that are too fast, and ignores NaN and infinity.
        """

    def hear(self, t_s: float, rob_id: int, position_m: Pair, velocity_mps: Pair) -> None:  # noqa: B027 - optional
        """Handle a state that another robot has broadcast; it may be false."""


class ToGoal(Planner):
    """Planner that advises the straight way to the goal, slower near it, and ignores obstacles."""

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float]:
        """Return the vector to the goal as a velocity; the guard limits it."""
        return [to - at for to, at in zip(self.goal_m, position_m, strict=True)]


def advice_of(planner: Planner, t_ms: int, reading: bytes) -> bytes:
    """Return a planner's advice on a reading, as it is logged; b"" for none.

    Raises: OwnMistake: the planner returned something else. Exceptions of the planner are passed on.
    """
    if len(reading) != SENSOR.size:
        return b""
    _, _, _, x, y, vx, vy = SENSOR.form.unpack(reading)
    returned = planner.advise(t_ms / 1000, (x, y), (vx, vy))
    if returned is None:
        return b""
    try:
        wished = [float(number) for number in returned]
    except (TypeError, ValueError):
        wished = []
    if len(wished) != 2:
        hint = "return two numbers, m/s along x and y, or None"
        raise OwnMistake(f"advise returned {kind_of(returned)}", hint, planner, "advise")
    return WISH.form.pack(KIND_WISH, *_as_f32(*wished))


def forward_state(planner: Planner, t_ms: int, packet: bytes) -> None:
    """Pass a packet to a planner if it is a robot's state."""
    if len(packet) == STATE.size and packet[0] == KIND_STATE:
        _, rob_id, _, x, y, vx, vy = STATE.form.unpack(packet)
        planner.hear(t_ms / 1000, rob_id, (x, y), (vx, vy))


def _as_f32(x: float, y: float) -> Pair:
    """Return the vector, scaled down if an f32 cannot hold it: `struct` would raise an error."""
    largest = max(abs(x), abs(y))
    if not LARGEST_F32 < largest < math.inf:
        return x, y
    return x / largest * LARGEST_F32, y / largest * LARGEST_F32


class Adviser:
    """Server of advice for robots 1 to `robots`: it runs a planner for each on the messages that it receives.

    Robots may be compromised, so invalid readings are not passed to a planner. If advice is signed, readings with a
    time in the future get no answer, because the signed advice could be used later. The first reading of each robot
    fixes the offset between its clock and ours. A robot that shifts the times of all its readings equally cannot be
    distinguished from one with another clock.

    Args:
        make: makes a planner from a robot's id and `goal_m`.
        signer: signs the advice; None for unsigned advice.
        clock_ms: this side's monotonic clock.
        at: hosts of robots by id, where known; the host of any other robot is that of its first reading.
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
        self._robot_of: dict[Hashable, int] = {}  # by sender, the robot whose readings it sent last
        self._latest_ms: dict[int, int] = {}
        self._first: dict[int, tuple[str, float, int]] = {}  # of a robot's first reading: host, our clock, its clock

    def answer(self, sender: Hashable, host: str, said: bytes) -> bytes:
        """Return the answer to a packet: advice, or b"" for none. Exceptions of a planner are passed on.

        Args:
            sender: key that identifies the sender.
            host: the sender's host; with signed advice, a robot must keep its first host.
            said: the packet.
        """
        if len(said) == STATE.size and said[0] == KIND_STATE:
            robot = self._robot_of.get(sender)
            if robot and _is_valid(said):
                forward_state(self._planners[robot], self._latest_ms[robot], said)
            return b""
        if len(said) != SENSOR.size or said[0] != KIND_SENSOR or not _is_valid(said):
            return b""
        _, robot, t_ms, *_ = SENSOR.form.unpack(said)
        if not 1 <= robot <= self._robots or self._at.get(robot, host) != host:
            return b""
        if self._signer and not self._is_its_time(robot, host, t_ms):
            return b""
        if robot not in self._planners:
            self._planners[robot] = self._make(robot, self._goal_m)
        self._robot_of = {each: of for each, of in self._robot_of.items() if of != robot} | {sender: robot}
        self._latest_ms[robot] = t_ms
        wish = advice_of(self._planners[robot], t_ms, said)
        return self._signer.sign(robot, t_ms, wish) if wish and self._signer else wish

    def _is_its_time(self, robot: int, host: str, t_ms: int) -> bool:
        """Return whether the robot has its first host, and its clock has gone no faster than ours since then."""
        now_ms = self._clock_ms()
        there, began_ms, first_ms = self._first.setdefault(robot, (host, now_ms, t_ms))
        since_ms = now_ms - began_ms
        return there == host and t_ms - first_ms <= since_ms + since_ms / DRIFT + AHEAD_MS


def _is_valid(packet: bytes) -> bool:
    *_, x, y, vx, vy = SENSOR.form.unpack(packet)  # a STATE has the same form
    return all(abs(number) <= FARTHEST for number in (x, y, vx, vy))  # False for NaN
