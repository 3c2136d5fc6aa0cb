"""Liars that answer SEEK at once, and acknowledge none of the fragments that the victim then sends them."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from placed_liars import placed_scenario, stopped_robots

from phalanx.bti import request, rounds, seeking
from phalanx.config import BtiConfig
from phalanx.robot.actions import Action
from phalanx.robot.adversary.liar import Liar, is_audit
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.fields import get_u16, get_u32, row
from phalanx.wire.table import AUDIT_HERE
from phalanx.world.audited.world import World
from phalanx.world.scenarios.run import Run

T_AUDIT_MS, AT_S, LASTS_S = 4000, 15.0, 30.0
# f_max and seeds: in each the victim was stopped.
STOPPED = [(1, 3), (1, 6), (2, 6)]


class Deaf(Liar):
    """Answers the victim's SEEK with HERE, and acknowledges none of its fragments; an honest auditor of all others.

    The simulator has no radio that ignores one sender. So it is off while that sender's fragment for it waits, at the
    beginning of the victim's rounds, which is public, and after HERE.
    """

    period_ms = 1
    world: ClassVar[World]
    victim: ClassVar[int]
    ROUND_MS, SILENT_MS, AGAIN_MS, NEW_MS = 45, 110, 300, 3800
    _nonce = _sought_ms = _off_ms = _again_ms = 0

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        if is_audit(packet, seeking.SEEK) and get_u16(row(packet), request.AT_SRC) == self.victim:
            self._nonce, self._sought_ms = get_u32(row(packet), seeking.SEEK_NONCE), now_ms
            return self._here(now_ms)
        return super().heard(now_ms, packet)

    def on_wake(self, now_ms: int) -> list[Action]:
        r, s, victim = self.f.robot[self.i], self.f.settings[0], self.f.robot[self.victim - 1]
        round_ms = int(r.t_key) + first_round_ms(int(s.mission_seed), self.victim, T_AUDIT_MS)
        is_asked = victim.request_len > 0 and victim.request_to == self.id
        begins = (now_ms + 3 - round_ms) % T_AUDIT_MS < self.ROUND_MS
        nic = self.world.air.nic[self.i]
        nic.off = is_asked or ((begins or now_ms < self._off_ms) and (nic.off or not nic.waiting))
        if nic.off or not 0 < self._again_ms <= now_ms:
            return []
        self._again_ms = 0
        return self._here(now_ms) if now_ms - self._sought_ms < self.NEW_MS else []

    def _here(self, now_ms: int) -> list[Action]:
        self._off_ms, self._again_ms = now_ms + self.SILENT_MS, now_ms + self.AGAIN_MS
        here = AUDIT_HERE.encode(src=self.id, dst=self.victim, nonce=self._nonce)
        return self.count(self.send(now_ms, here, self.victim))


def victim_of(f_max: int, robots: int) -> int:
    """Return the correct robot that asks the liars, robots 1 to f_max, first, as everybody can compute."""

    def places_of_liars(victim: int) -> list[int]:
        order = sorted(set(range(1, robots + 1)) - {victim}, key=lambda other: rounds.mix_hash(victim, other))
        return sorted(order.index(liar) for liar in range(1, f_max + 1))

    return min(range(f_max + 1, robots + 1), key=places_of_liars)


@pytest.mark.parametrize("f_max, seed", STOPPED)
def test_liars_that_acknowledge_nothing_use_up_no_airtime_that_a_robot_needs_for_others(monkeypatch, f_max, seed):
    robots = 2 * f_max + 3
    where = np.random.default_rng([seed, 7]).uniform(-40, 40, (robots, 2))
    bti = BtiConfig(f_max=f_max, t_audit_ms=T_AUDIT_MS, t_val_ms=10_000)
    run = Run(placed_scenario(Deaf, f_max, AT_S, robots=robots, seed=seed, duration_s=LASTS_S, bti=bti, n_max=None))
    monkeypatch.setattr(Deaf, "world", run.world, raising=False)
    monkeypatch.setattr(Deaf, "victim", victim_of(f_max, robots), raising=False)
    assert stopped_robots(run, lambda _: where, talked=0) == []
