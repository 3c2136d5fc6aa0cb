"""One attack against one defence, beside the same run without it: what it did, when it was stopped, and the bound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from phalanx.bti.nodes import limits_of
from phalanx.config.defence import Defence
from phalanx.errors import UsageError
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.harm import ASTRAY
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers.python_controller import Controller
from phalanx.scenarios.scenario import Scenario
from phalanx.world.radio.channel import AIRTIME_US, AUDIT_BROADCAST, AUDIT_UNICAST
from phalanx.world.scenarios.play import play
from phalanx.world.scenarios.run import Run

# Verdicts with which correct robots are promised to go on; elsewhere the harm is what the attack is about.
PROMISED = ("stopped", "limited", "harmless")
MS = 1000.0
US = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Result of an attack."""

    attack: str
    defence: str
    declared: str  # what the attack says that this defence makes of it
    harm: float | None  # what the attack measures of its damage, in `harm_unit`; None if nobody is left to be harmed
    harm_unit: str
    harm_words: str
    harm_bites_from: float  # from so much on, the attack calls it a bite
    attacked: Any  # what became of those that were attacked, and of the same that nobody attacks
    honest: Any


def trial_fields(attack: Attack, defence: Defence) -> dict[str, Any]:
    """Return the fields common to all trials of this attack, without results."""
    return {
        "attack": attack.name,
        "defence": defence,
        "declared": attack.verdicts[defence],
        "harm_unit": attack.harm.unit,
        "harm_words": attack.harm.words,
        "harm_bites_from": attack.bites_from,
    }


@dataclass(frozen=True, slots=True)
class Stop:
    """Outcome of one compromised robot."""

    robot: int
    first_deviation_s: float | None  # when it first did what an honest robot would not; None if it never did
    safe_mode_s: float | None  # when it was put in Safe Mode; None if it never was
    output_missing: bool = False  # whether that deviation was an output that was missing or late

    @property
    def after_s(self) -> float | None:
        """From deviation to Safe Mode; None if one of them is missing."""
        if self.first_deviation_s is None or self.safe_mode_s is None:
            return None
        return self.safe_mode_s - self.first_deviation_s

    def is_in_time(self, bound_s: float | None, now_s: float) -> bool:
        """Return whether the stop came in time; one still missing at the end of the run may not be late yet."""
        if self.first_deviation_s is None or bound_s is None:
            return True
        return (now_s if self.safe_mode_s is None else self.safe_mode_s) - self.first_deviation_s <= bound_s


class Sent(NamedTuple):
    """Airtime a robot has used until `at_s`: of its AUDIT packets, and of all; retries count."""

    at_s: float
    audit_s: float
    on_air_s: float


@dataclass(frozen=True, slots=True)
class Airtime:
    """Airtime of AUDIT packets that a compromised robot's a-node let out, and its limit."""

    robot: int
    seconds: float  # from the last quarter of a second before it lied to the end, or to Safe Mode
    used_s: float  # retries count
    bucket_s: float  # a full bucket, and what has flowed in since
    on_air_s: float  # all tries of all its packets


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockTrial(Trial):
    """Result of an attack by robots of a flock; the harm is that of the worst compromised robot.

    `attacked` and `honest` are both runs' summaries; `honest` has the same robots and the same seed, and nobody lies.
    """

    # Deviation to Safe Mode, at most, of a robot that did something wrong; None where nothing is promised.
    bound_s: float | None
    stops: tuple[Stop, ...]  # of each compromised robot
    # Mean distance to the goal, without the attack, of the robots that are correct with it.
    honest_distance_m: float | None
    missing_s: float = 0.0  # so much longer than `bound_s` for a robot that first deviated by what it did not do
    airtime: tuple[Airtime, ...] = ()  # of each liar, where the attack is declared limited
    idle: tuple[str, ...] = ()  # options that were given and make no difference under this defence
    # Correct robots that were stopped although they had a quorum; None where that is not promised.
    wronged: tuple[int, ...] | None = None

    def bound_of(self, stop: Stop) -> float | None:
        """This robot's own bound, s, to the millisecond; None where nothing is promised."""
        return None if self.bound_s is None else round(self.bound_s + self.missing_s * stop.output_missing, 3)

    @property
    def stopped_in_time(self) -> bool | None:
        """Return whether each robot that deviated was stopped within its bound; None where nothing is promised."""
        if self.bound_s is None:
            return None
        return all(stop.is_in_time(self.bound_of(stop), self.attacked["duration_s"]) for stop in self.stops)

    @property
    def within_buckets(self) -> bool | None:
        """Return whether each a-node kept to its bucket; None where no bucket is declared as the limit."""
        return all(each.used_s <= each.bucket_s for each in self.airtime) if self.airtime else None

    @property
    def broken(self) -> bool:
        """Return whether something that is promised was not kept."""
        return self.stopped_in_time is False or self.within_buckets is False or bool(self.wronged)


def is_promised(scenario: Scenario) -> bool:
    """Return whether anything is promised: not without a defence, nor with more than f_max liars."""
    return scenario.defence != "none" and len(scenario.attacks) <= scenario.bti.f_max


def stop_bound_s(scenario: Scenario, *, output_missing: bool) -> float | None:
    """Return the seconds from deviation to Safe Mode; None where nothing is promised."""
    if not is_promised(scenario):
        return None
    return scenario.bti.stop_bound_ms(output_missing=output_missing) / MS


def sent(run: Run, i: int) -> Sent:
    """Return the airtime robot `i` has used so far. Source: docs/spec/rebound-nodes.md (limits)."""
    audit_us = sum(int(run.world.air.counts[i, row, AIRTIME_US]) for row in (AUDIT_BROADCAST, AUDIT_UNICAST))
    return Sent(run.now_s, audit_us / US, float(run.airtime_s[i]))


def airtime_since(run: Run, i: int, before: Sent) -> Airtime:
    """Return the airtime robot `i` has used since then, and its a-node's limit. Source: docs/spec/rebound-nodes.md."""
    limits, now, safe_us = limits_of(run.scenario.bti, run.scenario.radio), sent(run, i), int(run.world.safe_us[i])
    seconds = (now.at_s if safe_us < 0 else safe_us / US) - before.at_s
    return Airtime(
        robot=i + 1,
        seconds=seconds,
        used_s=now.audit_s - before.audit_s,
        bucket_s=(limits.audit_capacity_us + limits.audit_us_per_s * seconds) / US,
        on_air_s=now.on_air_s - before.on_air_s,
    )


def try_attack(
    scenario: Scenario,
    on_step: Callable[[str, Run], None] = lambda _which, _run: None,
    controller: Callable[[int], Controller] | None = None,
    honest: Run | None = None,
) -> FlockTrial:
    """Both runs of a scenario with one kind of attack: as it is, and without; `on_step` is told which, attacked or
    honest.

    A researcher's own `controller` is made for each robot's id; None is the scenario's bundled one. `honest` is the run
    without an attack, where somebody has it already.

    Raises: UsageError: nobody attacks, or in different ways.
    """
    names = {spec.attack.name for spec in scenario.attacks}
    if len(names) != 1:
        raise UsageError(f"{len(names)} kinds of attack in a trial", "one: its damage is compared with none")
    attack = scenario.attacks[0].attack
    declared = attack.verdicts[scenario.defence]
    at_s = min(spec.at_s for spec in scenario.attacks)
    before: dict[int, Sent] = {}

    def on_attacked(run: Run) -> None:
        if run.now_s <= at_s:
            before.update((i, sent(run, i)) for i, robot in run.robots.items() if isinstance(robot, Liar))
        on_step("attacked", run)

    attacked = play(scenario, on_step=on_attacked, controller=controller)
    if honest is None:
        honest = play(replace(scenario, attacks=()), on_step=lambda run: on_step("honest", run), controller=controller)
    liars = [robot for _, robot in sorted(attacked.robots.items()) if isinstance(robot, Liar)]
    correct = ~np.isin(attacked.ids, list(attacked.compromised))
    to_goal_m = np.sqrt(((honest.positions_m - np.array(scenario.goal_m)) ** 2).sum(axis=1))[correct]
    summary = attacked.summary()
    promised_s = stop_bound_s(scenario, output_missing=False) if declared == "stopped" else None
    return FlockTrial(
        **trial_fields(attack, scenario.defence) | _harm(attack, liars, attacked, honest),
        bound_s=promised_s,
        stops=tuple(
            Stop(told["robot"], told["first_deviation_s"], told["safe_mode_s"], liar.output_missing)
            for told, liar in zip(summary["compromised"], liars, strict=True)
        ),
        attacked=summary,
        honest=honest.summary(),
        honest_distance_m=float(to_goal_m.mean()) if correct.any() else None,
        missing_s=(scenario.bti.delta_ms + scenario.bti.skew_ms) / MS,
        airtime=tuple(airtime_since(attacked, liar.i, before[liar.i]) for liar in liars if declared == "limited"),
        idle=tuple(attack.idle(scenario.attacks[0].options, scenario.defence)),
        wronged=tuple(summary["correct_in_safe_mode"]) if is_promised(scenario) and declared in PROMISED else None,
    )


def _harm(attack: Attack, liars: Sequence[Liar], attacked: Run, honest: Run) -> dict[str, Any]:
    """The damage to others; where they have a task, who is led astray is measured by that."""
    if len(liars) == len(attacked.ids):
        return {"harm": None}
    if attacked.stage and honest.stage and attack.harm is ASTRAY:
        stage = attacked.stage
        told = {"harm_unit": stage.counts, "harm_words": stage.lost, "harm_bites_from": stage.bites_from}
        return told | {"harm": stage.lost_beside(honest.stage, attacked.compromised)}
    return {"harm": max(attack.harm.of(liar, attacked, honest) for liar in liars)}
