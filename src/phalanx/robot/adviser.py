"""Advise robots from elsewhere: receive what they sense and hear, and answer with advice.

What a robot sends is what its computer says, and that may be taken over. So a reading that makes no sense is not shown
to the planner. And where advice is signed, a reading that is dated ahead is not answered, or what is signed now could
be used later: the first reading of each robot says by how much its clock and ours differ, for good. A robot that dates
all its readings ahead by the same time is indistinguishable from one with another clock.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from types import MappingProxyType

from phalanx.wire.table import KIND_SENSOR, KIND_STATE, SENSOR, STATE

from .planner import MakePlanner, Pair, Planner, advice_of, overheard
from .signer import AdviceSigner

FARTHEST = 1e6  # what a guard takes for a reading
# Of two clocks: what delays and a drift of 500 ppm make of a reading's date.
AHEAD_MS, DRIFT = 1000, 2000
MOST_BYTES = max(SENSOR.size, STATE.size)


class Adviser:
    """A planner for each of the robots 1 to `robots`.

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

    def answer(self, who: Hashable, host: str, said: bytes) -> bytes:
        """Return the answer to this packet: advice, or b"" for nothing. What a planner raises goes on.

        Args:
            who: told from all others that send.
            host: where that is; for signed advice a robot stays where it was first.
        """
        if len(said) == STATE.size and said[0] == KIND_STATE:
            robot = self._speaks.get(who)
            if robot and _makes_sense(said):
                overheard(self._planners[robot], self._latest_ms[robot], said)
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
        self._speaks = {each: of for each, of in self._speaks.items() if of != robot} | {who: robot}
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
