"""Read YAML files into dataclasses, whose fields define the keys of a file and the JSON schema for editors.

Any bytes give either a dataclass or a `UsageError` with file, line and the allowed values.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from bisect import bisect_left
from collections.abc import Callable, Mapping
from typing import Any, Literal, NoReturn, get_args, get_origin

import yaml

from phalanx.errors import UsageError, did_you_mean

from .written import compose, line_of, named

MOST_DIGITS = 40
WORDS = {int: "a whole number", float: "a number", str: "text"}
NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
WHOLE = re.compile(r"[-+]?\d+")
STRING = "tag:yaml.org,2002:str"
NULL = "tag:yaml.org,2002:null"
Derived = Mapping[type, frozenset[str]]
NOTHING_DERIVED: Derived = types.MappingProxyType({})
Keys = dict[str, dataclasses.Field[Any]]


class Reader:
    """Parser of one file: its recursion follows the types of the dataclasses, and is no deeper.

    Errors begin with `source`. Files must not contain the `derived` fields. If a file has a plain string in place of a
    dataclass, `lone` makes the hint for it.
    """

    def __init__(
        self,
        source: str,
        hint: str,
        derived: Derived = NOTHING_DERIVED,
        lone: Mapping[type, Callable[[str], str]] | None = None,
    ) -> None:
        self._source, self._hint, self._derived, self._lone = source, hint, derived, lone or {}
        self._outermost: Keys = {}

    def root(self, kind: Any, data: bytes, name: str) -> Any:
        """Parse the whole file as a `kind`. Raises: UsageError: the file does not parse."""
        node, self._outermost = compose(data, self._source, self._hint), keys_of(kind, self._derived)
        if node is None:
            raise UsageError(f"{self._source}: empty", f"allowed: {', '.join(keys_of(kind, self._derived))}")
        return self.read(kind, node, name)

    def read(self, kind: Any, node: yaml.Node, name: str) -> Any:
        """Parse `node` as a value of type `kind`; error messages call it `name`."""
        origin, arguments = get_origin(kind), get_args(kind)
        if origin in (typing.Union, types.UnionType):
            return self._read_union(arguments, node, name)
        if origin is Literal:
            if _text(node) not in arguments:
                near = did_you_mean(_text(node) or "", arguments)
                self._refuse(node, f"{name} is {_shown(node)}", f"{near}one of {', '.join(arguments)}")
            return _text(node)
        if origin is tuple:
            return self._read_list(arguments, node, name)
        if dataclasses.is_dataclass(kind):
            make_hint = self._lone.get(typing.cast("type", kind))
            if make_hint and (text := _text(node)) is not None:
                self._refuse(node, f"{name} is {_shown(node)}", make_hint(text))
            return self._read_record(kind, self._pairs(node, name), node, name)
        if kind in WORDS:
            return self._read_scalar(kind, node, name)
        assert issubclass(origin or object, Mapping), f"unsupported type {kind}"
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
            fitting = next((kind for kind in kinds if set(pairs) == set(keys_of(kind, self._derived))), None)
            if fitting is None:
                shapes = " or ".join(", ".join(keys_of(kind, self._derived)) for kind in kinds)
                self._refuse(node, f"{name} has {', '.join(pairs) or 'nothing'}", shapes)
            return self._read_record(fitting, pairs, node, name)
        assert kinds == (float, str), "the only supported union of scalars"
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
        keys = keys_of(kind, self._derived)
        for key, (key_node, _) in pairs.items():
            if key in self._derived.get(kind, ()) and key in self._outermost:
                self._refuse(key_node, f"{name} has no {key!r}", f"write {key} beside {name}, not below it")
            if key not in keys:
                self._refuse(key_node, f"{name} has no {key!r}", f"{did_you_mean(key, keys)}allowed: {', '.join(keys)}")
        for key, field in keys.items():
            if key not in pairs and not _has_default(field):
                self._refuse(node, f"{name} has no {key}", f"needed: {', '.join(needed_of(kind, self._derived))}")
        hints = typing.get_type_hints(kind)
        values = {key: self.read(hints[key], value, key) for key, (_, value) in pairs.items()}
        try:
            return kind(**values)
        except UsageError as error:
            self._refuse(_culprit(keys, kind, values, pairs, str(error)) or node, str(error), error.hint)

    def _pairs(self, node: yaml.Node, name: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Return the nodes of the key and of the value for each key."""
        if not isinstance(node, yaml.MappingNode):
            self._refuse(node, f"{name} is {_shown(node)}", "write lines of KEY: VALUE")
        pairs: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key_node, value_node in node.value:
            key = _text(key_node)
            if key is None:
                self._refuse(key_node, f"{_shown(key_node)} in {name} is not a key", "use text as a key")
            if key in pairs:
                self._refuse(key_node, f"{name} has {key!r} twice", f"first in line {line_of(pairs[key][0])}")
            pairs[key] = key_node, value_node
        return pairs

    def _refuse(self, node: yaml.Node, what: str, allowed: str) -> NoReturn:
        raise UsageError(f"{self._source}:{line_of(node)}: {what}", allowed)


def _culprit(
    fields: Keys, kind: Any, values: dict[str, Any], pairs: dict[str, tuple[yaml.Node, yaml.Node]], complaint: str
) -> yaml.Node | None:
    """Return the node that caused an error of the whole record; None if unknown."""

    def is_repeated(trial: dict[str, Any]) -> bool:
        try:
            kind(**trial)
        except UsageError as error:
            return str(error) == complaint
        return False

    # Try in turn: the first list item that causes the error, a key that it names, a key without which it vanishes.
    for key, (_, node) in pairs.items():
        items = values[key]
        if isinstance(items, tuple) and dataclasses.is_dataclass(next(iter(items), None)):
            lengths = range(len(items) + 1)
            shortest = bisect_left(lengths, True, key=lambda n: is_repeated(values | {key: items[:n]}))
            if shortest > 0:
                item = node.value[shortest - 1]
                pair = named(item.value, complaint)
                return pair[0] if pair else item
    others = {key: {name: value for name, value in values.items() if name != key} for key in pairs}
    needed = {
        key: pairs[key][0] for key in reversed(pairs) if _has_default(fields[key]) and not is_repeated(others[key])
    }
    pair = named(pairs.values(), complaint)
    return pair[0] if pair else next(iter(needed.values()), None)


def _text(node: yaml.Node) -> str | None:
    return str(node.value) if isinstance(node, yaml.ScalarNode) and node.tag == STRING else None


def _shown(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return repr(node.value if len(node.value) <= MOST_DIGITS else node.value[:MOST_DIGITS] + "…")
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def keys_of(kind: Any, derived: Derived) -> Keys:
    """Return the fields of a dataclass that a file may contain."""
    hidden = derived.get(kind, frozenset())
    return {field.name: field for field in dataclasses.fields(kind) if field.name not in hidden}


def _has_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING


def needed_of(kind: Any, derived: Derived) -> list[str]:
    """Return the keys that a file must contain: fields without a default."""
    return [key for key, field in keys_of(kind, derived).items() if not _has_default(field)]


def schema_of(kind: Any, derived: Derived = NOTHING_DERIVED) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a dataclass or another type in a file. Source: json-schema.org."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind in WORDS:
        return {"type": {int: "integer", float: "number", str: "string"}[kind]}
    if kind is type(None):
        return {"type": "null"}
    if origin in (typing.Union, types.UnionType):
        return {"anyOf": [schema_of(one, derived) for one in arguments]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin is tuple and arguments[-1] is Ellipsis:
        return {"type": "array", "items": schema_of(arguments[0], derived)}
    if origin is tuple:
        n = len(arguments)
        return {"type": "array", "items": schema_of(arguments[0], derived), "minItems": n, "maxItems": n}
    if not dataclasses.is_dataclass(kind):
        return {"type": "object", "additionalProperties": schema_of(arguments[1], derived)}
    hints = typing.get_type_hints(kind)
    properties = {}
    for key, field in keys_of(kind, derived).items():
        text = field.metadata.get("description")
        properties[key] = schema_of(hints[key], derived) | ({"description": f"{text}."} if text else {})
        if isinstance(field.default, int | float | str):
            properties[key]["default"] = field.default
    required = needed_of(kind, derived)
    return {"type": "object", "properties": properties, "additionalProperties": False} | (
        {"required": required} if required else {}
    )


def as_written(value: Any, derived: Derived = NOTHING_DERIVED) -> Any:
    """Return a value as plain dicts, lists, strings and numbers for YAML, without fields that have their default."""
    if dataclasses.is_dataclass(value):
        values = {key: (getattr(value, key), field) for key, field in keys_of(type(value), derived).items()}
        changed = {key: each for key, (each, field) in values.items() if each != field.default}
        written = {key: as_written(each, derived) for key, each in changed.items()}
        return {key: each for key, each in written.items() if each not in ({}, [])}
    if isinstance(value, Mapping):
        return {key: as_written(each, derived) for key, each in value.items()}
    return [as_written(each, derived) for each in value] if isinstance(value, tuple) else value
