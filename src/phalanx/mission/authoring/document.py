"""Read a mission from a YAML file and write it; error messages begin with the file and the line.

docs/spec/mission.md lists the keys of the file.
"""

from __future__ import annotations

import math
import re
import reprlib
from dataclasses import asdict
from itertools import pairwise
from typing import Any

import yaml

from phalanx.config.mission import CodingConfig
from phalanx.config.written import compose, line_of, named, words_of
from phalanx.errors import UsageError, did_you_mean
from phalanx.mission.graph import Draft, Mission, Node
from phalanx.mission.observable import LANDMARK_TYPES, Action, Landmark, Observable, Position, Sensor, Time
from phalanx.mission.refused import Misplaced, under

HINT = "phalanx docs spec/mission shows a mission"
TOP = {"mission", "map", "area", "roam", "repeatable", "coding", "nodes", "ways"}
NODE = {"see", "do", "start", "final", "join", "chained", "within_m", "timeout_s", "send", "wait", "part", "width"}
SEE = {*LANDMARK_TYPES, "position", "sensor", "action", "time", "facing", "area", "text", "token"}
WAY = {"from", "to", "both", "direction", "do"}
# Default of within_m for nodes that act: a robot gets this near to a landmark in a wall, and does not see a doorway
# while it stands in it.
AT_NODE_M = 1.0
_BRIEF = reprlib.Repr()
_BRIEF.maxlevel = 1  # YAML aliases can make endlessly nested lists
DIGITS = 9  # decimal places of written numbers
TOKEN = re.compile(r"[0-9a-f]{32,200}")  # at least 128 random bits


class WrittenMission:
    """A parsed YAML file with line numbers. Raises: UsageError: it is not YAML."""

    def __init__(self, data: bytes, source: str) -> None:
        self._source = source
        self._root = compose(data, source, HINT)
        self.words = words_of(self._root, data, source, HINT)

    def mission(self) -> Mission:
        """Return the mission in the file. Raises: UsageError: the mission is invalid."""
        try:
            return plain_mission(self.words)
        except UsageError as error:
            about = _about(self._root, str(error), error.place if isinstance(error, Misplaced) else ())
            where = f"{self._source}:{line_of(about)}" if about else self._source
            raise UsageError(f"{where}: {error}", error.hint) from error


def _about(root: yaml.Node | None, complaint: str, place: tuple[str | int, ...]) -> yaml.Node | None:
    """Find the YAML node that an error concerns: the value at its path, or a key named in its text; None if none."""
    about, inside = None, root
    for step in place:
        if not isinstance(inside, yaml.MappingNode | yaml.SequenceNode):
            break
        parts = [part if isinstance(part, tuple) else (part, part) for part in inside.value]
        if isinstance(step, str):
            parts = [part for part in parts if isinstance(part[0], yaml.ScalarNode) and part[0].value == step]
        # A key may occur twice, as a number and as a text: the error concerns the second.
        nth = step if isinstance(step, int) else -1
        if not -len(parts) <= nth < len(parts):
            break
        about, inside = parts[nth]
    if about is None:  # a top-level key, or no key at all
        pair = named(root.value, complaint) if isinstance(root, yaml.MappingNode) else None
        return pair[0] if pair else None
    called = about.value if isinstance(about, yaml.ScalarNode) else ""
    rest = complaint.removeprefix(f"node {called}: ").removeprefix(f"node {called!r} ")
    # Do not search below all nodes: one of them may have the name in the message.
    deeper = None if place == ("nodes",) else _within(inside, rest, set())
    return deeper or about


def _within(node: yaml.Node | None, complaint: str, seen: set[int]) -> yaml.Node | None:
    """Return the deepest key below a node that the text of an error names, or None."""
    if id(node) in seen or node is None or isinstance(node, yaml.ScalarNode):  # lists may contain themselves
        return None
    seen.add(id(node))
    if isinstance(node, yaml.MappingNode) and (pair := named(node.value, complaint)):
        return _within(pair[1], complaint, seen) or pair[0]
    parts = (part[1] if isinstance(part, tuple) else part for part in node.value)
    return next((found for part in parts if (found := _within(part, complaint, seen))), None)


def plain_mission(content: Any) -> Mission:
    """Return the mission described by the content of a YAML file.

    Raises: UsageError: a value is missing, unknown or of the wrong type; the message has its place.
    """
    top = _mapping(content, "the file", TOP)
    area = None if "area" not in top else _numbers(top["area"], "area", 4)
    with under("coding"):
        coding = _coding(top["coding"]) if "coding" in top else None
    draft = Draft(
        _text(top.get("mission"), "mission"),
        coding=coding,
        area_m=None if area is None else (area[0], area[1], area[2], area[3]),
        roam=_flag(top, "roam", "the file"),
        repeatable=_flag(top, "repeatable", "the file"),
        floor_plan=_text(top["map"], "map") if "map" in top else "",
    )
    for i, (name, node) in enumerate(_mapping(top.get("nodes"), "nodes", None).items()):
        with under("nodes", i):
            _node(draft, _name(name, "nodes"), _mapping(node, f"node {name}", NODE))
    written: list[int] = []  # for each way of the draft, the index of its entry in the file
    for i, way in enumerate(_list(top.get("ways", []), "ways")):
        with under("ways", i):
            _way(draft, way, f"way {i + 1}")
        written += [i] * (len(draft.ways) - len(written))
    try:
        return draft.mission()
    except Misplaced as error:
        if error.place[0] == "ways" and isinstance(error.place[1], int):
            error.place = ("ways", written[error.place[1]])
        raise


def mission_to_yaml(mission: Mission) -> dict[str, Any]:
    """Return the content of a YAML file for a mission, as `plain_mission` reads it."""
    ways = {(way.source, way.target): way for way in mission.ways}
    entries: dict[tuple[str, str], dict[str, Any]] = {}
    for (source, target), way in ways.items():
        back = ways.get((target, source))
        alike = back is not None and back.do == way.do and back.direction_rad is way.direction_rad is None
        if alike and (target, source) in entries:
            entries[target, source]["both"] = True
            continue
        entries[source, target] = {"from": source, "to": target, **_given(direction=way.direction_rad, do=way.do)}
    return {
        "mission": mission.name,
        **_given(map=mission.floor_plan, roam=mission.roam, repeatable=mission.repeatable),
        **_given(area=mission.area_m and list(mission.area_m), coding=mission.coding and asdict(mission.coding)),
        "nodes": {node.name: _words_of(node) for node in mission.nodes},
        "ways": list(entries.values()),
    }


def alias_to_yaml(alias: tuple[Observable, ...], digits: int = DIGITS) -> dict[str, Any]:
    """Return the content under `see` for an alias; numbers are rounded to `digits` decimal places."""
    content: dict[str, Any] = {}
    for thing in alias:
        if isinstance(thing, Landmark):
            area = None if thing.area_m2 is None else round(thing.area_m2, digits)
            content |= {thing.type: [round(thing.x_m, digits), round(thing.y_m, digits)]}
            content |= _given(digits, facing=thing.orientation_rad, area=area, text=thing.text)
        elif isinstance(thing, Position):
            content["position"] = [round(thing.x_m, digits), round(thing.y_m, digits)]
        elif isinstance(thing, Sensor):
            content.setdefault("sensor", []).append(thing.value.decode(errors="replace"))
        elif isinstance(thing, Action):
            content |= _given(action=thing)
        elif isinstance(thing, Time):
            content["time"] = thing.t_s
    return content


def _words_of(node: Node) -> dict[str, Any]:
    see = [alias_to_yaml(alias) for alias in node.see]
    flags = _given(start=node.start, final=node.final, join=node.join, chained=node.chained)
    limits = {"within_m": node.within_m, **_given(timeout_s=node.timeout_s, width=node.width_m, part=node.part)}
    return {**flags, "see": see, **_given(do=node.do, send=list(node.send), wait=list(node.wait)), **limits}


def _given(digits: int = DIGITS, /, **content: Any) -> dict[str, Any]:
    """Return the values that are set, with actions and angles in the form of the file."""
    given: dict[str, Any] = {}
    for name, value in content.items():
        if isinstance(value, Action):
            given[name] = {value.name: dict(value.args)}
        elif name in ("direction", "facing") and value is not None:
            given[name] = round(math.degrees(value), digits)
        elif value:
            given[name] = value
    return given


def _coding(content: Any) -> CodingConfig:
    known = set(CodingConfig.__dataclass_fields__)
    values = _mapping(content, "coding", known)
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int):
            raise UsageError(f"coding: {key} is {value!r}", "use a whole number")
    return CodingConfig(**values)


def _node(draft: Draft, name: str, content: dict[str, Any]) -> None:
    where = f"node {name}"
    # An action takes place at the node, not where its landmark comes in sight. But start nodes count from anywhere, and
    # a robot that waits for a message must still see the landmark when it arrives.
    acts = content.keys() & {"do", "send"} or content.get("final")
    within_m = AT_NODE_M if acts and not (content.get("start") or content.get("wait")) else 0.0
    see = content.get("see", [])
    aliases = [_alias(alias, where) for alias in (see if isinstance(see, list) else [see])]
    with under("do"):
        do = _action(content["do"], where) if "do" in content else None
    draft.node(
        name,
        *aliases,
        do=do,
        start=_flag(content, "start", where),
        final=_flag(content, "final", where),
        join=_flag(content, "join", where),
        chained=_flag(content, "chained", where),
        within_m=_number(content.get("within_m", within_m), f"{where}: within_m"),
        timeout_s=_whole_up(_number(content.get("timeout_s", 0), f"{where}: timeout_s")),
        send=_names(content.get("send", []), f"{where}: send"),
        wait=_names(content.get("wait", []), f"{where}: wait"),
        part=_text(content.get("part", ""), f"{where}: part"),
        width_m=_number(content["width"], f"{where}: width") if "width" in content else None,
    )


def _alias(content: Any, where: str) -> tuple[Observable, ...]:
    if isinstance(content, dict) and "corner_concave" in content:
        raise UsageError(
            f"{where}: corner_concave does not tell the end of its wall",
            "use concave_left or concave_right, as seen when facing the wall",
        )
    given = _mapping(content, f"{where}: see", SEE)
    out: list[Observable] = []
    kinds = [kind for kind in LANDMARK_TYPES if kind in given]
    if len(kinds) > 1:
        raise UsageError(f"{where}: see has {' and '.join(kinds)}", "use one landmark, or a list of alternatives")
    if kinds:
        x, y = _numbers(given[kinds[0]], f"{where}: {kinds[0]}", 2)
        out.append(
            Landmark(
                kinds[0],
                x,
                y,
                math.radians(_number(given["facing"], f"{where}: facing")) if "facing" in given else None,
                _number(given["area"], f"{where}: area") if "area" in given else None,
                _qr_text(given, where),
            )
        )
    elif given.keys() & {"facing", "area", "text", "token"}:
        hint = "add a landmark, as in see: {doorway: [x, y], ...}"
        raise UsageError(f"{where}: facing, area, text and token belong to a landmark", hint)
    if "position" in given:
        out.append(Position(*_numbers(given["position"], f"{where}: position", 2)))
    readings = given.get("sensor", [])
    values = readings if isinstance(readings, list) else [readings]
    out += [Sensor(_text(value, f"{where}: sensor").encode()) for value in values]
    if "action" in given:
        out.append(_action(given["action"], where))
    if "time" in given:
        out.append(Time(_number(given["time"], f"{where}: time")))
    return tuple(out)


def _qr_text(given: dict[str, Any], where: str) -> str | None:
    if "token" not in given:
        return _text(given["text"], f"{where}: text") if "text" in given else None
    token = _text(given["token"], f"{where}: token")
    if "text" in given or not TOKEN.fullmatch(token):
        raise UsageError(f"{where}: token is not a random token", "use at least 32 hex digits, and no text beside it")
    return token


def _way(draft: Draft, content: Any, where: str) -> None:
    if isinstance(content, list):
        names = [_text(name, where) for name in content]
        if len(names) < 2:
            raise UsageError(f"{where} has {len(names)} ends", "use [a, b], or [a, b, c] for several ways in a row")
        for source, target in pairwise(names):
            draft.way(source, target, both=True)
        return
    given = _mapping(content, where, WAY)
    direction = math.radians(_number(given["direction"], f"{where}: direction")) if "direction" in given else None
    targets = given.get("to")
    for end in targets if isinstance(targets, list) else [targets]:
        draft.way(
            _text(given.get("from"), f"{where}: from"),
            _text(end, f"{where}: to"),
            both=_flag(given, "both", where),
            direction_rad=direction,
            do=_action(given["do"], where) if "do" in given else None,
        )


def _action(content: Any, where: str) -> Action:
    if isinstance(content, str):
        return Action(content)
    given = _mapping(content, f"{where}: action", None)
    if len(given) != 1:
        raise UsageError(f"{where}: not an action", "use a name, or a name with arguments: {pick: {shelf: 3}}")
    name, args = next(iter(given.items()))
    values = _mapping(args or {}, f"{where}: {name}", None)
    names = {key: _name(key, f"{where}: {name}") for key in values}
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise UsageError(f"{where}: {name}: {key} is {value!r}", "use a number or a text")
    return Action(_name(name, where), tuple(sorted((names[key], value) for key, value in values.items())))


def _name(word: Any, where: str) -> str:
    """Return a name used as a key; reject one that YAML reads as another type, which would be encoded differently."""
    if isinstance(word, bool) or not isinstance(word, str | int):
        raise UsageError(
            f"{where}: a name is read as {_shown(word)}", 'put it in quotes, as "on", "off", "yes" and "no"'
        )
    return str(word)


def _mapping(content: Any, where: str, known: set[str] | None) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise UsageError(f"{where} is {_shown(content)}", "use a mapping: names with a colon")
    for key in content:
        if known is not None and key not in known:
            hint = f"{did_you_mean(str(key), known)}use one of {', '.join(sorted(known))}"
            raise UsageError(f"{where} has the unknown key {key!r}", hint)
    return content


def _list(content: Any, where: str) -> list[Any]:
    if not isinstance(content, list):
        raise UsageError(f"{where} is {_shown(content)}", "use a list")
    return content


def _text(content: Any, where: str) -> str:
    if isinstance(content, bool) or not isinstance(content, str | int):
        raise UsageError(f"{where} is {_shown(content)}", "use a text")
    return str(content)


def _number(content: Any, where: str) -> float:
    if isinstance(content, bool) or not isinstance(content, int | float) or not abs(content) < 1e12:
        raise UsageError(f"{where} is {_shown(content)}", "use a number")
    return float(content)


def _whole_up(number: float) -> int:
    """Round away from 0, so that half a second does not become 0, the robot's default, and -0.5 stays negative."""
    return int(math.copysign(math.ceil(abs(number)), number))


def _numbers(content: Any, where: str, count: int) -> list[float]:
    numbers = [_number(value, where) for value in _list(content, where)]
    if len(numbers) != count:
        raise UsageError(f"{where} has {len(numbers)} numbers", f"use {count}, in metres")
    return numbers


def _flag(content: dict[str, Any], key: str, where: str) -> bool:
    value = content.get(key, False)
    if not isinstance(value, bool):
        raise UsageError(f"{where}: {key} is {_shown(value)}", "use true or false")
    return value


def _names(content: Any, where: str) -> tuple[str, ...]:
    return tuple(_text(value, where) for value in (content if isinstance(content, list) else [content]))


def _shown(content: Any) -> str:
    return "missing" if content is None else _BRIEF.repr(content)
