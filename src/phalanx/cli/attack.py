"""`phalanx attack`: the ways a robot can lie, and what each defence makes of them."""

from __future__ import annotations

import difflib
from dataclasses import asdict, replace
from typing import Any

from phalanx.errors import UsageError
from phalanx.experiments.bti.attack_trial import Airtime, Stop, Trial, try_attack
from phalanx.experiments.missions.trial import try_mission_attack
from phalanx.robot.attacks import ATTACKS
from phalanx.robot.attacks.harm import UNEARNED
from phalanx.robot.attacks.missions import MISSION_ATTACKS
from phalanx.sim.scenarios.own import find_controller, mistakes_in
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import Scenario, parse_attack

from .attack_mission import options_of, show_trial
from .sim import changed, progress, told, warn
from .terminal import end_status_line, print_json, print_rows

DURATION_S = 60.0


def run(name: str, defence: Any, controller: str | None, as_json: bool, **said: Any) -> int:
    """Runs an attack beside the same run without it; 1 if something did not come as declared."""
    first = parse_attack(name)
    if first.name in MISSION_ATTACKS:
        seed = said.pop("seed") or 0
        tried = try_mission_attack(first.name, defence, seed, options_of(name, said | {"controller": controller}))
        show_trial(tried, as_json=as_json)
        return 0 if tried.kept else 1
    if first.name not in ATTACKS:
        near = difflib.get_close_matches(first.name, (*ATTACKS, *MISSION_ATTACKS), 1, 0.5)
        guess = f"did you mean {near[0]}? " if near else ""
        raise UsageError(f"no attack {first.name!r}", f"{guess}phalanx attack list has all")
    scenario = changed(Scenario(name="attack", duration_s=DURATION_S), said, defence=defence)
    others = ATTACKS[first.name].liars(scenario.bti.f_max) - 1
    scenario = replace(scenario, attacks=(first, *(replace(first, robot=None),) * others))
    scenario, own = find_controller(controller, scenario)
    warn(scenario)
    tell = {which: progress(scenario.duration_s, f"{which}: ") for which in ("attacked", "honest")}

    def on_step(which: str, run: Run) -> None:
        tell[which](run)

    try:
        with mistakes_in(controller):
            trial = try_attack(scenario, on_step, own)
    finally:
        end_status_line()
    if as_json:
        stops = [asdict(stop) | {"bound_s": trial.bound_of(stop)} for stop in trial.stops]
        kept = {"stopped_in_time": trial.stopped_in_time, "within_buckets": trial.within_buckets}
        print_json(asdict(trial) | kept | {"stops": stops})
    else:
        _show(trial)
    return 1 if trial.broken else 0


def _show(trial: Trial) -> None:
    attacked, honest = trial.attacked, trial.honest
    rows = {
        "attack": f"{trial.attack}: {ATTACKS[trial.attack].does}",
        "defence": f"{trial.defence}, which should make it: {trial.declared}",
        "distance to the goal": f"{told(attacked['mean_distance_to_goal_m'], '.1f', ' m')} at the end, "
        f"{told(trial.honest_distance_m, '.1f', ' m')} without the attack",
        "harm": f"{told(trial.harm, '.3g')} {trial.harm_unit}".strip()
        + f": {trial.harm_words} (from {trial.harm_bites_from:g} on it counts){_stands_still(trial)}",
        "contacts": f"{attacked['contacts']}, {honest['contacts']} without the attack",
        "correct, in Safe Mode": f"{len(attacked['correct_in_safe_mode'])}, "
        f"{len(attacked['without_quorum'])} for want of a quorum",
    }
    if trial.idle:
        rows["without effect"] = f"{', '.join(trial.idle)}: makes no difference under {trial.defence}"
    rows |= {f"robot {stop.robot}": _ended(trial, stop) for stop in trial.stops}
    rows |= {f"airtime of {each.robot}": _airtime(each) for each in trial.airtime}
    if not trial.airtime:
        rows["bound"] = _bound(trial)
    print_rows(rows)


def _stands_still(trial: Trial) -> str:
    stopped = any(stop.safe_mode_s is not None for stop in trial.stops)
    if ATTACKS[trial.attack].harm is not UNEARNED or not stopped:
        return ""
    return "; it was stopped and stands still: this is how far on an honest robot would be by now"


def _ended(trial: Trial, stop: Stop) -> str:
    began = "never deviated" if stop.first_deviation_s is None else f"deviated at {stop.first_deviation_s:.2f} s"
    if stop.safe_mode_s is None:
        return f"{began}, is not in Safe Mode"
    bound = told(trial.bound_of(stop), ".3f", " s allowed")
    later = "" if stop.after_s is None else f", {stop.after_s:.2f} s later" + (f" ({bound})" if bound != "-" else "")
    return f"{began}, in Safe Mode at {stop.safe_mode_s:.2f} s{later}"


def _airtime(each: Airtime) -> str:
    kept = "kept" if each.used_s <= each.bucket_s else "BROKEN"
    on_air = f"{100 * each.on_air_s / each.seconds:.2f} %" if each.seconds else "nothing"
    return (
        f"{1000 * each.used_s:.1f} ms of AUDIT frames in {each.seconds:.2f} s, each counted once; its bucket lets out "
        f"{1000 * each.bucket_s:.1f} ms: {kept}; with all tries on the air {on_air} of the time"
    )


def _bound(trial: Trial) -> str:
    if trial.bound_s is None:
        return "none is promised"
    longer = f", {trial.missing_s:g} s more where an output was missing" if trial.missing_s else ""
    kept = "kept" if trial.stopped_in_time else "BROKEN"
    return f"{trial.bound_s:.3f} s from deviation to Safe Mode{longer}: {kept}"
