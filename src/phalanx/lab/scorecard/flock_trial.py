"""Run one attack against one defence, and the same scenario without it: harm, time of the stop, and its bound."""

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
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run

# Verdicts that promise that correct robots keep running; other verdicts promise nothing.
PROMISED = ("stopped", "limited", "harmless")
MS = 1000.0
US = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Result of an attack against a defence."""

    attack: str
    defence: str
    declared: str  # verdict that the attack declares for this defence
    harm: float | None  # in `harm_unit`, as the attack measures it; None if all robots are compromised
    harm_unit: str
    harm_words: str
    harm_bites_from: float  # least harm that the attack counts as a bite
    attacked: Any  # outcome with the attack, and without it
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
    first_deviation_s: float | None  # first deviation from an honest robot's behaviour; None if there was none
    safe_mode_s: float | None  # start of Safe Mode; None if it never was stopped
    output_missing: bool = False  # the deviation was a missing or late output

    @property
    def after_s(self) -> float | None:
        """Return the time from deviation to Safe Mode; None if one of them did not happen."""
        if self.first_deviation_s is None or self.safe_mode_s is None:
            return None
        return self.safe_mode_s - self.first_deviation_s

    def is_in_time(self, bound_s: float | None, now_s: float) -> bool:
        """Return whether the stop met the bound; at the end of the run a missing stop may not be overdue yet."""
        if self.first_deviation_s is None or bound_s is None:
            return True
        return (now_s if self.safe_mode_s is None else self.safe_mode_s) - self.first_deviation_s <= bound_s


class Sent(NamedTuple):
    """Airtime that a robot used until `at_s`, by AUDIT packets and by all packets; retries count."""

    at_s: float
    audit_s: float
    on_air_s: float


@dataclass(frozen=True, slots=True)
class Airtime:
    """Airtime of AUDIT packets that a compromised robot's a-node passed on, and its limit."""

    robot: int
    seconds: float  # from the last quarter of a second before the attack to the end, or to Safe Mode
    used_s: float  # retries count
    bucket_s: float  # a full token bucket, plus the inflow since
    on_air_s: float  # all attempts of all packets of the robot


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockTrial(Trial):
    """Result of an attack by robots of a flock; the harm is that of the worst attacker.

    `attacked` and `honest` are the summaries of two runs with the same robots and seed; `honest` has no attack.
    """

    # Largest time from a wrong action to Safe Mode; None without a promise.
    bound_s: float | None
    stops: tuple[Stop, ...]  # one per compromised robot
    # Mean distance to the goal in the honest run, over robots that are correct in the attacked run.
    honest_distance_m: float | None
    missing_s: float = 0.0  # extension of `bound_s` for a robot whose first deviation was a missing output
    airtime: tuple[Airtime, ...] = ()  # one per liar if the attack is declared limited
    idle: tuple[str, ...] = ()  # given options that have no effect under this defence
    # Correct robots that were stopped although they had a quorum; None without a promise.
    wronged: tuple[int, ...] | None = None

    def bound_of(self, stop: Stop) -> float | None:
        """Return this robot's bound in seconds, rounded to milliseconds; None without a promise."""
        return None if self.bound_s is None else round(self.bound_s + self.missing_s * stop.output_missing, 3)

    @property
    def stopped_in_time(self) -> bool | None:
        """Return whether each robot that deviated was stopped within its bound; None without a promise."""
        if self.bound_s is None:
            return None
        return all(stop.is_in_time(self.bound_of(stop), self.attacked["duration_s"]) for stop in self.stops)

    @property
    def within_buckets(self) -> bool | None:
        """Return whether each a-node enforced its token bucket; None if no bucket is declared as the limit."""
        return all(each.used_s <= each.bucket_s for each in self.airtime) if self.airtime else None

    @property
    def broken(self) -> bool:
        """Return whether any promise was broken."""
        return self.stopped_in_time is False or self.within_buckets is False or bool(self.wronged)


def is_promised(scenario: Scenario) -> bool:
    """Return whether the promises hold: there is a defence, and at most f_max robots attack."""
    return scenario.defence != "none" and len(scenario.attacks) <= scenario.bti.f_max


def stop_bound_s(scenario: Scenario, *, output_missing: bool) -> float | None:
    """Return the bound for the time from deviation to Safe Mode in seconds; None without a promise."""
    if not is_promised(scenario):
        return None
    return scenario.bti.stop_bound_ms(output_missing=output_missing) / MS


def sent(run: Run, i: int) -> Sent:
    """Return the airtime that robot `i` has used so far. Source: docs/spec/rebound-nodes.md (limits)."""
    audit_us = sum(int(run.world.air.counts[i, row, AIRTIME_US]) for row in (AUDIT_BROADCAST, AUDIT_UNICAST))
    return Sent(run.now_s, audit_us / US, float(run.airtime_s[i]))


def airtime_since(run: Run, i: int, before: Sent) -> Airtime:
    """Return the airtime of robot `i` since `before`, and its a-node's limit. Source: docs/spec/rebound-nodes.md."""
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
    """Run a scenario with one kind of attack, with and without the attack.

    `on_step` receives "attacked" or "honest", and the run. `controller` makes a robot's own controller from its id;
    None is the scenario's bundled one. `honest` is the run without attack, if it exists already.

    Raises: UsageError: there is no attack, or there are different ones.
    """
    names = {spec.attack.name for spec in scenario.attacks}
    if len(names) != 1:
        raise UsageError(f"{len(names)} kinds of attack in a trial", "use exactly one kind")
    attack = scenario.attacks[0].attack
    declared = attack.verdicts[scenario.defence]
    at_s = min(spec.at_s for spec in scenario.attacks)
    before: dict[int, Sent] = {}

    def on_attacked(run: Run) -> None:
        if run.now_s <= at_s:
            before.update((i, sent(run, i)) for i, robot in run.robots.items() if isinstance(robot, Liar))
        on_step("attacked", run)

    attacked = run_scenario(scenario, on_step=on_attacked, controller=controller)
    if honest is None:
        honest = run_scenario(
            replace(scenario, attacks=()), on_step=lambda run: on_step("honest", run), controller=controller
        )
    liars = [robot for _, robot in sorted(attacked.robots.items()) if isinstance(robot, Liar)]
    correct = ~np.isin(attacked.ids, list(attacked.compromised))
    to_goal_m = np.sqrt(((honest.positions_m - np.array(scenario.goal_m)) ** 2).sum(axis=1))[correct]
    summary = attacked.summary()
    promised_s = stop_bound_s(scenario, output_missing=False) if declared == "stopped" else None
    return FlockTrial(
        **trial_fields(attack, scenario.defence) | _harm(attack, liars, attacked, honest),
        bound_s=promised_s,
        stops=tuple(
            Stop(robot["robot"], robot["first_deviation_s"], robot["safe_mode_s"], liar.output_missing)
            for robot, liar in zip(summary["compromised"], liars, strict=True)
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
    """Return the harm to other robots; if they have a task, attacks that lead astray are measured by its score."""
    if len(liars) == len(attacked.ids):
        return {"harm": None}
    if attacked.stage and honest.stage and attack.harm is ASTRAY:
        stage = attacked.stage
        found = {"harm_unit": stage.counts, "harm_words": stage.lost, "harm_bites_from": stage.bites_from}
        return found | {"harm": stage.lost_beside(honest.stage, attacked.compromised)}
    return {"harm": max(attack.harm.of(liar, attacked, honest) for liar in liars)}
