"""Plan the scorecard: each attack under each defence in each protocol, as runs of a sweep.

A protocol is what honest robots do. Bundled controllers that scenarios run are there by themselves, in a scenario that
comes with them if there is one; so are missions, of one robot and of a team; and a controller of one's own.
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

# When compromised robots begin, and for how long they are watched: T_val and more than a round of audits beside it.
# Protocols are in plain Python, ten times as dear as a flock, and what is lost to others shows in so much of their own
# scenarios.
AT_S, WATCHED_S, WATCHED_IN_PROTOCOLS_S = 12.0, 24.0, 48.0
MISSIONS: Mapping[str, tuple[Scene, ...]] = {"mission": ("errand", "file"), "team": ("team",)}
HONEST_KEPT = 8  # honest runs: all attacks of a seed are compared with the same
WHEELS = "wheels"  # the demo's robots, who wait for orders: attacks that make sense for them
# Of an attack's words, what flocks alone take.
UNHEARD = {WHEELS: ("robot", "until"), "mission": ("at", "robot", "until"), "team": ("at", "robot", "until")}
# Near enough to each other that neighbours push, and near the goal, so that lies about the way there matter.
SMALL = Scenario(
    name="scorecard",
    robots=12,
    grid_step_m=16.0,
    goal_m=(150.0, 150.0),
    duration_s=AT_S + WATCHED_S,
    bti=BtiConfig(f_max=3),
)
COMMON = ("flock", "guard")  # controllers that many scenarios have: SMALL is theirs


@dataclass(frozen=True, slots=True)
class Bout(Job):
    """One run of an attack, beside the same without it. Its scenario is honest; None on a mission and on wheels."""

    attack: str  # as typed
    defence: Defence
    protocol: str


def scorecard_plan(attacks: Sequence[str], protocols: Sequence[str], seeds: int) -> Plan:
    """Return all runs of a scorecard, seed by seed: whatever there is when it is stopped is a smaller scorecard.

    Args:
        attacks: names, with options or not, and FILE.py:CLASS with the whole path; none for all of the library.
        protocols: names, and likewise FILE.py:CLASS of a controller; none for all there are.
        seeds: from 0 on.
    Raises: UsageError: no such protocol or attack, or attacks that none of the protocols has a place for.
    """
    known = known_protocols()
    for name in protocols:
        if not is_file(name) and name not in known:
            raise UsageError(
                f"no protocol {name!r}", f"{did_you_mean(name, known)}{', '.join(known)}, or FILE.py:CLASS"
            )
    grounds = {_short(name): _ground(name) for name in protocols or known}
    chosen = {words: _attack(words) for words in attacks or known_attacks()}
    tried = [(name, words) for name in grounds for words, attack in chosen.items() if _is_tried(attack, name)]
    if not tried:
        raise UsageError("nothing to try", "these attacks are none on these protocols")
    for protocol, words in tried:
        for name in UNHEARD.get(protocol, ()):
            if f"{name}=" in words:
                raise UsageError(f"{words} on {protocol}, which takes no {name}", "another --controller, or without")
    contents = {words: content_of(words) for words in (*protocols, *chosen) if is_file(words)}

    def bout(protocol: str, attack: str, defence: Defence, seed: int) -> Bout:
        scenario, controller = grounds[protocol]
        if scenario:
            scenario = replace(scenario, seed=seed, defence=defence)
        said = (protocol, attack, defence, seed, repr(scenario), *map(contents.get, (attack, str(controller))))
        point = (("protocol", protocol), ("attack", _short(attack)), ("defence", defence))
        return Bout(key_of(*said), point, seed, scenario, attack, controller, defence, protocol)

    return Plan(
        {"protocol": tuple(grounds), "attack": tuple(chosen), "defence": DEFENCES},
        tuple(bout(*pair, defence, seed) for seed in range(seeds) for pair in tried for defence in DEFENCES),
    )


def _attack(words: str) -> Attack:
    spec = find_attack(words)
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
    """Names of all that come with phalanx."""
    return [*in_scenarios(), WHEELS, *MISSIONS]


def _ground(name: str) -> tuple[Scenario | None, str | None]:
    """Return the scenario in which a protocol is tried, and the controller's file if it has one."""
    if name == WHEELS or name in MISSIONS:
        return None, None
    if is_file(name):
        return SMALL, name
    own = () if name in COMMON else map(find_scenario, built_in("scenarios"))
    made = next((each for each in own if each.controller == name), replace(SMALL, controller=name))
    watched_s = WATCHED_IN_PROTOCOLS_S if name in PROTOCOLS else WATCHED_S
    return replace(made, attacks=(), duration_s=AT_S + watched_s), None


def absolute(words: str) -> str:
    """A file of one's own by its whole path: other processes may run elsewhere. Any other word as it is."""
    path, colon, name = words.partition(":")
    return f"{Path(path).resolve()}{colon}{name}" if is_file(words) else words


def _short(words: str) -> str:
    """How a file of one's own is called in the table."""
    path, colon, name = words.partition(":")
    return f"{Path(path).name}{colon}{name}" if is_file(words) else words
