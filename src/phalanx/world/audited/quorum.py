"""Find the correct robots that were stopped without a quorum, to which the promise P2 does not apply.

Source: docs/promises.md (P2); docs/spec/world.md defines the criteria with reasons.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import BOOLx1, I64x1
from phalanx.config import BtiConfig
from phalanx.kernel import kernel
from phalanx.world.radio.channel import AIRTIME_US
from phalanx.world.radio.reach import Reach, in_range

from .world import World

SECOND_US = 1_000_000
# Percentage of a second. Robots that always have packets waiting fill a channel to 93 to 96 % (docs/spec/world.md).
FULL_PERCENT = 90


class Quorum:
    """Record of the robots that have the auditors and airtime that P2 requires, once per second; `correct`: (N,)."""

    def __init__(self, world: World, config: BtiConfig, correct: NDArray[np.bool_]) -> None:
        self._world, self._config, self._correct = world, config, correct
        self._checked_us = 0
        self._airtime_us = self._spent_us()
        self._had: list[NDArray[np.bool_]] = []
        self._counted = np.zeros(len(correct), bool)
        self._without = np.zeros(len(correct), bool)

    def lose(self, i: int) -> None:
        """Exclude a robot from the correct ones because its process has ended."""
        self._correct = self._correct.copy()
        self._correct[i] = False

    def look(self) -> None:
        """Record the robots that had a quorum since the last call."""
        self._without = self.stopped_without()
        self._counted |= self._world.safe.astype(bool)
        self._had.append(self._has())
        del self._had[: -(self._config.t_val_ms // 1000 + 1)]
        self._checked_us = int(self._world.clock[0].now_us)
        self._airtime_us = self._spent_us()

    def stopped_without(self) -> NDArray[np.bool_]:
        """Return the correct robots in Safe Mode that lacked a quorum at some time during the last T_val, (N,).

        Source: docs/promises.md (P2).
        """
        new = self._correct & self._world.safe.astype(bool) & ~self._counted
        if not new.any():
            return self._without
        without: NDArray[np.bool_] = self._without | (new & ~np.all([*self._had, self._has()], axis=0))
        return without

    def _spent_us(self) -> NDArray[np.int64]:
        """Return the airtime used by each robot, (N,), µs."""
        spent: NDArray[np.int64] = self._world.air.counts[: len(self._correct), :, AIRTIME_US].sum(axis=1)
        return spent

    def _has(self) -> NDArray[np.bool_]:
        # At least a second: a short burst at its beginning does not fill the channel.
        passed_us = max(int(self._world.clock[0].now_us) - self._checked_us, SECOND_US)
        # Correct robots' packets only: jamming by a compromised robot is not a lack of quorum.
        sent_us, full = (self._spent_us() - self._airtime_us) * self._correct, np.zeros(len(self._correct), bool)
        _full(self._world.reach, sent_us, passed_us, full)
        # A robot stopped in spite of a quorum still counts as an auditor: one failure must not excuse the next.
        auditors, lost = self._correct & ~self._without, self._correct & (full | self._without)
        has = np.zeros(len(self._correct), bool)
        _enough(self._world.reach, auditors, lost, self._config.quorum, self._config.n_max, has)
        return has & ~full


@kernel
def _full(reach: Reach, sent_us: I64x1, passed_us: int, full: BOOLx1) -> None:
    """Set `full`, (N,), for each robot in whose range packets used more than 90 % of the time that passed."""
    for i in range(len(full)):
        total = sent_us[i]
        for at in range(reach.near[i], in_range(reach, i)):
            if reach.ids[at] < len(full):
                total += sent_us[reach.ids[at]]
        full[i] = 100 * total > FULL_PERCENT * passed_us


@kernel
def _enough(reach: Reach, auditors: BOOLx1, lost: BOOLx1, quorum: int, most: int, has: BOOLx1) -> None:
    """Set `has`, (N,): a `quorum` of auditors and at most `most` robots in range, and at most half of them `lost`."""
    for i in range(len(has)):
        begin, end, can, cannot = reach.near[i], in_range(reach, i), 0, 0
        for at in range(begin, end):
            k = int(reach.ids[at])
            if k < len(has):
                can += auditors[k]
                cannot += lost[k]
        has[i] = can >= quorum and end - begin <= most and 2 * cannot <= end - begin
