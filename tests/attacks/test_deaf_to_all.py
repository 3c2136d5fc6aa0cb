"""Liars that use up a robot's airtime: they ask often, answer at once, and acknowledge nothing."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from placed_liars import layouts, placed_scenario

from phalanx.config import BtiConfig
from phalanx.robot.actions import Action
from phalanx.robot.adversary.liar import Liar
from phalanx.wire.fields import row
from phalanx.wire.table import AUDIT_HERE, AUDIT_SEEK
from phalanx.world.audited import loop
from phalanx.world.audited.world import World
from phalanx.world.radio.channel import BROADCAST
from phalanx.world.scenarios.run import Run

ROBOTS, N_MAX, SPREAD_M = 5, 4, 40.0
# T_audit, T_val, ms, and seeds: in each a correct robot was stopped.
STOPPED = [(4000, 10_000, 203), (4000, 10_000, 209), (2000, 5000, 205), (2000, 5000, 216)]


class DeafToAll(Liar):
    """Sends SEEK as often as robots may, answers SEEK at once, fills logs, and keeps its radio off for all fragments.

    Long packets are a deviation: it is stopped for them, but only T_val later.
    """

    period_ms = 1
    world: ClassVar[World]
    LONG_BYTES: ClassVar[tuple[int, ...]] = (420, 300, 200, 100)
    _sought_ms = -1_000_000

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._answered: dict[int, tuple[int, int]] = {}

    def on_wake(self, now_ms: int) -> list[Action]:
        nic = self.world.air.nic[self.i]
        if not nic.waiting:
            nic.off = 1
        if now_ms - self._sought_ms > int(self.f.settings[0].t_audit) // 8:
            self._sought_ms = now_ms
            self._transmit(now_ms, AUDIT_SEEK.encode(src=self.id, dst=0, nonce=now_ms, since=0, share=255))
        for victim, robot in enumerate(self.f.robot):
            asked = int(robot.round_no), int(robot.seeks)
            if victim != self.i and asked[1] >= 2 and self._answered.get(victim) != asked:
                self._answered[victim] = asked
                here = AUDIT_HERE.encode(src=self.id, dst=0, nonce=int(robot.nonce))
                self._transmit(now_ms, here)
        return []

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        actions = super().sensed(now_ms, reading)
        for size in self.LONG_BYTES:
            if self._transmit(now_ms, b"\x09" + bytes(size)):
                break
        return actions

    def _transmit(self, now_ms: int, packet: bytes) -> bool:
        """Broadcast what the a-node lets out, although the radio receives nothing."""
        if not self.send(now_ms, packet, 0):
            return False
        nic = self.world.air.nic[self.i]
        was_off, nic.off = int(nic.off), 0
        loop.transmit(self.world, self.i, row(packet), len(packet), BROADCAST)
        nic.off = was_off
        return True


@pytest.mark.parametrize("t_audit_ms, t_val_ms, seed", STOPPED)
def test_a_robot_asks_others_than_those_that_acknowledge_nothing(monkeypatch, t_audit_ms, t_val_ms, seed):
    where = np.random.default_rng([seed, 77]).uniform(-SPREAD_M, SPREAD_M, (ROBOTS, 2))
    begins = np.random.default_rng([seed, 78]).uniform(0, t_audit_ms / 1000)
    at_s = round(3 * t_audit_ms / 1000 + begins, 3)
    lasts_s = round(at_s + 1.6 * t_val_ms / 1000, 2)
    bti = BtiConfig(f_max=1, t_audit_ms=t_audit_ms, t_val_ms=t_val_ms)
    run = Run(placed_scenario(DeafToAll, 1, at_s, robots=ROBOTS, seed=seed, duration_s=lasts_s, bti=bti, n_max=N_MAX))
    monkeypatch.setattr(DeafToAll, "world", run.world, raising=False)
    layouts.drive(run, layouts.Layout(lambda _: where), lasts_s)
    summary = run.summary()
    assert summary["compromised"][0]["first_deviation_s"] is not None
    assert summary["correct_in_safe_mode"] + summary["without_quorum"] == []
