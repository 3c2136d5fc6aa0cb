"""Read and write scenarios as YAML; keys are the fields of the dataclasses (config/reader.py)."""

from __future__ import annotations

import dataclasses
import difflib
from pathlib import Path
from typing import Any

from phalanx.config import BtiConfig
from phalanx.config.builtin import built_in
from phalanx.config.flock import FlockConfig
from phalanx.config.guard import GuardConfig
from phalanx.config.reader import Derived, Reader, as_written, schema_of
from phalanx.config.written import read_at_most
from phalanx.errors import ALIKE, UsageError, did_you_mean
from phalanx.robot.adversary.registry import swarm_attacks

from .attack_spec import AttackSpec
from .scenario import Scenario

MOST_BYTES = 1 << 16
HINT = "use a file that ends in .yaml, or a built-in scenario from phalanx sim list"
SCHEMA_NAME = "scenario.schema.json"
# Fields that a file cannot set: they are derived from other fields of the scenario, or from its controller (sizes).
SIZES = {"advice_bytes", "reading_bytes", "command_bytes", "state_bytes", "evidence_max_bytes", "evidence_bytes_per_s"}
DERIVED: Derived = {
    BtiConfig: frozenset({"n_max", *SIZES}),
    AttackSpec: frozenset({"own"}),
    GuardConfig: frozenset({"mission", "n_max", "state_every", "period_ms", "delta_ms", "discs", "boxes"}),
    FlockConfig: frozenset({"goal_m", "d_m", "n_max", "state_every", "discs", "boxes"}),
}


def find_scenario(name: str) -> Scenario:
    """Return a built-in scenario or the one in a file.

    Raises: UsageError: no such scenario or file, or an invalid one. Unavailable: the file cannot be read.
    """
    known = built_in("scenarios")
    if name in known:
        return parse_scenario(known[name].read_bytes(), f"{name}.yaml")
    if Path(name).suffix not in (".yaml", ".yml") and not Path(name).exists():
        hint = f"{did_you_mean(name, known)}phalanx sim list shows all; the name of a file ends in .yaml"
        raise UsageError(f"no scenario {name!r}", hint)
    return read_scenario(Path(name))


def read_scenario(path: Path) -> Scenario:
    """Return the scenario in a file.

    Raises: UsageError: no such file, or an invalid scenario. Unavailable: the file cannot be read.
    """
    return parse_scenario(read_at_most(path, MOST_BYTES, HINT), str(path))


def parse_scenario(data: bytes, source: str) -> Scenario:
    """Parse a scenario in YAML of at most 64 KiB; one without a name is named after its file, `source`.

    Raises: UsageError: the scenario is invalid.
    """
    if len(data) > MOST_BYTES:
        raise UsageError(f"{source}: longer than {MOST_BYTES >> 10} KiB", "use a scenario, a page of YAML")
    reader = Reader(source, "phalanx docs reference/scenarios has examples", DERIVED, {AttackSpec: _suggest_attack})
    scenario: Scenario = reader.root(Scenario, data, "scenario")
    return scenario if scenario.name else dataclasses.replace(scenario, name=Path(source).stem)


def scenario_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of scenario files. Source: json-schema.org."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "phalanx scenario",
        **schema_of(Scenario, DERIVED),
    }


def written_scenario(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as the content of its file, to write as JSON, which is also YAML."""
    written: dict[str, Any] = as_written(scenario, DERIVED)
    return written


def _suggest_attack(name: str) -> str:
    """Return the right form of an attack that was written as a bare name."""
    near = difflib.get_close_matches(name, swarm_attacks(), 1, ALIKE) or [name]
    return f"- name: {near[0]}"
