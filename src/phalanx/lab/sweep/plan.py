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
# Options of `phalanx sim run` have the same names here.
OPTIONS = ("robots", "spacing_m", "duration_s", "defence", "f_max", "t_audit_s", "t_val_s")
NAMES = ("scenario", "attack", "controller")  # values are text
SECTIONS = ("bti", "flock", "guard", "radio")
NEITHER = ("name", "about", "seed", "attacks", "obstacles")


@dataclass(frozen=True, slots=True)
class Job:
    """One run. It can be sent to another machine; controllers and attacks from files are sent by name."""

    key: str  # jobs with equal keys give equal rows
    point: tuple[tuple[str, Cell], ...]  # name and value on each axis
    seed: int
    scenario: Scenario | None  # with the seed; None for attacks of a scorecard outside flocks
    attack: str | None  # None for the scenario's own
    controller: str | None  # None for the scenario's own


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs of a sweep or of a scorecard."""

    axes: Mapping[str, tuple[Cell, ...]]  # varied settings, each with at least one value
    jobs: tuple[Job, ...]


def key_of(*settings: object) -> str:
    """Return the key of a run from everything that determines its result."""
    return hashlib.sha256(repr(settings).encode()).hexdigest()[:24]


def content_of(name: str) -> str:
    """Return a digest of the file in "FILE.py:CLASS". Raises: UsageError: no such file. Unavailable: cannot be read."""
    return hashlib.sha256(read_at_most(Path(name.partition(":")[0]), own.MOST_BYTES, "FILE.py:CLASS")).hexdigest()


def read_sweep(path: Path) -> Plan:
    """Return the sweep in a file: axes in the order of the file; a single scenario is an axis of one value.

    Raises: UsageError: no such file, or not a sweep. Unavailable: it cannot be read.
    """
    data = read_at_most(path, MOST_BYTES, HINT)
    root = compose(data, str(path), HINT)
    return _Reader(path, root, words_of(root, data, str(path), HINT)).plan()


class _Reader:
    def __init__(self, path: Path, root: yaml.Node | None, content: Any) -> None:
        self._source, self._folder, self._root, self._content = str(path), path.parent, root, content

    def plan(self) -> Plan:
        content = self._mapping((), self._content)
        for name in content:
            if name not in KEYS:
                raise self._wrong((name,), f"no {name!r} in a sweep", did_you_mean(str(name), KEYS) + ", ".join(KEYS))
        if "scenario" not in content:
            raise self._wrong((), "no scenario", HINT)
        grid = self._mapping(("grid",), content.get("grid") or {})
        axes = {"scenario": self._values(("scenario",), "scenario", content["scenario"])}
        for name, values in grid.items():
            axis = self._axis(name)
            axes[axis] = self._values(("grid", name), axis, values)
        seeds = self._seeds(content.get("seeds", 1))
        count = math.prod(map(len, axes.values())) * len(seeds)
        if count > MOST_RUNS:
            raise self._wrong(("grid",), f"{count} runs", f"use at most {MOST_RUNS}")
        return Plan(axes, tuple(self._jobs(axes, seeds)))

    def _jobs(self, axes: Mapping[str, tuple[Cell, ...]], seeds: tuple[int, ...]) -> Iterator[Job]:
        """Yield all runs, point by point. Raises: UsageError: a point gives no valid scenario."""
        content = cache(content_of)
        for values in itertools.product(*axes.values()):
            point = tuple(zip(axes, values, strict=True))
            try:
                scenario, attack, controller = self._at(dict(point))
            except UsageError as error:
                where = ", ".join(f"{name} {value}" for name, value in point)
                raise UsageError(f"{self._source}: at {where}: {error}", error.hint) from error
            contents = [content(name) if name and is_file(name) else "" for name in (attack, controller)]
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

    def _own(self, name: str | None) -> str | None:
        return str((self._folder / name).resolve()) if name and is_file(name) else name

    def _axis(self, name: Any) -> str:
        known = _axes()
        if name not in known:
            hint = did_you_mean(str(name), known) + "phalanx docs guides/sweeps lists them"
            raise self._wrong(("grid", name), f"a scenario has no setting {name!r}", hint)
        return str(name)

    def _values(self, path: tuple[Any, ...], name: str, given: Any) -> tuple[Cell, ...]:
        values = given if isinstance(given, list) else [given]
        text = name in (*NAMES, "defence")
        for value in values:
            if isinstance(value, bool) or not isinstance(value, str if text else int | float):
                raise self._wrong(path, f"{name} is {value!r}", "use text" if text else "use a number")
        if not values or len(set(values)) < len(values):
            raise self._wrong(path, f"{name}: {'no values' if not values else 'a value twice'}", "list each value once")
        return tuple(values)

    def _seeds(self, given: Any) -> tuple[int, ...]:
        seeds = list(range(given)) if type(given) is int and 0 <= given <= MOST_RUNS else given
        whole = isinstance(seeds, list) and all(type(seed) is int and 0 <= seed < 1 << 32 for seed in seeds)
        if not whole or not seeds or len(set(seeds)) < len(seeds):
            raise self._wrong(("seeds",), f"seeds is {given!r}", "use a count, or a list of distinct whole numbers")
        return tuple(seeds)

    def _mapping(self, path: tuple[Any, ...], content: Any) -> dict[Any, Any]:
        if not isinstance(content, dict):
            raise self._wrong(path, f"{path[-1] if path else 'the file'} is not a mapping", HINT)
        return content

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
    """Return the names of all settings that a grid can vary, except the scenario itself."""
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
