"""Read YAML files with line numbers for error messages.

Any bytes give either YAML nodes or plain values, or a `UsageError` with file and line.
"""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from phalanx.errors import ALIKE, Unavailable, UsageError

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C loader is ten times as fast
MOST_DEPTH = 100
Pair = tuple[yaml.Node, yaml.Node]


def read_at_most(path: Path, most_bytes: int, hint: str) -> bytes:
    """Return a file's bytes. Raises: UsageError: no such file, or it is too long. Unavailable: it cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except IsADirectoryError as error:
        raise UsageError(f"{path} is a folder", hint) from error
    except FileNotFoundError as error:
        raise UsageError(f"no file {path}", file_meant(path, hint)) from error
    except OSError as error:
        raise Unavailable(f"cannot read {path}: {error.strerror}") from error
    if len(data) > most_bytes:
        raise UsageError(f"{path}: longer than {most_bytes >> 10} KiB", hint)
    return data


def file_meant(path: Path, hint: str) -> str:
    """Return a hint for a missing file: a file of a similar name in the same folder, if there is one, then `hint`."""
    with contextlib.suppress(OSError):
        beside = list(path.parent.iterdir())
        # Compare stems: with the same suffix, any two names would be similar.
        stems = difflib.get_close_matches(path.stem, {each.stem for each in beside}, len(beside) + 1, ALIKE)
        # Accept a misspelt suffix, like .ctr, but no file of another kind.
        kinds = {each.suffix for each in beside}
        if path.suffix:
            kinds = set(difflib.get_close_matches(path.suffix, kinds, len(beside) + 1, ALIKE))
        names = [each.name for each in beside if each.stem in stems and each.suffix in kinds and each.is_file()]
        near = difflib.get_close_matches(path.name, names, 1, ALIKE)
        if near and not hint.startswith("did you mean"):
            return f"did you mean {near[0]}? {hint}"
    return hint


def compose(data: bytes, source: str, hint: str) -> yaml.Node | None:
    """Parse a file into YAML nodes; None for an empty file. Raises: UsageError: it is not YAML."""
    with _yaml(data, source, hint):
        text, depth = data.decode(), 0
        for event in yaml.parse(text, _Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MOST_DEPTH:  # libyaml's composer would crash on deeply nested brackets
                raise yaml.MarkedYAMLError(problem="nested too deep", problem_mark=event.start_mark)
        node: yaml.Node | None = yaml.compose(text, _Loader)
    return node


def words_of(node: yaml.Node | None, data: bytes, source: str, hint: str) -> Any:
    """Return `compose`'s node of `data` as dicts, lists, strings and numbers; None for an empty file.

    Raises: UsageError: a key occurs twice, where PyYAML would silently use the second; or a value is invalid.
    """
    with _yaml(data, source, hint):
        return None if node is None else _UniqueKeys().construct_document(node)


def line_of(node: yaml.Node) -> int:
    """Return the line on which a node begins, from 1."""
    return int(node.start_mark.line) + 1


def named(pairs: Iterable[Pair], complaint: str) -> Pair | None:
    """Return the first pair whose key an error message names, or whose value it quotes."""
    for key, value in pairs:
        is_named = isinstance(key, yaml.ScalarNode) and re.search(rf"\b{re.escape(key.value)}\b", complaint)
        if is_named or (isinstance(value, yaml.ScalarNode) and repr(value.value) in complaint):
            return key, value
    return None


class _UniqueKeys(yaml.constructor.SafeConstructor):  # type: ignore[misc]
    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            name = self.construct_object(key, deep=True)
            if isinstance(name, str | int | float) and name in seen:
                raise yaml.MarkedYAMLError(problem=f"key {name!r} occurs twice", problem_mark=key.start_mark)
            seen.add(name if isinstance(name, str | int | float) else id(key))
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


_UniqueKeys.add_constructor(
    yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, lambda maker, node: maker.construct_mapping(node, deep=True)
)


@contextlib.contextmanager
def _yaml(data: bytes, source: str, hint: str) -> Iterator[None]:
    try:
        yield
    except UnicodeDecodeError as error:
        line = 1 + data.count(b"\n", 0, error.start)
        raise UsageError(f"{source}:{line}: not UTF-8", "save it as UTF-8") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = " ".join(str(error.problem).split())[:200]
        # libyaml reports the end of the last line as the start of another.
        line = min(mark.line + 1, len(data.splitlines())) if mark else 1
        raise UsageError(f"{source}:{line}: not YAML: {problem}", hint) from error
    except Exception as error:  # for `!!int x` or `!!timestamp x` PyYAML may raise any exception
        raise UsageError(f"{source}: not YAML", hint) from error
