"""One run of the scorecard: the outcome of an attack, as a row of the same form in every protocol."""

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
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run
from phalanx.world.swarms.protected import DEMO, EDGE_MM, ProtectedSwarm

from .plan import AT_S, HONEST_KEPT, WATCHED_S, WHEELS, Bout

ROBOTS = 12
STEP_S, ORDERS_S = 0.05, 5.0  # step of the simulation; period of new orders for each robot
NEAR_MM = 60.0
# Columns of a run's outcome, with Arrow's types.
OUTCOME = {
    "declared": "string",  # verdict that the attack declares for this defence
    "harm": "double",
    "harm_unit": "string",
    "bites_from": "double",  # least harm that the attack counts as a bite
    "liars": "int64",
    "deviated": "int64",  # compromised robots that deviated from an honest robot's behaviour
    "stopped": "int64",  # of these, those in Safe Mode; for a single robot's mission, 1 if it refuses or holds
    "slowest_stop_s": "double",  # from the first deviation to Safe Mode
    "bound_s": "double",  # promised limit for slowest_stop_s; none without a promise
    "correct_stopped": "int64",
    "missed": "string",  # broken promises; "" if there are none
    "audit_bytes_per_s": "double",  # sent by one robot without attack, each radio attempt counted
    "audit_airtime_pct": "double",  # share of the time that these packets occupy the channel
    "digest": "string",
    "cpu_s": "double",
}


def run_bout(bout: Bout) -> dict[str, Any]:
    """Run one bout and return its row. Output printed by a user's own file goes to stderr."""
    begun_s = time.thread_time()
    with contextlib.redirect_stdout(sys.stderr), mistakes_in(bout.attack, bout.controller):
        spec = find_attack(bout.attack)
        attack = spec.attack
        if "at=" not in bout.attack:
            spec = replace(spec, at_s=AT_S)
        if bout.scenario:
            outcome = _in_flock(bout, spec, bout.scenario)
        elif bout.protocol == WHEELS:
            outcome = try_on_wheels(spec, bout.defence, bout.seed, AT_S + WATCHED_S)
        elif attack.scene == "team":
            outcome = _in_team(try_in_team(attack, bout.defence, bout.seed))
        else:
            outcome = _on_errand(try_mission_attack(attack, bout.defence, bout.seed, spec.options))
    outcome["missed"] = "; ".join(label for label, is_so in outcome["missed"].items() if is_so)
    usual = {"declared": attack.verdicts[bout.defence], "harm_unit": attack.harm.unit, "bites_from": attack.bites_from}
    usual |= {"liars": 1, "deviated": 1, "correct_stopped": 0}
    return dict.fromkeys(OUTCOME) | usual | outcome | {"cpu_s": time.thread_time() - begun_s}


@lru_cache(HONEST_KEPT)
def _honest(scenario: Scenario, controller: str | None) -> Run:
    scenario, own = find_controller(controller, scenario)
    return run_scenario(scenario, controller=own)


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
    # An attack on a captured file involves no robot.
    stopped = bool(
        getattr(attacked, "refused", "") or (getattr(attacked, "held", False) and trial.declared == "stopped")
    )
    return {
        "harm": trial.harm,
        "stopped": int(stopped),
        "missed": {f"not {trial.declared}": trial.defence != "none" and not trial.kept},
    }


def drive(defence: Defence, seed: int, seconds: float, spec: AttackSpec | None = None) -> ProtectedSwarm:
    """Return the swarm after that many seconds; if there is a `spec`, a robot chosen by the seed is compromised."""
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
    """Return the row of an attack on the demo's robots, compared with the same drive without attack.

    The robots do not avoid each other, so that harm is the number of further contacts.
    """
    if spec.at_s >= seconds:
        raise UsageError(f"{spec.name} begins at {spec.at_s:g} s, when the run is over", f"use at= below {seconds:g}")
    swarm, honest = drive(defence, seed, seconds, spec), _honest_drive(defence, seed, seconds)
    ((i, liar),) = swarm.liars.items()
    assert isinstance(liar, Liar), "a compromised robot is a Liar"
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
