"""What `phalanx attack run` says of an attack on a mission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from phalanx.errors import UsageError
from phalanx.experiments.missions.trial import MissionTrial
from phalanx.robot.attacks.missions import MISSION_ATTACKS, Guessed, Walked
from phalanx.sim.scenarios.scenario import parse_attack

from .mission.crack import span
from .terminal import print_json, print_rows


def options_of(words: str, swarm: Mapping[str, Any]) -> dict[str, float | str]:
    """The options of an attack on a mission, out of `NAME[:at=T,OPTION=VALUE,…]`.

    Args:
        words: as typed.
        swarm: what was said of a swarm, which such an attack does not have.
    Raises: UsageError: something was.
    """
    attack = parse_attack(words)
    wrong = [f"--{name.replace('_', '-')}" for name, value in swarm.items() if value is not None]
    wrong += [name for name in ("robot", "until") if f"{name}=" in words]
    if wrong:
        raise UsageError(f"{attack.name} with {', '.join(wrong)}", "an attack on a mission is tried on one robot")
    options = dict(attack.options)
    return {**options, "at": attack.at_s} if "at=" in words else options


def show_trial(trial: MissionTrial, *, as_json: bool) -> None:
    """The trial, on stdout."""
    if as_json:
        print_json(asdict(trial))
        return
    rows = {
        "attack": f"{trial.attack}, against {trial.against}: {MISSION_ATTACKS[trial.attack].does}",
        "defence": f"{trial.defence}, which should make it: {trial.declared}: {'so it is' if trial.kept else 'NOT SO'}",
        "stopped by": MISSION_ATTACKS[trial.attack].stopped_by,
        "harm": f"{trial.harm:.3g} {trial.harm_unit}: {trial.harm_words} (from {trial.harm_bites_from:g} on it counts)",
    }
    if isinstance(trial.attacked, Guessed):
        rows |= _guessed(trial.attacked)
    else:
        rows |= {"robot": _walked(trial.attacked), **_where(trial.attacked)}
    if trial.honest is not None:
        rows["without the attack"] = _walked(trial.honest)
    print_rows(rows)


def _walked(robot: Walked) -> str:
    if robot.refused:
        return f"refuses the mission: {robot.refused}"
    end = "done" if robot.done else "holds" if robot.held else "still on its way"
    did = ", ".join(f"{action} (WRONG)" if action in robot.wrong_actions else action for action in robot.actions)
    why = f"; not validated: {', '.join(robot.not_validated)}" if robot.not_validated else ""
    return f"{end} after {robot.t_s:.1f} s, {len(robot.decoded)} nodes; did {did or 'nothing'}{why}"


def _where(robot: Walked) -> dict[str, str]:
    if robot.refused:
        return {}
    last = "" if robot.from_last_m is None else f", {robot.from_last_m:.2f} m from its last validated node"
    return {
        "at the end": f"{robot.pose_error_m:.2f} m from where it believes to be{last}",
        "false fixes": f"{robot.false_fixes}, the worst by {robot.worst_fix_m:.2f} m" if robot.false_fixes else "none",
    }


def _guessed(guess: Guessed) -> dict[str, str]:
    rows = {"read": f"{guess.read} of {guess.nodes} nodes"}
    if guess.tries:
        rows["tried"] = f"{guess.tries} in {span(guess.seconds)} on one core, {guess.tries_per_s:.3g}/s"
        rows["in all"] = f"{guess.candidates:.3g} tries: {span(guess.whole_s)} at this rate"
    return rows
