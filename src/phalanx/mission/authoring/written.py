"""A mission's YAML file, read; every complaint about it begins with the file and the line."""

from __future__ import annotations

import yaml

from phalanx.config.written import compose, line_of, named, words_of
from phalanx.errors import UsageError
from phalanx.mission.graph import Mission
from phalanx.mission.refused import Misplaced

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
            about = _about(self._root, str(error), error.place if isinstance(error, Misplaced) else ())
            where = f"{self._source}:{line_of(about)}" if about else self._source
            raise UsageError(f"{where}: {error}", error.hint) from error


def _about(root: yaml.Node | None, complaint: str, place: tuple[str | int, ...]) -> yaml.Node | None:
    """What a complaint is about: what stands at its place, or the key in there that it names; None: the whole file."""
    about, inside = None, root
    for step in place:
        if not isinstance(inside, yaml.MappingNode | yaml.SequenceNode):
            break
        parts = [part if isinstance(part, tuple) else (part, part) for part in inside.value]
        if isinstance(step, str):
            parts = [part for part in parts if isinstance(part[0], yaml.ScalarNode) and part[0].value == step]
        # A name may be there twice, as a number and as a text: it is the second that is one too many.
        nth = step if isinstance(step, int) else -1
        if not -len(parts) <= nth < len(parts):
            break
        about, inside = parts[nth]
    if about is None:  # a key of the file itself, or no key at all
        pair = named(root.value, complaint) if isinstance(root, yaml.MappingNode) else None
        return pair[0] if pair else None
    called = about.value if isinstance(about, yaml.ScalarNode) else ""
    rest = complaint.removeprefix(f"node {called}: ").removeprefix(f"node {called!r} ")
    # Not below all nodes: one may be called as what none of them has.
    deeper = None if place == ("nodes",) else _within(inside, rest, set())
    return deeper or about


def _within(node: yaml.Node | None, complaint: str, seen: set[int]) -> yaml.Node | None:
    """The key that it names, as deep as can be."""
    if id(node) in seen or node is None or isinstance(node, yaml.ScalarNode):  # a list can name itself without end
        return None
    seen.add(id(node))
    if isinstance(node, yaml.MappingNode) and (pair := named(node.value, complaint)):
        return _within(pair[1], complaint, seen) or pair[0]
    parts = (part[1] if isinstance(part, tuple) else part for part in node.value)
    return next((found for part in parts if (found := _within(part, complaint, seen))), None)
