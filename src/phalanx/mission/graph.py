"""A mission as an operator writes it, before it is encoded.

Nodes are states, ways lead from one node to the next. `Draft` is the API to write missions in Python; YAML files (see
`authoring`) are read with the same calls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from graphlib import CycleError, TopologicalSorter
from typing import Any

from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError

from .file.canonical import action_bytes, shape_of
from .observable import VALUE_MAX, Action, Landmark, Observable, Position
from .refused import Misplaced, under

NODE_LIMIT = 1 << 20
ALIAS_LIMIT = 255
WAY_LIMIT = 4096  # out of one node
REACH_LIMIT_M = 25.5
TIMEOUT_LIMIT_S = 65_535
SEND_LIMIT = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A state of a mission, entered by observing one of its aliases."""

    name: str  # for display; in the encrypted payload of the sealed profile, absent from the paper profile
    # Aliases, each a conjunction of observables; one of them is enough
    see: tuple[tuple[Observable, ...], ...]
    do: Action | None = None
    start: bool = False
    final: bool = False
    join: bool = False  # all predecessors must be decoded first
    chained: bool = False  # the hash of the previous node is part of the conjunction (sealed nodes always depend on it)
    within_m: float = 0.0  # largest distance to the landmark; 0 is any (YAML files: 1 m by default for nodes that act)
    timeout_s: int = 0  # time for the next node, before the robot goes back; 0 is the robot's default
    send: tuple[str, ...] = ()  # names of messages released here
    wait: tuple[str, ...] = ()  # names of messages that are part of the conjunction
    part: str = ""  # name of the part of the mission, one part per robot
    width_m: float | None = None  # of a doorway, used by `audit` only

    @property
    def place(self) -> tuple[float, float] | None:
        """Return the mean of the aliases' places, map frame, or None."""
        places = [thing for alias in self.see for thing in alias if isinstance(thing, Landmark | Position)]
        if not places:
            return None
        return sum(p.x_m for p in places) / len(places), sum(p.y_m for p in places) / len(places)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainWay:
    """A way from one node to another."""

    source: str
    target: str
    direction_rad: float | None = None  # map frame; None is the straight line, if both nodes have a place
    do: Action | None = None  # action that leads to the target; None is to drive


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """A plain mission, checked on creation: names are unique and ways lead to existing nodes. Raises: UsageError."""

    name: str
    nodes: tuple[Node, ...]
    ways: tuple[PlainWay, ...]
    coding: CodingConfig | None = None
    # x0, y0, x1, y1 of the map, for `audit` and `draw`; None is the bounding box of all places
    area_m: tuple[float, float, float, float] | None = None
    roam: bool = False  # nodes may be decoded in any order (paper profile only: exploration, Fig. 9)
    repeatable: bool = False  # a robot may start it more than once
    floor_plan: str = ""

    def __post_init__(self) -> None:
        if not 0 < len(self.nodes) <= NODE_LIMIT:
            raise Misplaced(UsageError(f"a mission of {len(self.nodes)} nodes", f"use 1 to {NODE_LIMIT}"), "nodes")
        names = {node.name: node for node in self.nodes}
        if len(names) < len(self.nodes):
            twice = next(node.name for i, node in enumerate(self.nodes) if names[node.name] is not self.nodes[i])
            raise Misplaced(UsageError(f"two nodes are called {twice!r}", "rename one of them"), "nodes", twice)
        for i, node in enumerate(self.nodes):
            with under("nodes", i):
                _check_node(node)
        for part in self.parts:
            if not any(node.start for node in self.nodes if node.part == part):
                its_own = next(i for i, node in enumerate(self.nodes) if node.part == part)
                of_part = f" of part {part!r}" if part else ""
                problem = UsageError(f"no node{of_part} is marked as a start", "add start: true to one node")
                raise Misplaced(problem, "nodes", *([its_own] if part else []))
        self._check_area()
        _check_ways(self.ways, names)
        self._check_messages()

    def _check_area(self) -> None:
        if self.area_m is not None:
            x0, y0, x1, y1 = self.area_m
            if not -VALUE_MAX < x0 < x1 < VALUE_MAX or not -VALUE_MAX < y0 < y1 < VALUE_MAX:
                hint = "use x0, y0, x1, y1 in metres; x0 below x1, y0 below y1"
                problem = UsageError(f"area is {[x0, y0, x1, y1]}", hint)
                raise Misplaced(problem, "area")

    def _check_messages(self) -> None:
        senders: dict[str, str] = {}
        for i, node in enumerate(self.nodes):
            for name in node.send:
                if name in senders:
                    problem = UsageError(f"message {name!r} is sent twice", "send it once")
                    raise Misplaced(problem, "nodes", i, "send")
                senders[name] = node.name
        sorter: TopologicalSorter[str] = TopologicalSorter()
        for node in self.nodes:
            sorter.add(node.name, *(senders[name] for name in node.wait if name in senders))
        try:
            sorter.prepare()
        except CycleError as error:
            names = error.args[1]
            message = f"nodes wait for each other's messages: {', '.join(names)}"
            problem = UsageError(message, "let one of them wait for none")
            raise Misplaced(problem, "nodes", names[0], "wait") from error

    @property
    def parts(self) -> tuple[str, ...]:
        """Return the names of the mission's parts; [""] if it is not divided."""
        return tuple(dict.fromkeys(node.part for node in self.nodes))

    @property
    def box_m(self) -> tuple[float, float, float, float]:
        """Return x0, y0, x1, y1 of the map: `area_m`, or the bounding box of all places."""
        if self.area_m is not None:
            return self.area_m
        places = [node.place for node in self.nodes if node.place is not None] or [(0.0, 0.0)]
        xs, ys = [x for x, _ in places], [y for _, y in places]
        return min(xs), min(ys), max(xs), max(ys)


def _check_node(node: Node) -> None:  # noqa: C901  # a list of limits
    if not 0 < len(node.name.encode("utf-8", "replace")) <= 100 or not node.name.isprintable():
        raise UsageError(f"a node called {node.name!r}", "use 1 to 100 bytes of printable characters")
    if not 0 < len(node.see) <= ALIAS_LIMIT:
        raise UsageError(f"node {node.name!r} has {len(node.see)} alternatives to see", f"use 1 to {ALIAS_LIMIT}")
    for alias in node.see:
        with under("see"):
            if not alias and not node.wait:
                raise UsageError(f"node {node.name!r} has nothing to see", "add see: a landmark, a position, ...")
            shape = shape_of(alias)
            for thing in alias:
                _check_seen(node.name, thing)
        if len(node.wait) + shape.messages > 3:
            many = UsageError(f"node {node.name!r} waits for {len(node.wait)} messages", "use at most 3")
            raise Misplaced(many, "wait")
        if node.do is not None and shape.action:
            both = UsageError(f"node {node.name!r} has an action under see and under do", "remove one of them")
            raise Misplaced(both, "do")
    if node.do is not None:
        with under("do"):
            action_bytes(node.do)
    with under("within_m"):
        if not 0 <= node.within_m <= REACH_LIMIT_M:
            raise UsageError(f"within_m of node {node.name!r} is {node.within_m}", f"use 0 to {REACH_LIMIT_M}")
    with under("width"):
        if node.width_m is not None and not 0 < node.width_m < VALUE_MAX:
            raise UsageError(f"node {node.name!r} has a width of {node.width_m} m", "use metres, above 0")
    with under("timeout_s"):
        if not 0 <= node.timeout_s <= TIMEOUT_LIMIT_S:
            raise UsageError(f"node {node.name!r} times out after {node.timeout_s} s", f"use 0 to {TIMEOUT_LIMIT_S}")
    with under("send"):
        if len(node.send) > SEND_LIMIT:
            raise UsageError(f"node {node.name!r} sends {len(node.send)} messages", f"use at most {SEND_LIMIT}")


def _check_seen(name: str, thing: Observable) -> None:
    if isinstance(thing, Action):
        action_bytes(thing)
    if not isinstance(thing, Landmark) or thing.area_m2 is None:
        return
    if thing.type != "room":
        raise UsageError(f"node {name!r} sees a {thing.type} with an area", "give an area to rooms only")
    if thing.area_m2 <= 0:
        raise UsageError(f"node {name!r} sees a room with an area of {thing.area_m2} m2", "use m2, above 0")


def _check_ways(ways: tuple[PlainWay, ...], names: dict[str, Node]) -> None:
    seen: set[tuple[str, str]] = set()
    out: dict[str, int] = {}
    for i, way in enumerate(ways):
        with under("ways", i):
            _check_way(way, names)
            if (way.source, way.target) in seen or way.source == way.target:
                problem = "a way leads" if way.source == way.target else "a second way leads"
                raise UsageError(f"{problem} from {way.source!r} to {way.target!r}", "remove it")
            seen.add((way.source, way.target))
            out[way.source] = out.get(way.source, 0) + 1
            if out[way.source] > WAY_LIMIT:
                raise UsageError(f"more than {WAY_LIMIT} ways lead out of {way.source!r}", "divide the node")


def _check_way(way: PlainWay, names: dict[str, Node]) -> None:
    for end in (way.source, way.target):
        if end not in names:
            raise UsageError(f"a way has an end {end!r}, which is not a node", "check the names under ways")
    if names[way.source].part != names[way.target].part:
        between = f"from {way.source!r} to {way.target!r}"
        raise UsageError(f"the way {between} joins two parts of the mission", "use a message instead")
    if way.do is not None:
        action_bytes(way.do)
    if way.direction_rad is not None and not abs(way.direction_rad) < VALUE_MAX:
        raise UsageError(f"the way from {way.source!r} has direction {way.direction_rad}", "use a finite angle")


@dataclass(slots=True)
class Draft:
    """Builder of a `Mission`.

    >>> from phalanx.mission import Draft, Landmark, Position
    >>> draft = Draft("fetch")
    >>> draft.node("dock", Position(3.0, 1.5), start=True)
    >>> draft.node("store", Landmark("doorway", 9.0, 12.0, 0.0), final=True)
    >>> draft.way("dock", "store")
    >>> mission = draft.mission()
    """

    name: str
    coding: CodingConfig | None = None
    area_m: tuple[float, float, float, float] | None = None
    roam: bool = False
    repeatable: bool = False
    floor_plan: str = ""
    nodes: list[Node] = field(default_factory=list)
    ways: list[PlainWay] = field(default_factory=list)

    def node(self, name: str, *see: Observable | tuple[Observable, ...], **more: Any) -> None:
        """Add a node; each positional argument after the name is an alias, keyword arguments are fields of `Node`."""
        aliases = tuple(alias if isinstance(alias, tuple) else (alias,) for alias in see)
        self.nodes.append(Node(name=name, see=aliases or ((),), **more))

    def way(
        self,
        source: str,
        target: str,
        *,
        both: bool = False,
        direction_rad: float | None = None,
        do: Action | None = None,
    ) -> None:
        """Add a way; with `both` also the way back, in the opposite direction."""
        self.ways.append(PlainWay(source=source, target=target, direction_rad=direction_rad, do=do))
        if both:
            back = None if direction_rad is None else direction_rad + math.pi
            self.ways.append(PlainWay(source=target, target=source, direction_rad=back, do=do))

    def mission(self) -> Mission:
        """Return the checked mission. Raises: UsageError."""
        same = {each.name: getattr(self, each.name) for each in fields(self)}
        return Mission(**{**same, "nodes": tuple(self.nodes), "ways": tuple(self.ways)})
