"""Liars that use all their airtime for audits against a victim's moments, or against the ears of its auditors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from placed_liars import placed_scenario, stopped_robots

from phalanx.attacks.channel import audit_packet
from phalanx.attacks.hijack import RefuseToAudit
from phalanx.bti import request, seeking
from phalanx.bti.nodes import Limits, limits_of
from phalanx.config import BtiConfig
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.adversary.liar import is_audit
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.fields import get_u16, row
from phalanx.wire.table import AUDIT_SEEK
from phalanx.world.radio.channel import AIRTIME_US, AUDIT_UNICAST, Air
from phalanx.world.scenarios.run import Run

F_MAX, T_AUDIT_MS, T_VAL_MS = 5, 4000, 10_000
HERE_US = 76  # what a HERE is on the air
NOISE_BYTES = 2048 - request.AUDIT_HEAD_BYTES
# n_max and seeds with which the victim's first round comes late: it has one less before its first T_val is over.
LATE = [(24, 21), (90, 23), (90, 27)]
# Seeds of victims that liars near all auditors stopped.
DEAF = [23, 25]
UNICAST_US, BROADCAST_US = 673, 2850  # what a bucket counts for the longest packets, once


class Noise(RefuseToAudit):
    """Audits nobody, asks for no audits, and sends the longest packets, one at a time."""

    period_ms = 1
    GONE_MS = 60  # what has not left by then is lost
    _out_ms = 0

    def round_due(self, now_ms: int) -> list[Action]:
        return []

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        self._out_ms = 0
        return self._fill(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        if now_ms - self._out_ms > self.GONE_MS:
            self._out_ms = 0
        return self._fill(now_ms)

    def _fill(self, now_ms: int) -> list[Action]:
        """Send the next packet, if it is time for one."""
        raise AssertionError("each attack has its own times")

    def _send_longest(self, now_ms: int, *, aloud: bool) -> list[Action]:
        """Broadcast, or send to nobody: the radio tries seven times."""
        to, dst = (EVERYBODY, 0) if aloud else [max(self.plan.ids) + 1] * 2
        sent = self.send(now_ms, audit_packet(self.id, dst, request.FRAGMENT, bytes(NOISE_BYTES)), to)
        if not sent:
            return []
        self._out_ms = now_ms
        return self.count(sent)


class Carpet(Noise):
    """Fills the moments at which a victim that it is near to, but no auditor of the victim, asks and is answered.

    A few liars in turn broadcast. The others, and whose bucket is empty, send to nobody. It answers SEEK. A SEEK of its
    own has the victim answer before its first round. It hears what the victim has on the air.
    """

    air: ClassVar[Air]
    FIRST_MS = 120  # fills the beginning of the victim's first round, so that its fragments wait for over 50 ms
    ASKS_MS, ANSWERS_MS = 11, 18  # after a fragment, and after the last answer to a SEEK
    AT_ASKS, AT_ANSWERS = 3, 2  # liars that broadcast
    _victim = _sought = _until_ms = _asks_until_ms = _round_ms = _on_air_us = 0
    _began = False

    def on_retry(self, now_ms: int) -> list[Action]:
        """Answer SEEKs that are due, as if it had all its tokens."""
        r = self.f.robot[self.i]
        got, r.got = int(r.got), F_MAX + 1
        answers = super().on_retry(now_ms)
        r.got = got
        return answers

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        answers = super().heard(now_ms, packet)
        if not is_audit(packet, seeking.SEEK) or get_u16(row(packet), request.AT_SRC) != self._victim:
            return answers
        self._sought += 1
        within_ms = T_AUDIT_MS >> seeking.ANSWERS_IN
        self._until_ms = max(self._until_ms, now_ms + within_ms + self.ANSWERS_MS)
        return answers + self._fill(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        if not self._victim:
            self._victim = min(self.victims())
            s, key_ms = self.f.settings[0], int(self.f.robot[self.i].t_key)
            self._round_ms = key_ms + first_round_ms(int(s.mission_seed), self._victim, T_AUDIT_MS)
        on_air_us = int(self.air.counts[self._victim - 1, AUDIT_UNICAST, AIRTIME_US])
        if (on_air_us - self._on_air_us) % HERE_US:
            self._asks_until_ms = now_ms + self.ASKS_MS
        self._on_air_us = on_air_us
        if -4 <= now_ms - self._round_ms < self.FIRST_MS - self.ASKS_MS:
            self._asks_until_ms = self._round_ms + self.FIRST_MS
        self._until_ms = max(self._until_ms, self._asks_until_ms)
        return self._early_seek(now_ms) + super().on_wake(now_ms)

    def _early_seek(self, now_ms: int) -> list[Action]:
        """Send one SEEK shortly before the victim's first round, if this is the first liar."""
        if self._began or self.id != 1 or now_ms < self._round_ms - (T_AUDIT_MS >> 4) - 15:
            return []
        self._began = True
        return self.send(now_ms, AUDIT_SEEK.encode(src=self.id, dst=0, nonce=7, since=0, share=255), EVERYBODY)

    def _fill(self, now_ms: int) -> list[Action]:
        if self._out_ms or now_ms >= self._until_ms:
            return []
        turns = self.AT_ASKS if now_ms < self._asks_until_ms else self.AT_ANSWERS
        if (self.id - 1 - self._sought * self.AT_ANSWERS) % F_MAX >= turns:
            return []
        return self._send_longest(now_ms, aloud=True) or self._send_longest(now_ms, aloud=False)


class Deafen(Noise):
    """Sends to nobody from the victim's first round on, near all its auditors.

    Broadcasts follow with what its bucket holds beyond an even share until the victim's T_val ends.
    """

    limits: ClassVar[Limits]
    _level: tuple[float, int] | None = None  # what its bucket holds, µs, and when

    def _fill(self, now_ms: int) -> list[Action]:
        s, key_ms = self.f.settings[0], int(self.f.robot[self.i].t_key)
        begin_ms = key_ms + first_round_ms(int(s.mission_seed), min(self.victims()), T_AUDIT_MS)
        if self._out_ms or now_ms < begin_ms - 4:
            return []
        limits = self.limits
        level_us, at_ms = self._level or (limits.audit_capacity_us, now_ms)
        level_us = min(limits.audit_capacity_us, level_us + (now_ms - at_ms) * limits.audit_us_per_s / 1000)
        end_ms = key_ms + T_VAL_MS
        share_us = limits.audit_capacity_us * max(end_ms - now_ms, 1) / max(end_ms - begin_ms, 1)
        aloud = level_us > max(share_us + BROADCAST_US / 2, BROADCAST_US)
        sent = self._send_longest(now_ms, aloud=aloud)
        cost_us = (BROADCAST_US if aloud else UNICAST_US) if sent else 0
        self._level = level_us - cost_us, now_ms
        return sent


def placed(seed: list[int], *groups: tuple[int, float, float, float]) -> np.ndarray:
    """Return places of groups, each of n robots around (x, 0), up to so far from it along x and y, m."""
    chance = np.random.default_rng(seed)
    return np.concatenate(
        [
            np.column_stack([x_m + chance.uniform(-d_m, d_m, n), chance.uniform(-w_m, w_m, n)])
            if w_m
            else np.zeros((n, 2))
            for n, x_m, d_m, w_m in groups
        ]
    )


def near_auditors(seed: int) -> np.ndarray:
    """Return where f_max liars hear all f_max + 2 auditors of a victim, which hears no liar."""
    groups = (F_MAX, 150, 4, 8), (1, 0, 0, 0), (F_MAX + 2, 105, 3, 20), (F_MAX + 4, 185, 6, 20)
    return placed([seed, 78], *groups)


def places(seed: int) -> np.ndarray:
    """Return where f_max liars hear the victim, but not its f_max + 2 auditors, and all have auditors of their own."""
    auditors = (F_MAX + 2, 85, 8, 40), (F_MAX + 4, 170, 8, 30), (2 * F_MAX + 3, -180, 8, 30)
    return placed([seed, 77], (F_MAX, -95, 8, 20), (1, 0, 0, 0), *auditors)


def lives_on(monkeypatch, attack: type[Noise], seed: int, where: np.ndarray, n_max: int = 24) -> bool:
    """Return whether all correct robots live, though all liars talk from the start, with the default n_max."""
    bti = BtiConfig(f_max=F_MAX, t_audit_ms=T_AUDIT_MS, t_val_ms=T_VAL_MS)
    lasts_s = T_VAL_MS / 1000 + 0.6
    made = placed_scenario(attack, F_MAX, 0.1, robots=len(where), seed=seed, duration_s=lasts_s, bti=bti, n_max=n_max)
    run = Run(made)
    monkeypatch.setattr(Carpet, "air", run.world.air, raising=False)
    monkeypatch.setattr(Deafen, "limits", limits_of(made.bti, made.radio), raising=False)
    return not stopped_robots(run, lambda _: where)


@pytest.mark.parametrize("n_max, seed", LATE)
def test_liars_that_fill_all_moments_of_a_victim_s_audits_do_not_stop_it(monkeypatch, n_max, seed):
    """Before, the victim was stopped in each."""
    assert lives_on(monkeypatch, Carpet, seed, places(seed), n_max)


@pytest.mark.parametrize("seed", DEAF)
def test_liars_that_deafen_all_auditors_of_a_victim_do_not_stop_it(monkeypatch, seed):
    """Before, a retry cost no airtime, and the victim was stopped in each."""
    assert lives_on(monkeypatch, Deafen, seed, near_auditors(seed))
