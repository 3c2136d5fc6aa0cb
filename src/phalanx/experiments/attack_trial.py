"""One attack against one defence, beside the same run without it: what it did, when it was stopped, and the bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phalanx.errors import UsageError
from phalanx.robot.attacks import ATTACKS, Attack
from phalanx.sim.play import play
from phalanx.sim.run import Run
from phalanx.sim.scenario import Scenario

MS = 1000.0


@dataclass(frozen=True, slots=True)
class Stop:
    """What became of one compromised robot.

    Args:
        robot: its id.
        first_deviation_s: when it first did what an honest robot would not; None if it never did.
        safe_mode_s: when it was put in Safe Mode; None if it never was.
    """

    robot: int
    first_deviation_s: float | None
    safe_mode_s: float | None

    @property
    def after_s(self) -> float | None:
        """From deviation to Safe Mode; None if one of them is missing."""
        if self.first_deviation_s is None or self.safe_mode_s is None:
            return None
        return self.safe_mode_s - self.first_deviation_s


@dataclass(frozen=True, slots=True)
class Trial:
    """What an attack came to.

    Args:
        attack, defence: as named.
        declared: what the attack says that this defence makes of it.
        bound_s: deviation to Safe Mode, at most, with at most f_max liars; None where nothing is promised.
        stops: of each compromised robot.
        harm: what the attack measures of its damage, in `harm_unit`; of several liars, the worst one's.
        harm_words: what is measured.
        harm_bites_from: from so much on, the attack calls it a bite.
        attacked, honest: summaries of both runs; `honest` has the same robots and the same seed, and nobody lies.
        honest_distance_m: mean distance to the goal, without the attack, of the robots that are correct with it.
    """

    attack: str
    defence: str
    declared: str
    bound_s: float | None
    stops: tuple[Stop, ...]
    harm: float
    harm_unit: str
    harm_words: str
    harm_bites_from: float
    attacked: dict[str, Any]
    honest: dict[str, Any]
    honest_distance_m: float | None

    @property
    def stopped_in_time(self) -> bool | None:
        """Whether each robot that deviated was stopped within the bound; None where nothing is promised."""
        if self.bound_s is None or self.declared != "stopped":
            return None
        end_s = float(self.attacked["duration_s"])
        return all(
            stop.first_deviation_s is None
            or (stop.after_s is not None and stop.after_s <= self.bound_s)
            # Not stopped yet, and not late yet: the run ended first.
            or (stop.safe_mode_s is None and end_s < stop.first_deviation_s + self.bound_s)
            for stop in self.stops
        )


def stop_bound_s(scenario: Scenario, *, output_missing: bool) -> float | None:
    """At most from deviation to Safe Mode: T_val + P_check + 1 ms, and δ + skew if an output is missing or late.

    Source: docs/spec/rebound.md (P1).
    """
    if scenario.defence == "none":
        return None
    bti = scenario.bti
    return (bti.t_val_ms + bti.p_check_ms + 1 + (bti.delta_ms + bti.skew_ms) * output_missing) / MS


def try_attack(scenario: Scenario, on_step: Callable[[str, Run], None] = lambda _which, _run: None) -> Trial:
    """Both runs of a scenario: as it is, and without its attacks.

    Args:
        scenario: with one kind of attack, in one robot or several.
        on_step: called at each step with which of the runs it is: attacked or honest.
    Raises: UsageError: nobody attacks, or in different ways.
    Source: none.
    """
    names = {attack.name for attack in scenario.attacks}
    if len(names) != 1:
        raise UsageError(f"{len(names)} kinds of attack in a trial", "one: its damage is compared with none")
    (name,) = names
    attacked = play(scenario, on_step=lambda run: on_step("attacked", run))
    honest = play(replace(scenario, attacks=()), on_step=lambda run: on_step("honest", run))
    kind = ATTACKS[name]
    liars = [robot for robot in attacked.robots.values() if isinstance(robot, Attack)]
    correct = ~np.isin(attacked.ids, list(attacked.compromised))
    to_goal_m = np.sqrt(((honest.positions_m - np.array(scenario.goal_m)) ** 2).sum(axis=1))[correct]
    summary = attacked.summary()
    return Trial(
        attack=name,
        defence=scenario.defence,
        declared=kind.verdicts[scenario.defence],
        bound_s=stop_bound_s(scenario, output_missing=True),
        stops=tuple(
            Stop(told["robot"], told["first_deviation_s"], told["safe_mode_s"]) for told in summary["compromised"]
        ),
        harm=max(kind.harm.of(liar, attacked, honest) for liar in liars),
        harm_unit=kind.harm.unit,
        harm_words=kind.harm.words,
        harm_bites_from=kind.bites_from,
        attacked=summary,
        honest=honest.summary(),
        honest_distance_m=float(to_goal_m.mean()) if correct.any() else None,
    )
