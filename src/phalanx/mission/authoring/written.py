"""A mission's YAML file, read; every complaint about it begins with the file and the line."""

from __future__ import annotations

import re
from collections.abc import Iterator

import yaml

from phalanx.config.written import Pair, compose, line_of, named, words_of
from phalanx.errors import UsageError
from phalanx.mission.graph import Mission

from .document import plain_mission

HINT = "docs/spec/mission.md shows a mission"


class WrittenMission:
    """What a file says, and where.

    Raises: UsageError: it is not YAML.
    """

    def __init__(self, data: bytes, source: str) -> None:
        self._source = source
        self._root = compose(data, source, HINT)
        self.words = words_of(self._root, data, source, HINT)

    def mission(self) -> Mission:
        """The mission that it describes. Raises: UsageError: it describes none."""
        try:
            return plain_mission(self.words)
        except UsageError as error:
            line = line_of(_about(self._root, str(error))) if self._root else 1
            raise UsageError(f"{self._source}:{line}: {error}", error.hint) from error


def _about(root: yaml.Node, complaint: str) -> yaml.Node:
    """What a complaint of document.py or graph.py is about: the key or the item that it names, as deep as it can be."""
    about, inside = _named_by(root, complaint) or (root, root)
    return _within(inside, complaint, set()) or about


def _within(node: yaml.Node, complaint: str, seen: set[int]) -> yaml.Node | None:
    if id(node) in seen or isinstance(node, yaml.ScalarNode):  # in a few lines a list can name itself without end
        return None
    seen.add(id(node))
    if isinstance(node, yaml.MappingNode) and (pair := named(node.value, complaint)):
        return _within(pair[1], complaint, seen) or pair[0]
    parts = (part[1] if isinstance(part, tuple) else part for part in node.value)
    return next((found for part in parts if (found := _within(part, complaint, seen))), None)


def _named_by(root: yaml.Node, complaint: str) -> Pair | None:
    """The way or the node that a complaint names, as a key and a value."""
    parts = {key.value: value for key, value in root.value} if isinstance(root, yaml.MappingNode) else {}
    ways = parts["ways"].value if isinstance(parts.get("ways"), yaml.SequenceNode) else []
    nodes = parts["nodes"].value if isinstance(parts.get("nodes"), yaml.MappingNode) else []
    if (number := re.match(r"way (\d+)\b", complaint)) and int(number[1]) <= len(ways):
        return ways[int(number[1]) - 1], ways[int(number[1]) - 1]
    if re.search(r"\bways?\b", complaint):
        quoted = set(re.findall(r"'([^']*)'", complaint))
        for way in reversed(ways):
            if quoted and quoted <= set(_texts(way, 3)):
                return way, way
    said = (rf"\bnode {re.escape(str(key.value))}\b|{re.escape(repr(key.value))}" for key, _ in nodes)
    return next((pair for pair, it in zip(nodes, said, strict=True) if re.search(it, complaint)), None)


def _texts(node: yaml.Node, depth: int) -> Iterator[str]:
    """What is written in a way: its ends, however they are told."""
    if isinstance(node, yaml.ScalarNode):
        yield node.value
    elif depth:
        for each in node.value:
            for part in each if isinstance(each, tuple) else (each,):
                yield from _texts(part, depth - 1)
