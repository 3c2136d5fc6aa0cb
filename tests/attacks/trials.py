"""One attack on a small swarm, beside the same swarm in which nobody lies; and what its verdict means in numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cache

from phalanx.attacks import IN_FLOCKS
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.lab.scorecard.flock_trial import Airtime, airtime_since, sent, stop_bound_s
from phalanx.robot.adversary.harm import STARVED
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

AT_S, END_S = 12.0, 36.0
F_MAX = 3
# Requests that an auditor takes of one liar: one each T_audit / 2, and one at the beginning.
MOST_TAKEN = 1 + round((END_S - AT_S) / (BtiConfig().t_audit_ms / 2000))


def scenario(defence: str, *attacks: AttackSpec, robots: int = 12, end_s: float = END_S, seed: int = 1) -> Scenario:
    """Near enough to each other that neighbours push, and near the goal, so that lies about the way there matter."""
    return Scenario(
        name="trial",
        robots=robots,
        grid_step_m=16.0,
        goal_m=(150.0, 150.0),
        duration_s=end_s,
        defence=defence,
        seed=seed,
        bti=BtiConfig(f_max=F_MAX),
        attacks=attacks,
    )


def run(made: Scenario) -> Run:
    """To its end."""
    running = Run(made)
    running.advance(made.duration_s)
    return running


@cache
def honest(defence: str, end_s: float = END_S, seed: int = 1) -> Run:
    """The same swarm, and nobody lies."""
    return run(scenario(defence, end_s=end_s, seed=seed))


@dataclass
class Trial:
    """An attack's run, and its liars."""

    run: Run
    beside: Run

    def __post_init__(self):
        self.summary = self.run.summary()
        self.liars = [robot for _, robot in sorted(self.run.robots.items()) if isinstance(robot, Liar)]
        self.attack = self.liars[0].attack
        self.verdicts = self.run.new_verdicts()
        self.refusals = Counter(why for _, _, auditee, why in self.verdicts if auditee in self.run.compromised)

    @property
    def harm(self) -> float:
        """Of the liar that did the most."""
        return max(self.attack.harm.of(liar, self.run, self.beside) for liar in self.liars)

    @property
    def bounds_s(self) -> list[float | None]:
        """P1's, of each liar."""
        return [stop_bound_s(self.run.scenario, output_missing=liar.output_missing) for liar in self.liars]

    @property
    def airtime(self) -> list[Airtime]:
        """Of each liar, since it lies."""
        before = honest(self.run.scenario.defence, AT_S)
        return [airtime_since(self.run, liar.i, sent(before, liar.i)) for liar in self.liars]

    @property
    def taken_up(self) -> dict[int, int]:
        """Requests without a form that auditors have looked at, by auditor: nobody honest sends one."""
        return Counter(auditor for _, auditor, _, why in self.verdicts if why == Refusal.MALFORMED)

    def stopped_after_s(self) -> list[float | None]:
        """From the first deviation to Safe Mode; None for a liar that was not stopped."""
        return [
            None if told["safe_mode_s"] is None else told["safe_mode_s"] - told["first_deviation_s"]
            for told in self.summary["compromised"]
        ]


def attacked(name: str, defence: str, *, robot: int | None = None, **options: float) -> Trial:
    """The attack with as many liars as it takes, from 12 s on."""
    liars = IN_FLOCKS[name].liars(F_MAX)
    specs = [AttackSpec(name=name, at_s=AT_S, options=options, robot=robot) for _ in range(liars)]
    return Trial(run(scenario(defence, *specs)), honest(defence))


def check(trial: Trial, verdict: str) -> None:
    """The verdict is true of the trial."""
    CHECKS[verdict](trial)
    for told in trial.summary["compromised"]:
        assert told["first_deviation_s"] is None or told["first_deviation_s"] >= AT_S, "it was honest before"


def stopped(trial: Trial) -> None:
    assert all(told["first_deviation_s"] is not None for told in trial.summary["compromised"])
    for after_s, bound_s in zip(trial.stopped_after_s(), trial.bounds_s):
        assert after_s is not None
        assert 0 <= after_s <= bound_s
    assert nobody_else_stopped(trial)


def bites(trial: Trial) -> None:
    assert trial.harm >= trial.attack.bites_from
    # Whoever starves others has done its harm when it is stopped itself.
    assert trial.run.scenario.defence == "none" or trial.attack.harm is STARVED or goes_on(trial)


def goes_on(trial: Trial) -> bool:
    """A liar is alive long after it should not be, and still lies; or it never deviated in what a log shows."""
    return any(
        told["safe_mode_s"] is None
        and (liar.first_deviation_ms is None or liar.last_deviation_ms - liar.first_deviation_ms > 1000 * bound_s)
        for told, liar, bound_s in zip(trial.summary["compromised"], trial.liars, trial.bounds_s)
    )


def harmless(trial: Trial) -> None:
    if trial.run.scenario.defence != "none":  # where there are no audits, an attack on them can do nothing
        assert all(liar.gained > 0 for liar in trial.liars), "it acted"
    assert trial.harm < trial.attack.bites_from
    assert nobody_else_stopped(trial)


def limited(trial: Trial) -> None:
    """For ever, and by its limit: what its bucket has, or what an auditor takes of one robot; and nobody starves."""
    assert all(told["safe_mode_s"] is None for told in trial.summary["compromised"]), "it goes on for ever"
    assert all(each.used_s <= each.bucket_s for each in trial.airtime)
    assert all(taken <= MOST_TAKEN * len(trial.liars) for taken in trial.taken_up.values())
    assert trial.harm < trial.attack.bites_from
    assert nobody_else_stopped(trial)


def not_covered(trial: Trial) -> None:
    assert trial.harm >= trial.attack.bites_from
    assert all(told["first_deviation_s"] is None for told in trial.summary["compromised"])
    assert all(told["safe_mode_s"] is None for told in trial.summary["compromised"])
    assert not {why for why in trial.refusals if why != Refusal.NONE}


def nobody_else_stopped(trial: Trial) -> bool:
    return trial.summary["correct_in_safe_mode"] == [] and trial.summary["without_quorum"] == []


CHECKS = {
    "stopped": stopped,
    "bites": bites,
    "harmless": harmless,
    "limited": limited,
    "not covered": not_covered,
}
