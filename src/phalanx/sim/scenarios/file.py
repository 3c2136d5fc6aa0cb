"""Scenarios as YAML: what a file may say is what the dataclasses say, and so is the schema that editors read.

Only this file reads YAML. Whatever the bytes are, the answer is a scenario or a `UsageError` with file, line and what
is allowed there.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from bisect import bisect_left
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NoReturn, get_args, get_origin

import yaml

from phalanx.config import BtiConfig
from phalanx.config.flock import FlockConfig
from phalanx.config.guard import GuardConfig
from phalanx.config.written import compose, line_of, named
from phalanx.errors import ALIKE, Unavailable, UsageError, did_you_mean
from phalanx.robot.attacks.library import IN_FLOCKS
from phalanx.sim.builtin import built_in

from .scenario import AttackSpec, Scenario

MOST_BYTES = 1 << 16
MOST_DIGITS = 40
SCHEMA_NAME = "scenario.schema.json"
# A scenario says these once, for all that need them; the sizes are the controller's.
SIZES = {"advice_bytes", "reading_bytes", "command_bytes", "state_bytes", "evidence_max_bytes", "evidence_bytes_per_s"}
DERIVED: Mapping[type, frozenset[str]] = {
    BtiConfig: frozenset({"n_max", *SIZES}),
    AttackSpec: frozenset({"own"}),
    GuardConfig: frozenset({"n_max", "state_every", "period_ms", "delta_ms", "discs", "boxes"}),
    FlockConfig: frozenset({"goal_m", "d_m", "n_max", "state_every", "discs", "boxes"}),
}
WORDS = {int: "a whole number", float: "a number", str: "text"}
NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
WHOLE = re.compile(r"[-+]?\d+")
STRING = "tag:yaml.org,2002:str"
NULL = "tag:yaml.org,2002:null"


def find_scenario(name: str) -> Scenario:
    """The built-in scenario of that name, or the one in the file of that name.

    Raises: UsageError: there is neither, or the file is not a scenario. Unavailable: it cannot be read.
    """
    known = built_in("scenarios")
    if name in known:
        return parse_scenario(known[name].read_bytes(), f"{name}.yaml")
    if Path(name).suffix not in (".yaml", ".yml") and not Path(name).exists():
        hint = f"{did_you_mean(name, known)}phalanx sim list shows them; a file ends in .yaml"
        raise UsageError(f"no scenario {name!r}", hint)
    return read_scenario(Path(name))


def read_scenario(path: Path) -> Scenario:
    """The scenario in a file. Raises: UsageError: no such file, or not a scenario. Unavailable: it cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise UsageError(f"no file {path}", "phalanx sim list shows the built-in scenarios") from error
    except IsADirectoryError as error:
        raise UsageError(f"{path} is a folder", "a file ends in .yaml; phalanx sim list shows built-in ones") from error
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}") from error
    return parse_scenario(data, str(path))


def parse_scenario(data: bytes, source: str) -> Scenario:
    """The scenario that `data` spells; without a name it is called as its file.

    Args:
        data: YAML, UTF-8, at most 64 KiB.
        source: the file's name, for errors.
    Raises: UsageError: it is not a scenario.
    """
    if len(data) > MOST_BYTES:
        raise UsageError(f"{source}: longer than {MOST_BYTES >> 10} KiB", "a scenario is a page of YAML")
    reader = _Reader(source)
    root = reader.compose(data)
    scenario: Scenario = reader.read(Scenario, root, "scenario")
    return scenario if scenario.name else dataclasses.replace(scenario, name=Path(source).stem)


def scenario_schema() -> dict[str, Any]:
    """A JSON schema (draft 2020-12) of scenario files. Source: json-schema.org."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "phalanx scenario",
        **_schema(Scenario),
    }


class _Reader:
    """Walks the nodes of one file along the types of the dataclasses, so that its depth is theirs."""

    def __init__(self, source: str) -> None:
        self._source = source

    def compose(self, data: bytes) -> yaml.Node:
        node = compose(data, self._source, "docs/scenarios.md has examples")
        if node is None:
            raise UsageError(f"{self._source}: empty", f"allowed: {', '.join(_keys(Scenario))}")
        return node

    def read(self, kind: Any, node: yaml.Node, name: str) -> Any:
        """What `node` says as a value of type `kind`; `name` is what people call it."""
        origin, arguments = get_origin(kind), get_args(kind)
        if origin in (typing.Union, types.UnionType):
            return self._read_union(arguments, node, name)
        if origin is Literal:
            if _text(node) not in arguments:
                self._refuse(node, f"{name} is {_shown(node)}", f"one of {', '.join(arguments)}")
            return _text(node)
        if origin is tuple:
            return self._read_list(arguments, node, name)
        if dataclasses.is_dataclass(kind):
            if kind is AttackSpec and (word := _text(node)) is not None:
                near = difflib.get_close_matches(word, IN_FLOCKS, 1, ALIKE) or [word]
                self._refuse(node, f"{name} is {_shown(node)}", f"- name: {near[0]}")
            return self._read_record(kind, self._pairs(node, name), node, name)
        if kind in WORDS:
            return self._read_scalar(kind, node, name)
        assert issubclass(origin or object, Mapping), f"no file says a {kind}"
        pairs = self._pairs(node, name)
        return {key: self.read(arguments[1], value, key) for key, (_, value) in pairs.items()}

    def _read_scalar(self, kind: Any, node: yaml.Node, name: str) -> Any:
        plain = isinstance(node, yaml.ScalarNode) and not node.style and len(node.value) <= MOST_DIGITS
        if kind is int and plain and WHOLE.fullmatch(node.value):
            return int(node.value)
        if kind is float and plain and NUMBER.fullmatch(node.value):
            return float(node.value)
        if kind is not str or _text(node) is None:
            self._refuse(node, f"{name} is {_shown(node)}", WORDS[kind])
        return node.value

    def _read_union(self, kinds: tuple[Any, ...], node: yaml.Node, name: str) -> Any:
        if node.tag == NULL and type(None) in kinds:
            return None
        kinds = tuple(kind for kind in kinds if kind is not type(None))
        if len(kinds) == 1:
            return self.read(kinds[0], node, name)
        if all(dataclasses.is_dataclass(kind) for kind in kinds):
            pairs = self._pairs(node, name)
            fitting = next((kind for kind in kinds if set(pairs) == set(_keys(kind))), None)
            if fitting is None:
                shapes = " or ".join(", ".join(_keys(kind)) for kind in kinds)
                self._refuse(node, f"{name} has {', '.join(pairs) or 'nothing'}", shapes)
            return self._read_record(fitting, pairs, node, name)
        assert kinds == (float, str), "the only choice of scalars there is"
        if isinstance(node, yaml.ScalarNode) and not node.style and NUMBER.fullmatch(node.value):
            return self.read(float, node, name)
        if _text(node) is None:
            self._refuse(node, f"{name} is {_shown(node)}", "a number or text")
        return node.value

    def _read_list(self, kinds: tuple[Any, ...], node: yaml.Node, name: str) -> tuple[Any, ...]:
        if kinds[-1] is Ellipsis:
            if not isinstance(node, yaml.SequenceNode):
                self._refuse(node, f"{name} is {_shown(node)}", "a list")
            return tuple(self.read(kinds[0], entry, f"{name}[{k}]") for k, entry in enumerate(node.value))
        if not isinstance(node, yaml.SequenceNode) or len(node.value) != len(kinds):
            self._refuse(node, f"{name} is {_shown(node)}", f"a list of {len(kinds)} numbers")
        return tuple(self.read(kind, entry, name) for kind, entry in zip(kinds, node.value, strict=True))

    def _read_record(self, kind: Any, pairs: dict[str, tuple[yaml.Node, yaml.Node]], node: yaml.Node, name: str) -> Any:
        keys = _keys(kind)
        for key, (key_node, _) in pairs.items():
            if key not in keys:
                self._refuse(key_node, f"{name} has no {key!r}", f"{did_you_mean(key, keys)}allowed: {', '.join(keys)}")
        for key, field in keys.items():
            if key not in pairs and not _has_default(field):
                self._refuse(node, f"{name} has no {key}", f"needed: {', '.join(_needed(kind))}")
        hints = typing.get_type_hints(kind)
        values = {key: self.read(hints[key], value, key) for key, (_, value) in pairs.items()}
        try:
            return kind(**values)
        except UsageError as error:
            self._refuse(_culprit(kind, values, pairs, str(error)) or node, str(error), error.hint)

    def _pairs(self, node: yaml.Node, name: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Key to its node and its value's."""
        if not isinstance(node, yaml.MappingNode):
            self._refuse(node, f"{name} is {_shown(node)}", "lines of KEY: VALUE")
        pairs: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key_node, value_node in node.value:
            key = _text(key_node)
            if key is None:
                self._refuse(key_node, f"{_shown(key_node)} in {name} is not a key", "a word")
            if key in pairs:
                self._refuse(key_node, f"{name} has {key!r} twice", f"first in line {line_of(pairs[key][0])}")
            pairs[key] = key_node, value_node
        return pairs

    def _refuse(self, node: yaml.Node, what: str, allowed: str) -> NoReturn:
        raise UsageError(f"{self._source}:{line_of(node)}: {what}", allowed)


def _culprit(
    kind: Any, values: dict[str, Any], pairs: dict[str, tuple[yaml.Node, yaml.Node]], complaint: str
) -> yaml.Node | None:
    """What a complaint about a whole record is about; None if that cannot be told."""

    def still(said: dict[str, Any]) -> bool:
        try:
            kind(**said)
        except UsageError as error:
            return str(error) == complaint
        return False

    # The first item of a list with which it is said, then the key that it names, then one without which it is not said.
    for key, (_, node) in pairs.items():
        items = values[key]
        if isinstance(items, tuple) and dataclasses.is_dataclass(next(iter(items), None)):
            lengths = range(len(items) + 1)
            shortest = bisect_left(lengths, True, key=lambda n: still(values | {key: items[:n]}))
            if shortest > 0:
                item = node.value[shortest - 1]
                pair = named(item.value, complaint)
                return pair[0] if pair else item
    fields = _keys(kind)
    others = {key: {name: value for name, value in values.items() if name != key} for key in pairs}
    needed = {key: pairs[key][0] for key in reversed(pairs) if _has_default(fields[key]) and not still(others[key])}
    pair = named(pairs.values(), complaint)
    return pair[0] if pair else next(iter(needed.values()), None)


def _text(node: yaml.Node) -> str | None:
    return str(node.value) if isinstance(node, yaml.ScalarNode) and node.tag == STRING else None


def _shown(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return repr(node.value if len(node.value) <= MOST_DIGITS else node.value[:MOST_DIGITS] + "…")
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def _keys(kind: Any) -> dict[str, dataclasses.Field[Any]]:
    derived = DERIVED.get(kind, frozenset())
    return {field.name: field for field in dataclasses.fields(kind) if field.name not in derived}


def _has_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING


def _needed(kind: Any) -> list[str]:
    return [key for key, field in _keys(kind).items() if not _has_default(field)]


def _schema(kind: Any) -> dict[str, Any]:
    origin, arguments = get_origin(kind), get_args(kind)
    if kind in WORDS:
        return {"type": {int: "integer", float: "number", str: "string"}[kind]}
    if kind is type(None):
        return {"type": "null"}
    if origin in (typing.Union, types.UnionType):
        return {"anyOf": [_schema(one) for one in arguments]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin is tuple and arguments[-1] is Ellipsis:
        return {"type": "array", "items": _schema(arguments[0])}
    if origin is tuple:
        return {"type": "array", "items": _schema(arguments[0]), "minItems": len(arguments), "maxItems": len(arguments)}
    if not dataclasses.is_dataclass(kind):
        return {"type": "object", "additionalProperties": _schema(arguments[1])}
    hints = typing.get_type_hints(kind)
    properties = {}
    for key, field in _keys(kind).items():
        words = field.metadata.get("told")
        properties[key] = _schema(hints[key]) | ({"description": f"{words}."} if words else {})
        if isinstance(field.default, int | float | str):
            properties[key]["default"] = field.default
    required = _needed(kind)
    return {"type": "object", "properties": properties, "additionalProperties": False} | (
        {"required": required} if required else {}
    )
