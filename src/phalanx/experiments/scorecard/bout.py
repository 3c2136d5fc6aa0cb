"""One run of the scorecard: what an attack came to, as a row of the same form wherever it was tried."""

from __future__ import annotations

import contextlib
import sys
import time
from dataclasses import replace
from functools import lru_cache
from typing import Any

from phalanx.experiments.bti.attack_trial import FlockTrial, try_attack
from phalanx.experiments.missions.team import TeamTrial, try_in_team
from phalanx.experiments.missions.trial import MissionTrial, try_mission_attack
from phalanx.robot.attacks.attack import Attack
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.own import find_attack, find_controller, mistakes_in
from phalanx.scenarios.scenario import Scenario
from phalanx.sim.scenarios.play import play
from phalanx.sim.scenarios.run import Run

from .plan import AT_S, HONEST_KEPT, WATCHED_S, WHEELS, Bout
from .wheels import try_on_wheels

# What a run comes to; Arrow's types.
OUTCOME = {
    "declared": "string",  # what the attack says that this defence makes of it
    "harm": "double",
    "harm_unit": "string",
    "bites_from": "double",  # from so much harm on, the attack calls it a bite
    "liars": "int64",
    "deviated": "int64",  # liars that did what no honest robot would
    "stopped": "int64",  # of these, those in Safe Mode; of a robot on its own mission, whether it refuses or holds
    "slowest_stop_s": "double",  # from the first deviation to Safe Mode
    "bound_s": "double",  # of that; none where nothing is promised
    "correct_stopped": "int64",
    "missed": "string",  # which promises were not kept; "" if all were
    "audit_bytes_per_s": "double",  # that a robot sends, with nobody lying
    "digest": "string",
    "cpu_s": "double",
}


def run_bout(bout: Bout) -> dict[str, Any]:
    """The row of a run. What a researcher's own file prints goes to stderr."""
    begun_s = time.thread_time()
    with contextlib.redirect_stdout(sys.stderr), mistakes_in(bout.attack, bout.controller):
        spec = find_attack(bout.attack)
        attack = spec.attack
        if "at=" not in bout.attack:
            spec = replace(spec, at_s=AT_S)
        if bout.scenario:
            told = _in_flock(bout, spec, bout.scenario)
        elif bout.protocol == WHEELS:
            told = try_on_wheels(spec, bout.defence, bout.seed, AT_S + WATCHED_S)
        elif attack.scene == "team":
            told = _in_team(try_in_team(attack, bout.defence, bout.seed))
        else:
            told = _on_errand(try_mission_attack(attack, bout.defence, bout.seed, spec.options))
    told["missed"] = "; ".join(words for words, is_so in told["missed"].items() if is_so)
    harm = {"declared": attack.verdicts[bout.defence], "harm_unit": attack.harm.unit, "bites_from": attack.bites_from}
    return dict.fromkeys(OUTCOME) | harm | told | {"cpu_s": time.thread_time() - begun_s}


@lru_cache(HONEST_KEPT)
def _honest(scenario: Scenario, controller: str | None) -> Run:
    scenario, own = find_controller(controller, scenario)
    return play(scenario, controller=own)


def _in_flock(bout: Bout, spec: AttackSpec, scenario: Scenario) -> dict[str, Any]:
    others = spec.attack.liars(scenario.bti.f_max) - 1
    attacked, own = find_controller(
        bout.controller, replace(scenario, attacks=(spec, *(replace(spec, robot=None),) * others))
    )
    honest = _honest(scenario, bout.controller)
    trial = try_attack(attacked, controller=own, honest=honest)
    deviated = [stop for stop in trial.stops if stop.first_deviation_s is not None]
    lasted_s = [stop.after_s for stop in deviated if stop.after_s is not None]
    return {
        "harm": trial.harm,
        "harm_unit": trial.harm_unit,
        "bites_from": trial.harm_bites_from,
        "liars": len(trial.stops),
        "deviated": len(deviated),
        "stopped": len(lasted_s),
        "slowest_stop_s": max(lasted_s, default=None),
        "bound_s": max(filter(None, map(trial.bound_of, trial.stops)), default=None),
        "correct_stopped": len(trial.attacked["correct_in_safe_mode"]) + len(trial.attacked["without_quorum"]),
        "missed": _missed(trial, spec.attack),
        "audit_bytes_per_s": trial.honest["bytes_per_s_per_robot"]["audit"],
        "digest": trial.attacked["digest"],
    }


def _missed(trial: FlockTrial, attack: Attack) -> dict[str, bool]:
    promised = trial.defence != "none" and trial.declared in ("stopped", "limited", "harmless")
    stopped = trial.attacked["correct_in_safe_mode"] or trial.attacked["without_quorum"]
    small = trial.declared in ("limited", "harmless") and trial.defence != "none"
    bites = small and (trial.harm or 0.0) >= (attack.limit or attack.bites_from)
    return {
        "stopped too late": trial.stopped_in_time is False,
        "correct robots stopped": bool(promised and stopped),
        "beyond its bucket": trial.within_buckets is False,
        "bites": bites,
    }


def _in_team(trial: TeamTrial) -> dict[str, Any]:
    both = trial.deviated_s is not None and trial.stopped_s is not None
    late = trial.declared == "stopped" and not trial.in_safe_mode and trial.broken
    return {
        "harm": float(trial.others - trial.completed),
        "harm_unit": "robots",  # whose mission was not completed
        "liars": 1,
        "deviated": int(trial.deviated_s is not None),
        "stopped": int(both),
        "slowest_stop_s": (trial.stopped_s or 0.0) - (trial.deviated_s or 0.0) if both else None,
        "bound_s": trial.bound_s,
        "correct_stopped": len(trial.in_safe_mode),
        "missed": {"stopped too late": late, "correct robots stopped": bool(trial.in_safe_mode)},
    }


def _on_errand(trial: MissionTrial) -> dict[str, Any]:
    attacked = trial.attacked
    # Who guesses a captured file stands before no robot.
    stopped = bool(
        getattr(attacked, "refused", "") or (getattr(attacked, "held", False) and trial.declared == "stopped")
    )
    return {
        "harm": trial.harm,
        "harm_unit": trial.harm_unit,
        "bites_from": trial.harm_bites_from,
        "liars": 1,
        "deviated": 1,
        "stopped": int(stopped),
        "correct_stopped": 0,
        "missed": {f"not {trial.declared}": trial.defence != "none" and not trial.kept},
    }
