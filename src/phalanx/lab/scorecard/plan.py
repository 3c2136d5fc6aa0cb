"""Plan the scorecard: each attack under each defence in each protocol, as runs of a sweep.

A protocol is the behaviour of the honest robots. Included are the bundled controllers for scenarios, in a built-in
scenario if there is one; missions of one robot and of a team; and users' own controllers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from phalanx.config import BtiConfig
from phalanx.config.builtin import built_in
from phalanx.config.defence import DEFENCES, Defence
from phalanx.errors import UsageError, did_you_mean
from phalanx.lab.sweep.plan import Job, Plan, content_of, key_of
from phalanx.robot.adversary.attack import Attack, Scene
from phalanx.robot.adversary.registry import attacks as known_attacks
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attack, is_file
from phalanx.scenarios.scenario import PROTOCOLS, Scenario, in_scenarios

# Start of the attack, and duration after it: T_val and more than one audit round. Protocols are in plain Python, ten
# times as slow as a flock, and in their own scenarios the harm to others shows within this longer time.
AT_S, WATCHED_S, WATCHED_IN_PROTOCOLS_S = 12.0, 24.0, 48.0
MISSIONS: Mapping[str, tuple[Scene, ...]] = {"mission": ("errand", "file"), "team": ("team",)}
HONEST_KEPT = 8  # cached honest runs: all attacks of a seed are compared with the same one
WHEELS = "wheels"  # the demo's robots, which wait for orders; only some attacks apply to them
# Options of an attack that only flocks support.
UNSUPPORTED = {WHEELS: ("robot", "until"), "mission": ("at", "robot", "until"), "team": ("at", "robot", "until")}
# Close enough for neighbours to repel each other, and near the goal, so that false positions on the way matter.
SMALL = Scenario(
    name="scorecard",
    robots=12,
    grid_step_m=16.0,
    goal_m=(150.0, 150.0),
    duration_s=AT_S + WATCHED_S,
    bti=BtiConfig(f_max=3),
)
COMMON = ("flock", "guard")  # controllers of many scenarios; they are tried in SMALL


@dataclass(frozen=True, slots=True)
class Bout(Job):
    """One run of an attack. Its scenario has no attack yet; it is None for missions and on wheels."""

    attack: str  # as on the command line
    defence: Defence
    protocol: str


def scorecard_plan(attacks: Sequence[str], protocols: Sequence[str], seeds: int) -> Plan:
    """Return all runs of a scorecard, seed by seed, so that an interrupted one is a complete smaller one.

    Args:
        attacks: names, optionally with options, or FILE.py:CLASS with an absolute path; empty for the whole library.
        protocols: names, or FILE.py:CLASS of a controller likewise; empty for all.
        seeds: number of seeds, from 0.
    Raises: UsageError: no such protocol or attack, or no attack applies to any of the protocols.
    """
    known = known_protocols()
    for name in protocols:
        if not is_file(name) and name not in known:
            raise UsageError(
                f"no protocol {name!r}", f"{did_you_mean(name, known)}{', '.join(known)}, or FILE.py:CLASS"
            )
    grounds = {_short(name): _ground(name) for name in protocols or known}
    chosen = {text: _attack(text) for text in attacks or known_attacks()}
    tried = [(name, text) for name in grounds for text, attack in chosen.items() if _is_tried(attack, name)]
    if not tried:
        raise UsageError("nothing to try", "choose attacks that apply to these protocols")
    for protocol, text in tried:
        for name in UNSUPPORTED.get(protocol, ()):
            if f"{name}=" in text:
                raise UsageError(f"{text} on {protocol}, which takes no {name}", "use another --controller, or omit it")
    contents = {text: content_of(text) for text in (*protocols, *chosen) if is_file(text)}

    def bout(protocol: str, attack: str, defence: Defence, seed: int) -> Bout:
        scenario, controller = grounds[protocol]
        if scenario:
            scenario = replace(scenario, seed=seed, defence=defence)
        settings = (protocol, attack, defence, seed, repr(scenario), *map(contents.get, (attack, str(controller))))
        point = (("protocol", protocol), ("attack", _short(attack)), ("defence", defence))
        return Bout(key_of(*settings), point, seed, scenario, attack, controller, defence, protocol)

    return Plan(
        {"protocol": tuple(grounds), "attack": tuple(chosen), "defence": DEFENCES},
        tuple(bout(*pair, defence, seed) for seed in range(seeds) for pair in tried for defence in DEFENCES),
    )


def _attack(text: str) -> Attack:
    spec = find_attack(text)
    if not spec.own and spec.name not in known_attacks():
        raise UsageError(f"no attack {spec.name!r}", f"{did_you_mean(spec.name, known_attacks())}phalanx attack list")
    return spec.attack


def _is_tried(attack: Attack, protocol: str) -> bool:
    if protocol == WHEELS:
        return attack.on_wheels
    if attack.scene == "protocol":
        return protocol in PROTOCOLS and attack.against in ("", protocol)
    return attack.scene in MISSIONS.get(protocol, ("flock",))


def known_protocols() -> list[str]:
    """Return the names of all protocols that are included in phalanx."""
    return [*in_scenarios(), WHEELS, *MISSIONS]


def _ground(name: str) -> tuple[Scenario | None, str | None]:
    """Return the scenario in which a protocol is tried, and the controller's file if it is a user's own."""
    if name == WHEELS or name in MISSIONS:
        return None, None
    if is_file(name):
        return SMALL, name
    own = () if name in COMMON else map(find_scenario, built_in("scenarios"))
    chosen = next((each for each in own if each.controller == name), replace(SMALL, controller=name))
    watched_s = WATCHED_IN_PROTOCOLS_S if name in PROTOCOLS else WATCHED_S
    return replace(chosen, attacks=(), duration_s=AT_S + watched_s), None


def absolute(words: str) -> str:
    """Return FILE.py:CLASS with an absolute path, because workers may run in other folders; other names unchanged."""
    path, colon, name = words.partition(":")
    return f"{Path(path).resolve()}{colon}{name}" if is_file(words) else words


def _short(text: str) -> str:
    """Return the name of a user's own file in the table."""
    path, colon, name = text.partition(":")
    return f"{Path(path).name}{colon}{name}" if is_file(text) else text
