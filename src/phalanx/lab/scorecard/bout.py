"""One run of the scorecard: what an attack came to, as a row of the same form wherever it was tried."""

from __future__ import annotations

import contextlib
import sys
import time
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from phalanx.config.defence import Defence
from phalanx.errors import UsageError
from phalanx.lab.scorecard.flock_trial import PROMISED, FlockTrial, Stop, try_attack
from phalanx.lab.scorecard.mission_trial import MissionTrial, try_mission_attack
from phalanx.lab.scorecard.team_trial import TeamTrial, try_in_team
from phalanx.robot import Point
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.own import find_attack, find_controller, mistakes_in
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited.world import clock_ms
from phalanx.world.radio.channel import AIRTIME_US, AUDIT_BROADCAST
from phalanx.world.scenarios.play import play
from phalanx.world.scenarios.run import Run
from phalanx.world.swarms.protected import DEMO, EDGE_MM, ProtectedSwarm

from .plan import AT_S, HONEST_KEPT, WATCHED_S, WHEELS, Bout

ROBOTS = 12
STEP_S, ORDERS_S = 0.05, 5.0  # each robot is sent somewhere else so often
NEAR_MM = 60.0
# What a run comes to; Arrow's types.
OUTCOME = {
    "declared": "string",  # what the attack says that this defence makes of it
    "harm": "double",
    "harm_unit": "string",
    "bites_from": "double",  # from so much harm on, the attack calls it a bite
    "liars": "int64",
    "deviated": "int64",  # compromised robots that did what no honest robot would
    "stopped": "int64",  # of these, those in Safe Mode; of a robot on its own mission, whether it refuses or holds
    "slowest_stop_s": "double",  # from the first deviation to Safe Mode
    "bound_s": "double",  # of that; none where nothing is promised
    "correct_stopped": "int64",
    "missed": "string",  # which promises were not kept; "" if all were
    "audit_bytes_per_s": "double",  # that a robot sends with nobody lying, with each try of the radio
    "audit_airtime_pct": "double",  # share of the time that these are on the air
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
    usual = {"declared": attack.verdicts[bout.defence], "harm_unit": attack.harm.unit, "bites_from": attack.bites_from}
    usual |= {"liars": 1, "deviated": 1, "correct_stopped": 0}
    return dict.fromkeys(OUTCOME) | usual | told | {"cpu_s": time.thread_time() - begun_s}


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
        "audit_bytes_per_s": trial.honest["tried_bytes_per_s_per_robot"]["audit"],
        "audit_airtime_pct": trial.honest["airtime_pct_per_robot"]["audit"],
        "digest": trial.attacked["digest"],
    }


def _missed(trial: FlockTrial, attack: Attack) -> dict[str, bool]:
    promised = trial.defence != "none" and trial.declared in PROMISED
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
        "stopped": int(stopped),
        "missed": {f"not {trial.declared}": trial.defence != "none" and not trial.kept},
    }


def drive(defence: Defence, seed: int, seconds: float, spec: AttackSpec | None = None) -> ProtectedSwarm:
    """The swarm after so many seconds; one that the seed chooses lies as `spec` says, if there is one."""
    swarm = ProtectedSwarm(ROBOTS, seed, lambda: 0.0, defence=defence)
    chance = np.random.default_rng([seed, 0x77686C])
    addresses = [robot.address for robot in swarm.robots()]
    liar = addresses[int(chance.integers(ROBOTS))]
    low, high = np.full(2, EDGE_MM), np.array(swarm.area_mm) - EDGE_MM
    for k in range(round(seconds / STEP_S)):
        if k % round(ORDERS_S / STEP_S) == 0:
            for address in addresses:
                swarm.follow(address, [Point(*chance.uniform(low, high).tolist())], NEAR_MM)
        if spec and k == round(spec.at_s / STEP_S):
            swarm.compromise(liar, spec.name)
        swarm.step(STEP_S)
    return swarm


@lru_cache(HONEST_KEPT)
def _honest_drive(defence: Defence, seed: int, seconds: float) -> ProtectedSwarm:
    return drive(defence, seed, seconds)


def try_on_wheels(spec: AttackSpec, defence: Defence, seed: int, seconds: float) -> dict[str, Any]:
    """Return the row of an attack on the demo's robots, beside the same drive in which nobody lies.

    They do not make way for each other, so that damage is how often robots touch.
    """
    if spec.at_s >= seconds:
        raise UsageError(f"{spec.name} begins at {spec.at_s:g} s, when the run is over", f"before {seconds:g} s")
    swarm, honest = drive(defence, seed, seconds, spec), _honest_drive(defence, seed, seconds)
    ((i, liar),) = swarm.liars.items()
    assert isinstance(liar, Liar), "who was compromised lies"
    world = swarm.world
    boot_ms, safe_us = int(world.boot_us[i]) // 1000, int(world.safe_us[i])
    promised = defence != "none" and spec.attack.verdicts[defence] == "stopped"
    bound_s = DEMO.stop_bound_ms(output_missing=liar.output_missing) / 1000 if promised else None
    began_s = None if liar.first_deviation_ms is None else (liar.first_deviation_ms - boot_ms) / 1000
    stop = Stop(i + 1, began_s, None if safe_us < 0 else safe_us / 1e6, liar.output_missing)
    in_time = stop.is_in_time(bound_s, (clock_ms(world, i) - boot_ms) / 1000)
    wronged = int(world.safe[:ROBOTS].sum()) - int(world.safe[i])
    air, audits = honest.world.air, slice(AUDIT_BROADCAST, AUDIT_BROADCAST + 2)
    airtime_s = float(air.counts[:ROBOTS, audits, AIRTIME_US].sum()) / 1e6
    return {
        "harm": float(max(0, int(world.clock[0].contacts) - int(honest.world.clock[0].contacts))),
        "harm_unit": "contacts",
        "bites_from": 1.0,
        "deviated": int(began_s is not None),
        "stopped": int(stop.after_s is not None),
        "slowest_stop_s": stop.after_s,
        "bound_s": bound_s,
        "correct_stopped": wronged,
        "missed": {"stopped too late": not in_time, "correct robots stopped": promised and wronged > 0},
        "audit_bytes_per_s": float(air.tried[:ROBOTS, audits].sum()) / ROBOTS / seconds,
        "audit_airtime_pct": 100 * airtime_s / ROBOTS / seconds,
    }
