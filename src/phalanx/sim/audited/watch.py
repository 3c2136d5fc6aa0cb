"""What onlookers see of the audits: who vouches for whom, and how audits end."""

from __future__ import annotations

from phalanx.bti.fleet import vouchers
from phalanx.bti.refusal import Refusal

from .world import VERDICTS, World, clock_ms

Verdict = tuple[float, int, int, Refusal]


def shields(world: World, i: int) -> list[tuple[int, float]]:
    """Robots that vouch for robot i and for how many seconds more, the longest first; none in Safe Mode.

    Source: RoboRebound §3.5.
    """
    if world.safe[i]:
        return []
    return sorted(vouchers(world.fleet, i, clock_ms(world, i)), key=lambda each: -each[1])


class VerdictReader:
    """Reads audits' ends in order; of more than 4096 at once the oldest are lost."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._told = 0

    def new(self) -> list[Verdict]:
        """Since the last call: time s, auditor, auditee, why it got no token or NONE. Source: RoboRebound §3.7."""
        total = int(self._world.clock[0].verdicts)
        first = max(self._told, total - VERDICTS)
        self._told = total
        rows = (self._world.verdicts[k % VERDICTS] for k in range(first, total))
        return [(int(t) / 1e6, int(tor), int(tee), Refusal(int(why))) for t, tor, tee, why in rows]
