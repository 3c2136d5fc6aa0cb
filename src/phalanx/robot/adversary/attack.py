"""The record of an attack, used by scenarios, trials, tests, lists of attacks and docs/reference/attacks.md.

Another class carries the attack out. The record may contain just its dotted name, so that listing attacks imports none.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal

from phalanx.config.defence import DEFENCES, Defence
from phalanx.errors import UsageError, did_you_mean

from .harm import ASTRAY, Harm

# Effect of a defence on an attack. stopped: within P1's bound. limited: the a-node's rate limits bound the harm.
# harmless: the harm is negligible. not covered: no defence applies. bites: it continues, or does harm before it ends.
Verdict = Literal["stopped", "limited", "harmless", "not covered", "bites"]
# Setting of an attack. flock: one robot of a flock is compromised. errand: the attacker is between an honest robot on a
# mission and its operator or environment. file: guessing a captured mission file. team: one of several robots that
# audit each other on a mission is compromised. protocol: one robot of another protocol sends false messages.
Scene = Literal["flock", "errand", "file", "team", "protocol"]


def by_defence(none: Verdict, paper: Verdict, hardened: Verdict) -> Mapping[Defence, Verdict]:
    """Return a mapping of an attack's verdicts by defence."""
    return {"none": none, "paper": paper, "hardened": hardened}


STOPPED = by_defence("bites", "stopped", "stopped")
HOLE_OF_THE_PAPER = by_defence("bites", "bites", "stopped")


@dataclass(frozen=True, slots=True)
class Option:
    """An option of an attack."""

    values: tuple[float | str, ...] = ()  # allowed values; empty for any number of at least `least`
    defences: tuple[Defence, ...] = DEFENCES  # defences under which the option has an effect
    least: float = 0.0

    def takes(self, value: float | str) -> bool:
        """Return whether a value is allowed."""
        if self.values:
            return value in self.values
        return not isinstance(value, str) and self.least <= value < math.inf


@dataclass(frozen=True, slots=True)
class Attack:
    """Record of an attack: its implementation, and the expected effect of each defence."""

    name: str  # as in commands
    # The class that carries it out, or its dotted name: a `Liar`, or for other scenes a `Between`, a `Guess` or a
    # `MissionCheat`.
    made_of: str | type[Any]
    verdicts: Mapping[Defence, Verdict] = field(default_factory=lambda: STOPPED)  # effect of each defence
    harm: Harm = ASTRAY  # measure of its damage to others
    bites_from: float = 1.0  # damage from which it counts as "bites"
    does: str = ""  # description, for display
    stopped_by: str = ""  # what stops it, or why nothing needs to or can; "" if not declared
    scene: Scene = "flock"  # setting in which it is tried
    against: str = ""  # its target on missions; the protocol's name in scene "protocol"
    limit: float = 0.0  # damage under a defence that limits it stays below this; 0: below `bites_from`
    crowd: bool = False  # whether it needs f_max robots instead of one
    on_wheels: bool = False  # whether it is offered for the demo's robots, whatever their controller
    options: Mapping[str, Option] = field(default_factory=dict)  # its options, by name

    @property
    def in_swarm(self) -> bool:
        """Return whether a robot of a swarm carries it out."""
        return self.scene in ("flock", "protocol")

    @property
    def kind(self) -> type[Any]:
        """Return the class that carries the attack out."""
        if isinstance(self.made_of, type):
            return self.made_of
        module, _, name = self.made_of.rpartition(".")
        kind: type[Any] = getattr(import_module(module), name)
        return kind

    def liars(self, f_max: int) -> int:
        """Return the number of compromised robots that the attack needs."""
        return f_max if self.crowd else 1

    def check(self, options: Mapping[str, float | str]) -> None:
        """Check that all options are options of this attack.

        Raises: UsageError: an unknown option, or a value that is not allowed.
        """
        for name, value in options.items():
            if name not in self.options:
                always = ("robot", "at", "until") if self.in_swarm else ()
                known = (*self.options, *always)
                hint = f"{did_you_mean(name, known)}allowed: {', '.join(known) or 'none'}"
                raise UsageError(f"attack {self.name} has no option {name!r}", hint)
            if not self.options[name].takes(value):
                shown = f"{value:g}" if isinstance(value, float) else repr(value)
                option = self.options[name]
                allowed = " or ".join(str(each) for each in option.values) or f"a number of at least {option.least:g}"
                raise UsageError(f"option {name} of attack {self.name} is {shown}", f"allowed: {allowed}")

    def idle(self, options: Mapping[str, float | str], defence: Defence) -> list[str]:
        """Return the names of options that have no effect under the defence."""
        return [name for name in options if defence not in self.options[name].defences]


def own_attack(made: Attack | type[Any]) -> Attack:
    """Return the record of a user's attack; for a class, name and description come from its name and docstring.

    Raises: UsageError: not an attack, or `on_wake` is never called because period_ms is 0.
    """
    if isinstance(made, Attack):
        return made
    scene = getattr(made, "scene", None)
    if not isinstance(made, type) or scene is None:
        raise UsageError(
            f"{made!r} is not an attack", "use a subclass of Liar (phalanx docs reference/attacks), or an Attack"
        )
    if _never_wakes(made):
        raise UsageError(f"{made.__name__} has on_wake but no period_ms", "set its period, like period_ms = 250")
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", made.__name__).lower()
    does = (made.__doc__ or "").strip().partition("\n")[0].rstrip(".")
    return Attack(name, made, does=does, scene=scene)


def _never_wakes(made: Any) -> bool:
    """Return whether a `Liar` overrides `on_wake` without a period, so that it is never called."""
    roots = [each for each in made.__mro__ if "period_ms" in vars(each)]
    return bool(roots) and not made.period_ms and made.on_wake is not roots[-1].on_wake
