"""The record of an attack, which the list, scenarios, trials, tests and docs/reference/attacks.md share.

Another class carries the attack out. The record has only its name until it is needed, so the list imports none.
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

# What a defence does to an attack. stopped: within P1's bound. limited: the a-node's rate limits bound the harm.
# harmless: it does no harm that matters. not covered: no defence reaches it. bites: it goes on, or harms first.
Verdict = Literal["stopped", "limited", "harmless", "not covered", "bites"]
# Where it is tried. flock: one robot of a flock lies. errand: between an honest robot on a mission and its operator or
# its world. file: guessing a captured file. team: one of several robots that audit each other on a mission lies.
# protocol: one robot of another protocol lies in that protocol's messages.
Scene = Literal["flock", "errand", "file", "team", "protocol"]


def by_defence(none: Verdict, paper: Verdict, hardened: Verdict) -> Mapping[Defence, Verdict]:
    """Return an attack's verdicts by defence."""
    return {"none": none, "paper": paper, "hardened": hardened}


STOPPED = by_defence("bites", "stopped", "stopped")
HOLE_OF_THE_PAPER = by_defence("bites", "bites", "stopped")


@dataclass(frozen=True, slots=True)
class Option:
    """An option of an attack."""

    values: tuple[float | str, ...] = ()  # allowed values; empty for any number from `least` on
    defences: tuple[Defence, ...] = DEFENCES  # under which it makes a difference
    least: float = 0.0

    def takes(self, value: float | str) -> bool:
        """Return whether this is an allowed value."""
        if self.values:
            return value in self.values
        return not isinstance(value, str) and self.least <= value < math.inf


@dataclass(frozen=True, slots=True)
class Attack:
    """One way to lie, or to be lied to."""

    name: str  # as typed in commands
    # The class that carries it out, or its dotted name: a `Liar`, or for other scenes a `Between`, a `Guess` or a
    # `MissionCheat`.
    made_of: str | type[Any]
    verdicts: Mapping[Defence, Verdict] = field(default_factory=lambda: STOPPED)  # what each defence makes of it
    harm: Harm = ASTRAY  # how its damage to others is measured
    bites_from: float = 1.0  # from so much damage on, it bites
    does: str = ""  # what it does, for people
    stopped_by: str = ""  # what stops it, or why nothing has to, or why nothing can; "" where nobody has declared it
    scene: Scene = "flock"  # where it is tried
    against: str = ""  # what it lies about, on missions; of a protocol its name
    limit: float = 0.0  # a defence that limits it keeps its damage below this; 0 for below what bites
    crowd: bool = False  # whether it takes f_max robots, and not one
    on_wheels: bool = False  # whether it makes sense for the demo's robots, whatever controller they run
    options: Mapping[str, Option] = field(default_factory=dict)  # what else can be asked of it, by name

    @property
    def in_swarm(self) -> bool:
        """Return whether a robot of a swarm carries it out."""
        return self.scene in ("flock", "protocol")

    @property
    def kind(self) -> type[Any]:
        """Return the class that carries it out."""
        if isinstance(self.made_of, type):
            return self.made_of
        module, _, name = self.made_of.rpartition(".")
        kind: type[Any] = getattr(import_module(module), name)
        return kind

    def liars(self, f_max: int) -> int:
        """Return how many robots it takes, of the f_max that are tolerated."""
        return f_max if self.crowd else 1

    def check(self, options: Mapping[str, float | str]) -> None:
        """Check that all options are options of this attack.

        Raises: UsageError: it has no such option, or not with that value.
        """
        for name, value in options.items():
            if name not in self.options:
                always = ("robot", "at", "until") if self.in_swarm else ()
                known = (*self.options, *always)
                hint = f"{did_you_mean(name, known)}it takes {', '.join(known) or 'none'}"
                raise UsageError(f"options of {self.name} have no {name!r}", hint)
            if not self.options[name].takes(value):
                shown = f"{value:g}" if isinstance(value, float) else repr(value)
                option = self.options[name]
                allowed = " or ".join(str(each) for each in option.values) or f"a number from {option.least:g} on"
                raise UsageError(f"options of {self.name} have {name}={shown}", f"{name} is {allowed}")

    def idle(self, options: Mapping[str, float | str], defence: Defence) -> list[str]:
        """Return the options that make no difference under the defence, by name."""
        return [name for name in options if defence not in self.options[name].defences]


def own_attack(made: Attack | type[Any]) -> Attack:
    """Return the record of an attack that is not in the library; a class's name and docstring say what it is.

    Raises: UsageError: it is neither, or never does what its `on_wake` says.
    """
    if isinstance(made, Attack):
        return made
    scene = getattr(made, "scene", None)
    if not isinstance(made, type) or scene is None:
        raise UsageError(
            f"{made!r} is no attack", "a class that derives from Liar (phalanx docs reference/attacks), or an Attack"
        )
    if _never_wakes(made):
        raise UsageError(f"{made.__name__} has on_wake, and no period_ms", "period_ms = 250: how often it is called")
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", made.__name__).lower()
    does = (made.__doc__ or "").strip().partition("\n")[0].rstrip(".")
    return Attack(name, made, does=does, scene=scene)


def _never_wakes(made: Any) -> bool:
    """Return whether a `Liar` has an `on_wake` that is never called."""
    roots = [each for each in made.__mro__ if "period_ms" in vars(each)]
    return bool(roots) and not made.period_ms and made.on_wake is not roots[-1].on_wake
