"""Find the correct robots that were stopped without a quorum: the promise P2 does not cover them.

Source: docs/promises.md (P2); docs/spec/world.md defines the count and gives the reasons.
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


class Quorum:
    """Records each second which robots have the auditors and the airtime that P2 requires; `correct`: (N,)."""

    def __init__(self, world: World, config: BtiConfig, correct: NDArray[np.bool_]) -> None:
        self._world, self._config, self._correct = world, config, correct
        self._looked_us = 0
        self._airtime_us = self._spent_us()
        self._had: list[NDArray[np.bool_]] = []
        self._counted = np.zeros(len(correct), bool)
        self._without = np.zeros(len(correct), bool)

    def lose(self, i: int) -> None:
        """Count this robot no longer among the correct: its process has ended."""
        self._correct = self._correct.copy()
        self._correct[i] = False

    def look(self) -> None:
        """Record which robots had a quorum since the last look."""
        self._without = self.stopped_without()
        self._counted |= self._world.safe.astype(bool)
        self._had.append(self._has())
        del self._had[: -(self._config.t_val_ms // 1000 + 1)]
        self._looked_us = int(self._world.clock[0].now_us)
        self._airtime_us = self._spent_us()

    def stopped_without(self) -> NDArray[np.bool_]:
        """Return the correct robots in Safe Mode that lacked a quorum at some time of the T_val before, (N,).

        Source: docs/promises.md (P2).
        """
        new = self._correct & self._world.safe.astype(bool) & ~self._counted
        if not new.any():
            return self._without
        without: NDArray[np.bool_] = self._without | (new & ~np.all([*self._had, self._has()], axis=0))
        return without

    def _spent_us(self) -> NDArray[np.int64]:
        """Return for how long each robot has been on the air, (N,)."""
        spent: NDArray[np.int64] = self._world.air.counts[: len(self._correct), :, AIRTIME_US].sum(axis=1)
        return spent

    def _has(self) -> NDArray[np.bool_]:
        # A second may just have begun, and a short burst does not fill the channel.
        passed_us = max(int(self._world.clock[0].now_us) - self._looked_us, SECOND_US)
        # Packets of correct robots only: a robot that a compromised robot jams was not stopped for want of a quorum.
        sent_us, full = (self._spent_us() - self._airtime_us) * self._correct, np.zeros(len(self._correct), bool)
        _full(self._world.reach, sent_us, passed_us, full)
        # A robot stopped in spite of a quorum still counts as an auditor: one failure must not excuse the next.
        auditors, lost = self._correct & ~self._without, self._correct & (full | self._without)
        has = np.zeros(len(self._correct), bool)
        _enough(self._world.reach, auditors, lost, self._config.quorum, self._config.n_max, has)
        return has & ~full


@kernel
def _full(reach: Reach, sent_us: I64x1, passed_us: int, full: BOOLx1) -> None:
    """Set `full`, (N,), for each robot in whose range packets took longer than the time that has passed."""
    for i in range(len(full)):
        total = sent_us[i]
        for at in range(reach.near[i], in_range(reach, i)):
            if reach.ids[at] < len(full):
                total += sent_us[reach.ids[at]]
        full[i] = total > passed_us


@kernel
def _enough(reach: Reach, auditors: BOOLx1, lost: BOOLx1, quorum: int, most: int, has: BOOLx1) -> None:
    """Set `has`, (N,): a `quorum` of auditors in range, at most `most` robots, and at most half of them `lost`."""
    for i in range(len(has)):
        begin, end, can, cannot = reach.near[i], in_range(reach, i), 0, 0
        for at in range(begin, end):
            k = int(reach.ids[at])
            if k < len(has):
                can += auditors[k]
                cannot += lost[k]
        has[i] = can >= quorum and end - begin <= most and 2 * cannot <= end - begin
