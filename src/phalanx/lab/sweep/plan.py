"""Read a sweep from YAML: a scenario, the options that vary, and seeds; list its runs."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from phalanx.config.written import compose, line_of, read_at_most, words_of
from phalanx.errors import UsageError, did_you_mean
from phalanx.scenarios import own
from phalanx.scenarios.file import DERIVED, find_scenario
from phalanx.scenarios.own import find_attack, is_file, no_controller
from phalanx.scenarios.scenario import Scenario, in_scenarios

Cell = str | int | float


MOST_BYTES = 1 << 16
MOST_RUNS = 1_000_000
HINT = "phalanx docs guides/sweeps has an example"
SWEEP_HINT = "pip install '.[sweep]' in a clone"
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
    seed: int
    scenario: Scenario | None  # of the seed; None where a scorecard tries something else than a flock
    attack: str | None  # None for the scenario's own
    controller: str | None  # None for the scenario's own


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs of a sweep or of a scorecard."""

    axes: Mapping[str, tuple[Cell, ...]]  # what is varied, with a value of each at least
    jobs: tuple[Job, ...]


def key_of(*said: object) -> str:
    """Of a run that this is all of: two of the same key are one."""
    return hashlib.sha256(repr(said).encode()).hexdigest()[:24]


def content_of(words: str) -> str:
    """Of the file in "FILE.py:CLASS", a digest. Raises: UsageError: no such file. Unavailable: it cannot be read."""
    return hashlib.sha256(read_at_most(Path(words.partition(":")[0]), own.MOST_BYTES, "FILE.py:CLASS")).hexdigest()


def read_sweep(path: Path) -> Plan:
    """Return the sweep in a file: axes in the order of the file; a single scenario is an axis of one value.

    Raises: UsageError: no such file, or not a sweep. Unavailable: it cannot be read.
    """
    data = read_at_most(path, MOST_BYTES, HINT)
    root = compose(data, str(path), HINT)
    return _Reader(path, root, words_of(root, data, str(path), HINT)).plan()


class _Reader:
    def __init__(self, path: Path, root: yaml.Node | None, words: Any) -> None:
        self._source, self._folder, self._root, self._words = str(path), path.parent, root, words

    def plan(self) -> Plan:
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
        seeds = self._seeds(words.get("seeds", 1))
        count = math.prod(map(len, axes.values())) * len(seeds)
        if count > MOST_RUNS:
            raise self._wrong(("grid",), f"{count} runs", f"at most {MOST_RUNS}")
        return Plan(axes, tuple(self._jobs(axes, seeds)))

    def _jobs(self, axes: Mapping[str, tuple[Cell, ...]], seeds: tuple[int, ...]) -> Iterator[Job]:
        """All runs, those of one point one after the other. Raises: UsageError: of a point that is no scenario."""
        content = cache(content_of)
        for values in itertools.product(*axes.values()):
            point = tuple(zip(axes, values, strict=True))
            try:
                scenario, attack, controller = self._at(dict(point))
            except UsageError as error:
                where = ", ".join(f"{name} {value}" for name, value in point)
                raise UsageError(f"{self._source}: at {where}: {error}", error.hint) from error
            contents = [content(words) if words and is_file(words) else "" for words in (attack, controller)]
            for seed in seeds:
                chosen = replace(scenario, seed=seed)
                key = key_of(repr(chosen), attack, controller, *contents)
                yield Job(key, point, seed, chosen, attack, controller)

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
        return str(self._folder / name) if Path(name).suffix in (".yaml", ".yml") else name

    def _own(self, words: str | None) -> str | None:
        return str((self._folder / words).resolve()) if words and is_file(words) else words

    def _axis(self, name: Any) -> str:
        known = _axes()
        if name not in known:
            hint = did_you_mean(str(name), known) + "phalanx docs guides/sweeps lists them"
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
