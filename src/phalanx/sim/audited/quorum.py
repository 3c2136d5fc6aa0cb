"""Who could be audited: of which correct robots P2 says nothing when they are stopped.

Source: docs/spec/rebound.md (P2); docs/spec/world.md says what is counted, and why.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.sim.radio.channel import AIRTIME_US

from .world import World

SECOND_US = 1_000_000


class Quorum:
    """Watches every second who has the auditors and the air that P2 wants; `correct`, (N,): who does not lie."""

    def __init__(self, world: World, config: BtiConfig, correct: NDArray[np.bool_]) -> None:
        self._world, self._config, self._correct = world, config, correct
        self._looked_us = 0
        self._airtime_us = self._spent_us()
        self._had: list[NDArray[np.bool_]] = []
        self._counted = np.zeros(len(correct), bool)
        self._without = np.zeros(len(correct), bool)

    def look(self) -> None:
        """Remember how things were since the last look."""
        self._without = self.stopped_without()
        self._counted |= self._world.safe.astype(bool)
        self._had.append(self._has())
        del self._had[: -(self._config.t_val_ms // 1000 + 1)]
        self._looked_us, self._airtime_us = int(self._world.clock[0].now_us), self._spent_us()

    def stopped_without(self) -> NDArray[np.bool_]:
        """(N,), correct robots that are in Safe Mode and lacked a quorum at some moment of the T_val before.

        Source: docs/spec/rebound.md (P2).
        """
        new = self._correct & self._world.safe.astype(bool) & ~self._counted
        without: NDArray[np.bool_] = self._without | (new & ~np.all([*self._had, self._has()], axis=0))
        return without

    def _has(self) -> NDArray[np.bool_]:
        reach = self._world.reach
        near = np.diff(reach.start)
        # Who was stopped although it had a quorum still counts as an auditor: one wrong must not excuse the next.
        auditors = self._correct & ~self._without
        # Frames of correct robots only: whoever a liar shouts down was not stopped for want of a quorum.
        sent_us = (self._spent_us() - self._airtime_us) * self._correct
        # At the end a second may just have begun, and a burst is no full channel.
        passed_us = max(int(self._world.clock[0].now_us) - self._looked_us, SECOND_US)
        full = sent_us + self._in_range(sent_us) > passed_us
        lost = self._in_range(self._correct & (full | self._without))
        enough = (self._in_range(auditors) >= self._config.tokens_needed) & (near <= self._config.n_max)
        has: NDArray[np.bool_] = enough & ~full & (2 * lost <= near)
        return has

    def _in_range(self, each: NDArray[np.int64] | NDArray[np.bool_]) -> NDArray[np.int64]:
        """(N,), the sum of something over the robots in range of each."""
        start, ids = self._world.reach.start, self._world.reach.ids
        total = np.concatenate(([0], np.cumsum(each[ids[: start[-1]]])))
        summed: NDArray[np.int64] = total[start[1:]] - total[start[:-1]]
        return summed

    def _spent_us(self) -> NDArray[np.int64]:
        spent: NDArray[np.int64] = self._world.air.counts[: len(self._correct), :, AIRTIME_US].sum(axis=1)
        return spent
