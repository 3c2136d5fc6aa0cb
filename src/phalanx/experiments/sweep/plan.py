"""What a sweep is: a scenario, what is varied of it, and seeds, as YAML; and the runs that this comes to."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import yaml

from phalanx.config.written import compose, line_of, read_at_most, words_of
from phalanx.errors import UsageError, did_you_mean
from phalanx.scenarios import own
from phalanx.scenarios.file import DERIVED, find_scenario
from phalanx.scenarios.own import find_attack, is_file, no_controller
from phalanx.scenarios.scenario import Scenario, in_scenarios

from .dealing import key_of

Cell = str | int | float


class Planned(Protocol):
    """One run that is to be made, as far as dealing it out and keeping its row need to know it."""

    @property
    def key(self) -> str:
        """Two with the same come to the same row."""

    @property
    def point(self) -> tuple[tuple[str, Cell], ...]:
        """The axes' names, and where on each it is."""

    @property
    def seed(self) -> int:
        """Of its dice."""


class Plan(Protocol):
    """Runs that are to be made: a `Sweep` is one."""

    @property
    def axes(self) -> Mapping[str, tuple[Cell, ...]]:
        """What is varied, with a value of each at least."""

    @property
    def jobs(self) -> tuple[Any, ...]:
        """All runs, each `Planned`."""


MOST_BYTES = 1 << 16
MOST_RUNS = 1_000_000
HINT = "docs/sweeps.md has an example"
KEYS = ("scenario", "seeds", "grid")
# What `phalanx sim run` has an option for is called as there.
OPTIONS = ("robots", "spacing_m", "duration_s", "defence", "f_max", "t_audit_s", "t_val_s")
NAMES = ("scenario", "attack", "controller")  # of something, as text
SECTIONS = ("bti", "flock", "guard", "radio")
NEITHER = ("name", "about", "seed", "attacks", "obstacles")


@dataclass(frozen=True, slots=True)
class Job:
    """One run. It can be sent to another machine: a controller and an attack from a file go by their words."""

    key: str  # two jobs with the same come to the same row
    point: tuple[tuple[str, Cell], ...]  # the axes' names, and where on each it is
    scenario: Scenario
    attack: str | None  # None for the scenario's own
    controller: str | None  # None for the scenario's own

    @property
    def seed(self) -> int:
        """The scenario's."""
        return self.scenario.seed


@dataclass(frozen=True)
class Sweep:
    """All runs of a file. Axes are in the order of the file; a single scenario is an axis of one value."""

    source: str
    axes: Mapping[str, tuple[Cell, ...]]
    seeds: tuple[int, ...]
    folder: Path  # that of the file, where those that it names are

    @property
    def count(self) -> int:
        """Of runs."""
        return math.prod(map(len, self.axes.values())) * len(self.seeds)

    @cached_property
    def jobs(self) -> tuple[Job, ...]:
        """All runs, those of one point one after the other. Raises: UsageError: of a point that is no scenario."""
        return tuple(self._jobs())

    def _jobs(self) -> Iterator[Job]:
        for values in itertools.product(*self.axes.values()):
            point = tuple(zip(self.axes, values, strict=True))
            try:
                scenario, attack, controller = self._at(dict(point))
            except UsageError as error:
                where = ", ".join(f"{name} {value}" for name, value in point)
                raise UsageError(f"{self.source}: at {where}: {error}", error.hint) from error
            for seed in self.seeds:
                chosen = replace(scenario, seed=seed)
                said = (repr(chosen), attack, controller, *map(self._content, (attack, controller)))
                yield Job(key_of(*said), point, chosen, attack, controller)

    def _at(self, point: dict[str, Any]) -> tuple[Scenario, str | None, str | None]:
        scenario = find_scenario(self._path(point.pop("scenario")))
        attack, controller = (self._own(point.pop(name, None)) for name in ("attack", "controller"))
        if controller and not is_file(controller):
            if controller not in in_scenarios():
                raise no_controller(controller, in_scenarios())
            scenario, controller = replace(scenario, controller=controller), None
        scenario = scenario.with_options(**{name: point.pop(name) for name in OPTIONS if name in point})
        for name, value in point.items():
            section, dot, field = name.partition(".")
            if dot:
                inner = replace(getattr(scenario, section), **{field: value})
                scenario = replace(scenario, **{section: inner})
            else:
                scenario = replace(scenario, **{name: value})
        if attack == "none":
            return replace(scenario, attacks=()), None, controller
        if attack and not is_file(attack):
            return replace(scenario, attacks=(find_attack(attack),)), None, controller
        return scenario, attack, controller

    def _path(self, name: str) -> str:
        return str(self.folder / name) if Path(name).suffix in (".yaml", ".yml") else name

    def _own(self, words: str | None) -> str | None:
        return str((self.folder / words).resolve()) if words and is_file(words) else words

    def _content(self, words: str | None) -> str:
        return self._digests.setdefault(words, content_of(words)) if words and is_file(words) else ""

    @cached_property
    def _digests(self) -> dict[str, str]:
        return {}


def content_of(words: str) -> str:
    """Of the file in "FILE.py:CLASS", a digest. Raises: UsageError: no such file. Unavailable: it cannot be read."""
    return hashlib.sha256(read_at_most(Path(words.partition(":")[0]), own.MOST_BYTES, "FILE.py:CLASS")).hexdigest()


def read_sweep(path: Path) -> Sweep:
    """The sweep in a file. Raises: UsageError: no such file, or not a sweep. Unavailable: it cannot be read."""
    data = read_at_most(path, MOST_BYTES, HINT)
    root = compose(data, str(path), HINT)
    return _Reader(str(path), root, words_of(root, data, str(path), HINT)).sweep(path.parent)


class _Reader:
    def __init__(self, source: str, root: yaml.Node | None, words: Any) -> None:
        self._source, self._root, self._words = source, root, words

    def sweep(self, folder: Path) -> Sweep:
        words = self._mapping((), self._words)
        for name in words:
            if name not in KEYS:
                raise self._wrong((name,), f"no {name!r} in a sweep", did_you_mean(str(name), KEYS) + ", ".join(KEYS))
        if "scenario" not in words:
            raise self._wrong((), "no scenario", HINT)
        grid = self._mapping(("grid",), words.get("grid") or {})
        axes = {"scenario": self._values(("scenario",), "scenario", words["scenario"])}
        for name, values in grid.items():
            axis = self._axis(name)
            axes[axis] = self._values(("grid", name), axis, values)
        sweep = Sweep(self._source, axes, self._seeds(words.get("seeds", 1)), folder)
        if sweep.count > MOST_RUNS:
            raise self._wrong(("grid",), f"{sweep.count} runs", f"at most {MOST_RUNS}")
        return sweep

    def _axis(self, name: Any) -> str:
        known = _axes()
        if name not in known:
            hint = did_you_mean(str(name), known) + "docs/sweeps.md lists them"
            raise self._wrong(("grid", name), f"nothing of a scenario is called {name!r}", hint)
        return str(name)

    def _values(self, path: tuple[Any, ...], name: str, said: Any) -> tuple[Cell, ...]:
        values = said if isinstance(said, list) else [said]
        text = name in (*NAMES, "defence")
        for value in values:
            if isinstance(value, bool) or not isinstance(value, str if text else int | float):
                raise self._wrong(path, f"{name} is {value!r}", "text" if text else "a number")
        if not values or len(set(values)) < len(values):
            raise self._wrong(path, f"{name}: {'nothing' if not values else 'the same twice'}", "each value once")
        return tuple(values)

    def _seeds(self, said: Any) -> tuple[int, ...]:
        seeds = list(range(said)) if type(said) is int and 0 <= said <= MOST_RUNS else said
        whole = isinstance(seeds, list) and all(type(seed) is int and 0 <= seed < 1 << 32 for seed in seeds)
        if not whole or not seeds or len(set(seeds)) < len(seeds):
            raise self._wrong(("seeds",), f"seeds is {said!r}", "how many, or a list of whole numbers, each once")
        return tuple(seeds)

    def _mapping(self, path: tuple[Any, ...], words: Any) -> dict[Any, Any]:
        if not isinstance(words, dict):
            raise self._wrong(path, f"{path[-1] if path else 'the file'} is no mapping", HINT)
        return words

    def _wrong(self, path: tuple[Any, ...], message: str, hint: str) -> UsageError:
        node, line = self._root, 1
        for name in path:
            pairs = node.value if isinstance(node, yaml.MappingNode) else ()
            found = next((pair for pair in pairs if pair[0].value == str(name)), None)
            if found is None:
                break
            node, line = found[1], line_of(found[0])
        return UsageError(f"{self._source}:{line}: {message}"[:300], hint)


def _axes() -> list[str]:
    """Everything that a grid can vary, but for the scenario itself."""
    example = Scenario()
    plain = [each.name for each in fields(Scenario) if not is_dataclass(getattr(example, each.name))]
    of_sections = [
        f"{section}.{each.name}"
        for section in SECTIONS
        for each in fields(getattr(example, section))
        if isinstance(getattr(getattr(example, section), each.name), int | float)
        and each.name not in DERIVED.get(type(getattr(example, section)), ())
    ]
    numbers = [name for name in plain if isinstance(getattr(example, name), int | float) and name not in NEITHER]
    return list(dict.fromkeys([*OPTIONS, "attack", "controller", *numbers, *of_sections]))
