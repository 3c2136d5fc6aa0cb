"""`phalanx attack run`: run one attack against one defence, and print the outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from phalanx.errors import UsageError, did_you_mean
from phalanx.lab.scorecard.flock_trial import Airtime, FlockTrial, Stop, Trial, try_attack
from phalanx.lab.scorecard.mission_trial import MissionTrial, try_mission_attack
from phalanx.lab.scorecard.team_trial import TeamTrial, try_in_team
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.harm import ErrandOutcome, GuessOutcome
from phalanx.robot.adversary.registry import attacks as known_attacks
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attack, find_controller, is_file, mistakes_in
from phalanx.scenarios.scenario import PROTOCOLS, Scenario

from .mission.crack import span
from .sim import TYPED, apply_options, format_number, format_robots, print_cautions, progress
from .terminal import Progress, count_of, end_status_line, print_json, print_rows, stdout_to_stderr

DURATION_S = 150.0  # as in the paper


def run(name: str, defence: Any, controller: str | None, as_json: bool, **options: Any) -> int:
    """Run an attack, and the same run without it. Return 1 if the outcome differs from the declared one."""
    with stdout_to_stderr():
        first = find_attack(name)
    if not (first.own or first.name in known_attacks()):
        raise UsageError(
            f"no attack {first.name!r}", f"{did_you_mean(first.name, known_attacks())}phalanx attack list shows all"
        )
    trial: FlockTrial | MissionTrial | TeamTrial
    goal_m: tuple[float, float] | None = None
    if first.attack.in_swarm:
        with stdout_to_stderr(), mistakes_in(controller, name):
            trial, goal_m = _try_in_flock(first, options, defence, controller)
    elif first.attack.scene == "team":
        trial = _try_in_team(name, first, options | {"controller": controller}, defence)
    else:
        seed = options.pop("seed") or 0
        given = _options_of(name, first, options | {"controller": controller})
        trial = try_mission_attack(first.attack, defence, seed, given)
    if as_json:
        more = {}
        if isinstance(trial, FlockTrial):
            stops = [asdict(stop) | {"bound_s": trial.bound_of(stop)} for stop in trial.stops]
            more = {"stopped_in_time": trial.stopped_in_time, "within_buckets": trial.within_buckets, "stops": stops}
        print_json(asdict(trial) | more)
    else:
        _show(trial, first.attack, goal_m)
    return 1 if trial.broken else 0


def _try_in_flock(
    first: AttackSpec, options: dict[str, Any], defence: Any, controller: str | None
) -> tuple[FlockTrial, tuple[float, float] | None]:
    """Return the outcome, and the goal of the swarm, or None if only its controller knows the goal."""
    protocol = first.attack.against or controller  # attacks on the flock have no `against`
    is_protocol = protocol in PROTOCOLS
    swarm = find_scenario(str(protocol)) if is_protocol else Scenario(name="attack", duration_s=DURATION_S)
    scenario = apply_options(swarm, options, defence=defence)
    if first.at_s >= scenario.duration_s:
        raise UsageError(
            f"{first.name} begins at {first.at_s:g} s, when the run of {scenario.duration_s:g} s is over",
            f"use a longer --duration, or {first.name}:at=T",
        )
    others = first.attack.liars(scenario.bti.f_max) - 1
    scenario = replace(scenario, attacks=(first, *(replace(first, robot=None),) * others))
    scenario, own = find_controller(controller, scenario)
    print_cautions(scenario)
    report = {which: progress(scenario.duration_s, f"{which}: ") for which in ("attacked", "honest")}
    try:
        unknown = own or is_protocol or is_file(scenario.controller)
        return try_attack(scenario, lambda which, run: report[which](run), own), None if unknown else scenario.goal_m
    finally:
        end_status_line()


def _try_in_team(words: str, first: AttackSpec, options: dict[str, Any], defence: Any) -> TeamTrial:
    seed = options.pop("seed") or 0
    first.attack.check(_options_of(words, first, options))
    report = Progress().tell
    try:
        return try_in_team(
            first.attack, defence, seed, lambda share: report(f"{100 * share:.0f} % of both runs simulated", share)
        )
    finally:
        end_status_line()


def _options_of(words: str, spec: AttackSpec, swarm: Mapping[str, Any]) -> dict[str, float | str]:
    """Return the options of an attack on a mission. Raises: UsageError: options that only a swarm has."""
    wrong = [TYPED.get(name, f"--{name}") for name, value in swarm.items() if value is not None]
    wrong += [name for name in ("robot", "until") if f"{name}=" in words]
    if wrong:
        hint = "leave it out: an attack on a mission runs on one robot"
        raise UsageError(f"{spec.name} with {', '.join(wrong)}", hint)
    return {**spec.options, "at": spec.at_s} if "at=" in words else dict(spec.options)


def _show(trial: FlockTrial | MissionTrial | TeamTrial, attack: Attack, goal_m: tuple[float, float] | None) -> None:
    against = f", against {attack.against}" if attack.against else ""
    kept = "" if isinstance(trial, FlockTrial) else f": {'NOT AS DECLARED' if trial.broken else 'as declared'}"
    rows = {
        "attack": f"{trial.attack}{against}: {attack.does}",
        "defence": trial.defence + (f", declared outcome: {trial.declared}{kept}" if attack.stopped_by else ""),
    }
    if trial.declared == "stopped" and attack.stopped_by:
        rows["stopped by"] = attack.stopped_by
    if isinstance(trial, TeamTrial):
        print_rows(rows | _team(trial))
        return
    harm = f"{format_number(trial.harm, '.3g')} {trial.harm_unit}".strip() + f": {trial.harm_words}"
    if trial.declared == "stopped":
        rows["harm until stopped"] = harm
    elif trial.declared == "not covered":
        rows["harm"] = harm
    else:
        rows["harm"] = f"{harm} (counts from {trial.harm_bites_from:g} on)"
    print_rows(rows | (_flock(trial, goal_m) if isinstance(trial, FlockTrial) else _mission(trial)))


def _flock(trial: FlockTrial, goal_m: tuple[float, float] | None) -> dict[str, str]:
    attacked, honest = trial.attacked, trial.honest
    swarm = f"{count_of(attacked['robots'], 'robot')}, {attacked['duration_s']:g} s, seed {attacked['seed']}"
    rows = {"swarm": swarm}
    if goal_m:
        rows["swarm"] += f", goal ({goal_m[0]:g}, {goal_m[1]:g})"
        rows["distance to the goal"] = (
            f"{format_number(attacked['mean_distance_to_goal_m'], '.1f', ' m')} at the end, "
            f"{format_number(trial.honest_distance_m, '.1f', ' m')} without the attack"
        )
    for task, done in attacked.get("task", {}).items():
        rows[task] = f"{format_number(done, 'g')}, {format_number(honest['task'][task], 'g')} without the attack"
    rows |= {
        "contacts": f"{attacked['contacts']}, {honest['contacts']} without the attack",
        "stopped with a quorum": _wronged(trial),
        "stopped, no quorum": format_robots(attacked["without_quorum"]),
    }
    if trial.idle:
        rows["without effect"] = f"{', '.join(trial.idle)}: makes no difference under {trial.defence}"
    rows |= {f"robot {stop.robot}": _ended(trial, stop) for stop in trial.stops}
    rows |= {f"airtime of {each.robot}": _airtime(each) for each in trial.airtime}
    return rows if trial.airtime else rows | {"bound": _bound(trial)}


def _wronged(trial: FlockTrial) -> str:
    stopped = format_robots(trial.attacked["correct_in_safe_mode"])
    if trial.wronged is None:
        return f"{stopped}; no promise applies"
    return f"{stopped}: promise P2 is {'BROKEN' if trial.wronged else 'kept'}"


def _ended(trial: FlockTrial, stop: Stop) -> str:
    began = "never deviated" if stop.first_deviation_s is None else f"deviated at {stop.first_deviation_s:.2f} s"
    if stop.safe_mode_s is None:
        return f"{began}, is not in Safe Mode"
    bound = format_number(trial.bound_of(stop), ".3f", " s allowed")
    later = "" if stop.after_s is None else f", {stop.after_s:.2f} s later" + (f" ({bound})" if bound != "-" else "")
    return f"{began}, in Safe Mode at {stop.safe_mode_s:.2f} s{later}"


def _airtime(each: Airtime) -> str:
    kept = "kept" if each.used_s <= each.bucket_s else "BROKEN"
    on_air = f"{100 * each.on_air_s / each.seconds:.2f} %" if each.seconds else "nothing"
    return (
        f"{1000 * each.used_s:.1f} ms of AUDIT packets in {each.seconds:.2f} s without retries; its bucket allows "
        f"{1000 * each.bucket_s:.1f} ms: {kept}; with retries on the air {on_air} of the time"
    )


def _bound(trial: FlockTrial) -> str:
    if trial.bound_s is None:
        return "none promised"
    if all(stop.first_deviation_s is None for stop in trial.stops):
        return "not tested: no robot deviated"
    longer = f", {trial.missing_s:g} s more for a missing output" if trial.missing_s else ""
    # Whether a robot deviated and is neither stopped nor late yet.
    open_end = any(stop.first_deviation_s is not None and stop.safe_mode_s is None for stop in trial.stops)
    kept = "BROKEN" if not trial.stopped_in_time else "not tested: the run ended before it" if open_end else "kept"
    return f"{trial.bound_s:.3f} s from deviation to Safe Mode{longer}: {kept}"


def _team(trial: TeamTrial) -> dict[str, str]:
    began = "never deviated" if trial.deviated_s is None else f"deviated at {trial.deviated_s:.2f} s"
    end = "is not in Safe Mode" if trial.stopped_s is None else f"in Safe Mode at {trial.stopped_s:.2f} s"
    allowed = "" if trial.bound_s is None else f" ({trial.bound_s:.3f} s allowed in between)"
    refused = ", ".join(f"{why} ({count} times)" for why, count in trial.refusals.items())
    stopped = ", ".join(map(str, trial.in_safe_mode))
    return {
        "robot 1": f"{began}, {end}{allowed}",
        "refused audits": refused or "none",
        "other robots": f"{trial.completed} of {trial.others} completed the mission; in Safe Mode: {stopped or 'none'}",
    }


def _mission(trial: Trial) -> dict[str, str]:
    rows = _guessed(trial.attacked) if isinstance(trial.attacked, GuessOutcome) else _robot(trial.attacked)
    return rows if trial.honest is None else {**rows, "without the attack": _walked(trial.honest)}


def _robot(robot: ErrandOutcome) -> dict[str, str]:
    rows = {"robot": _walked(robot)}
    if robot.refused:
        return rows
    last = "" if robot.from_last_m is None else f", {robot.from_last_m:.2f} m from its last validated node"
    return {
        **rows,
        "at the end": f"{robot.pose_error_m:.2f} m pose error{last}",
        "false fixes": f"{robot.false_fixes}, worst error {robot.worst_fix_m:.2f} m" if robot.false_fixes else "none",
    }


def _walked(robot: ErrandOutcome) -> str:
    if robot.refused:
        return f"refused the mission: {robot.refused}"
    end = "completed" if robot.done else "holding" if robot.held else "under way"
    actions = ", ".join(f"{action} (WRONG)" if action in robot.wrong_actions else action for action in robot.actions)
    why = f"; not validated: {', '.join(robot.not_validated)}" if robot.not_validated else ""
    return f"{end} after {robot.t_s:.1f} s, {len(robot.decoded)} nodes; actions: {actions or 'none'}{why}"


def _guessed(guess: GuessOutcome) -> dict[str, str]:
    rows = {"read": f"{guess.read} of {guess.nodes} nodes"}
    if guess.tries:
        rows["tried"] = f"{guess.tries} in {span(guess.seconds)} on one core, {guess.tries_per_s:.3g}/s"
        rows["full search"] = f"{guess.candidates:.3g} tries: {span(guess.whole_s)} at this rate"
    return rows
