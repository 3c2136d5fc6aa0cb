"""Liars that use all their airtime for audits against a victim's moments, or against the ears of its auditors."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from conftest import ROOT
from phalanx.attacks.channel import audit_packet
from phalanx.attacks.hijack import RefuseToAudit
from phalanx.bti import request, seeking
from phalanx.bti.nodes import Limits, limits_of
from phalanx.config import BtiConfig
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.adversary.attack import own_attack
from phalanx.robot.adversary.liar import is_audit
from phalanx.robot.runtime import first_round_ms
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
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


class Carpet(RefuseToAudit):
    """Fills the moments at which a victim that it is near to, but no auditor of the victim, asks and is answered.

    A few liars in turn broadcast the longest packets. The others, and whose bucket is empty, send them to nobody: the
    radio tries seven times, and the bucket counts one. It answers SEEK, audits nobody and asks for no audits. A SEEK of
    its own has the victim answer before its first round. It hears what the victim has on the air.
    """

    period_ms = 1
    air: ClassVar[Air]
    FIRST_MS = 120  # fills the beginning of the victim's first round, so that its fragments wait for over 50 ms
    ASKS_MS, ANSWERS_MS = 11, 18  # after a fragment, and after the last answer to a SEEK
    AT_ASKS, AT_ANSWERS = 3, 2  # liars that broadcast
    GONE_MS = 60
    _victim = _sought = _until_ms = _asks_until_ms = _out_ms = _round_ms = _on_air_us = 0
    _began = False

    def round_due(self, now_ms: int) -> list[Action]:
        return []

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

    def on_sent(self, now_ms: int, *, arrived: bool) -> list[Action]:
        self._out_ms = 0
        return self._fill(now_ms)

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
        if now_ms - self._out_ms > self.GONE_MS:
            self._out_ms = 0
        return self._early_seek(now_ms) + self._fill(now_ms)

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
        nobody = max(self.plan.ids) + 1
        mine = (self.id - 1 - self._sought * self.AT_ANSWERS) % F_MAX < turns
        for to, dst in ((EVERYBODY, 0), (nobody, nobody)) if mine else ():
            if sent := self.send(now_ms, audit_packet(self.id, dst, request.FRAGMENT, bytes(NOISE_BYTES)), to):
                self._out_ms = now_ms
                return self.count(sent)
        return []


class Deafen(RefuseToAudit):
    """Sends the longest packets to nobody, of which each is transmitted seven times, from the victim's first round on.

    Broadcasts follow with what its bucket holds beyond an even share until the victim's T_val ends.
    """

    period_ms = 1
    limits: ClassVar[Limits]
    GONE_MS = 60
    _out_ms = 0
    _level: tuple[float, int] | None = None  # what its bucket holds, µs, and when

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
        to, dst = (EVERYBODY, 0) if aloud else [max(self.plan.ids) + 1] * 2
        self._level = level_us, now_ms
        if sent := self.send(now_ms, audit_packet(self.id, dst, request.FRAGMENT, bytes(NOISE_BYTES)), to):
            self._level = level_us - (BROADCAST_US if aloud else UNICAST_US), now_ms
            self._out_ms = now_ms
            return self.count(sent)
        return []


def near_auditors(seed: int) -> np.ndarray:
    """Return where f_max liars hear all f_max + 2 auditors of a victim, which hears no liar."""
    chance = np.random.default_rng([seed, 78])
    groups = [
        (F_MAX, 150.0, 4.0, 8.0),
        (1, 0.0, 0.0, 0.0),
        (F_MAX + 2, 105.0, 3.0, 20.0),
        (F_MAX + 4, 185.0, 6.0, 20.0),
    ]
    return np.concatenate(
        [
            np.column_stack([x_m + chance.uniform(-d_m, d_m, n), chance.uniform(-w_m, w_m, n)])
            if d_m
            else np.zeros((n, 2))
            for n, x_m, d_m, w_m in groups
        ]
    )


def places(seed: int) -> np.ndarray:
    """Return where f_max liars hear the victim, but not its f_max + 2 auditors, and all have auditors of their own."""
    chance = np.random.default_rng([seed, 77])
    groups = [
        (F_MAX, -95.0, 20.0),
        (1, 0.0, 0.0),
        (F_MAX + 2, 85.0, 40.0),
        (F_MAX + 4, 170.0, 30.0),
        (2 * F_MAX + 3, -180.0, 30.0),
    ]
    return np.concatenate(
        [
            np.column_stack([x_m + chance.uniform(-8, 8, n), chance.uniform(-w_m, w_m, n)]) if w_m else np.zeros((n, 2))
            for n, x_m, w_m in groups
        ]
    )


def scenario(seed: int, where: np.ndarray, attack: type[RefuseToAudit], n_max: int = 24) -> Scenario:
    """Return a mission of which the liars lie from the start, with the default n_max."""
    own = own_attack(attack)
    liars = tuple(AttackSpec(name=own.name, own=own, robot=k + 1, at_s=0.1) for k in range(F_MAX))
    return replace(
        find_scenario("bti-fig9"),
        robots=len(where),
        grid_step_m=1.0,
        seed=seed,
        defence="hardened",
        duration_s=T_VAL_MS / 1000 + 0.6,
        bti=BtiConfig(f_max=F_MAX, t_audit_ms=T_AUDIT_MS, t_val_ms=T_VAL_MS),
        n_max=n_max,
        attacks=liars,
    )


def lives_on(monkeypatch, made: Scenario, where: np.ndarray) -> bool:
    """Return whether all correct robots live, though all liars talk, and no log shows it."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import layouts

    run = Run(made)
    monkeypatch.setattr(Carpet, "air", run.world.air, raising=False)
    monkeypatch.setattr(Deafen, "limits", limits_of(made.bti, made.radio), raising=False)
    layouts.drive(run, layouts.Layout(lambda _: where), made.duration_s)
    told = run.summary()
    assert all(liar.gained > 50 for liar in run.robots.values()), "they talked"
    assert all(liar["first_deviation_s"] is None for liar in told["compromised"]), "no log shows it"
    return not told["correct_in_safe_mode"] and not told["without_quorum"]


@pytest.mark.parametrize("n_max, seed", LATE)
def test_liars_that_fill_all_moments_of_a_victim_s_audits_do_not_stop_it(monkeypatch, n_max, seed):
    """Before, the victim was stopped in each."""
    where = places(seed)
    assert lives_on(monkeypatch, scenario(seed, where, Carpet, n_max), where)


@pytest.mark.parametrize("seed", DEAF)
def test_liars_that_deafen_all_auditors_of_a_victim_do_not_stop_it(monkeypatch, seed):
    """Before, a retry cost no airtime, and the victim was stopped in each."""
    where = near_auditors(seed)
    assert lives_on(monkeypatch, scenario(seed, where, Deafen), where)
