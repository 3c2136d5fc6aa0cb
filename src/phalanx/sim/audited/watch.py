"""What onlookers see of the audits: who vouches for whom, and how audits end."""

from __future__ import annotations

from phalanx.bti.fleet import Fleet
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


def vouchers(fleet: Fleet, i: int, now_ms: int) -> list[tuple[int, float]]:
    """Whose token row i of a fleet has, and for how many seconds more. Source: RoboRebound §3.5."""
    robot, t_val = fleet.robot[i], int(fleet.settings[0].t_val)
    newest: dict[int, int] = {}
    for which, count in enumerate((robot.tokens_start, robot.tokens_pending)):
        for token in fleet.token[i, which, : int(count)]:
            newest[int(token.tor)] = max(int(token.t), newest.get(int(token.tor), 0))
    return [(tor, (t + t_val - now_ms) / 1000) for tor, t in newest.items() if t + t_val > now_ms]


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
