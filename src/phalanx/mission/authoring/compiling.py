"""Compile a plain mission to an encoded one, in either profile.

The random source is an argument; the slow step, scrypt, can run in several threads.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from typing import Any

from phalanx.config.mission import CodingConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.errors import UsageError
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import (
    Shape,
    action_hash,
    canonical,
    direction_hash,
    message_of,
    place_bytes,
    shape_of,
)
from phalanx.mission.file.records import (
    FINAL,
    FOREVER_S,
    JOIN,
    OPEN_START,
    PAYLOAD_LIMIT,
    REPEATABLE,
    ROAM,
    START,
    TAG_BYTES,
    Alias,
    EncodedMission,
    Header,
    NodeRecord,
    Profile,
    Way,
    WayKind,
)
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.observable import (
    Action,
    Landmark,
    Message,
    Observable,
    Offset,
    Position,
    Sensor,
    Time,
    cell_of,
    offset_of,
    sector_of,
    window_of,
)
from phalanx.mission.walk.gate import Gate, Hint, StartKey, join_shares

from .findable import mark_lookalikes

Random = Callable[[int], bytes]
Spread = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
Seen = tuple[Offset, bytes, tuple[Observable, ...]]  # an alias: offset, canonical bytes, observables
PAPER_CODING = CodingConfig()
# Cells of the sealed profile are large, since a try takes 10 ms: 9 cells cover +-0.6 m.
SEALED_CODING = CodingConfig(delta_mm=400)
# Robots take places for exact to `MissionConfig.sight_m`: with coarser rounding their fixes would be wrong.
OFFSET_LIMIT_MM = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Options of a build: profile, robots that may run the mission, and period of validity."""

    profile: Profile = Profile.SEALED
    robots: tuple[int, ...] = ()  # ids; empty is any
    valid_from_s: int = 0  # on the mission's clock
    valid_to_s: int = FOREVER_S  # likewise
    open_start: bool = False  # put the start key into the file (sealed profile), so that anyone can start
    offset_mm: int = 1  # offsets of places are rounded to multiples of this

    def __post_init__(self) -> None:
        if not 0 <= self.valid_from_s < self.valid_to_s <= FOREVER_S:
            raise UsageError(f"valid from {self.valid_from_s} to {self.valid_to_s}", "use an end after the start")
        if any(not 0 <= robot < 1 << 16 for robot in self.robots) or len(set(self.robots)) > 255:
            raise UsageError(f"robots {self.robots}", "use at most 255 ids from 0 to 65535")
        if self.open_start and self.profile is Profile.PAPER:
            raise UsageError("an open start in the paper profile", "leave it out: this profile has no start key")
        if not 1 <= self.offset_mm <= OFFSET_LIMIT_MM:
            raise UsageError(f"offsets rounded to {self.offset_mm} mm", f"use 1 to {OFFSET_LIMIT_MM}")


@dataclass(frozen=True, slots=True)
class Built:
    """One robot's part of a mission: the file, not signed yet, and its start key."""

    part: str
    mission: EncodedMission
    key: StartKey


class Maker:
    """Base class of both profiles' compilers: numbers of nodes, headers, offsets."""

    def __init__(self, mission: Mission, options: BuildOptions, random: Random) -> None:
        default = PAPER_CODING if options.profile is Profile.PAPER else SEALED_CODING
        self.coding = mission.coding or default
        self.mission = mission
        self.options = options
        self.random = random
        self.sent = {name: node for node in mission.nodes for name in node.send}
        self.before, self.after = defaultdict[str, list[PlainWay]](list), defaultdict[str, list[PlainWay]](list)
        for way in mission.ways:
            self.before[way.target].append(way)
            self.after[way.source].append(way)
        waited = dict.fromkeys(name for node in mission.nodes for name in node.wait)
        # No node sends these messages: a controller sends them, and takes them from the key file.
        self.external = {name: random(32) for name in waited if name not in self.sent}

    def header(self, nodes: list[Node], shapes: Iterable[Shape] = ()) -> Header:
        """Return the header of a part, with a random mission id."""
        flags = REPEATABLE * self.mission.repeatable | ROAM * self.mission.roam | OPEN_START * self.options.open_start
        return Header(
            self.options.profile,
            self.random(16),
            self.coding,
            len(nodes),
            flags,
            self.options.valid_from_s,
            self.options.valid_to_s,
            tuple(sorted(set(self.options.robots))),
            tuple(sorted(set(shapes), key=lambda shape: shape.code)),
        )

    def numbered(self, part: str) -> tuple[list[Node], dict[str, int], list[list[PlainWay]]]:
        """Return (nodes, number by name, ways out of each node by ascending target) of a part."""
        nodes = [node for node in self.mission.nodes if node.part == part]
        number = {node.name: i for i, node in enumerate(nodes)}
        return nodes, number, [sorted(self.after[name], key=lambda way: number[way.target]) for name in number]

    def offset(self, alias: tuple[Observable, ...]) -> Offset:
        """Return the offset of an alias's cells."""
        return alias_offset(self.coding, alias, self.options.offset_mm)

    @staticmethod
    def common(node: Node) -> tuple[int, int, int, int]:
        """Return flags, timeout_s, reach_dm and sends of a record."""
        flags = START * node.start | FINAL * node.final | JOIN * node.join
        return flags, node.timeout_s, math.ceil(node.within_m * 10), len(node.send)


def place_of(alias: tuple[Observable, ...]) -> Landmark | Position | None:
    """Return the landmark or position in a conjunction, or None."""
    return next((thing for thing in alias if isinstance(thing, Landmark | Position)), None)


def observed_bytes(
    coding: CodingConfig,
    alias: tuple[Observable, ...],
    offset: Offset,
    *,
    do: Action | None = None,
    messages: Iterable[bytes] = (),
    previous: bytes | None = None,
) -> bytes:
    """Return the canonical bytes that a robot will observe, computed from the author's alias."""
    place = place_of(alias)
    where = b""
    if place is not None:
        landmark = place if isinstance(place, Landmark) else None
        cell = cell_of(coding, offset, place.x_m, place.y_m, landmark)
        where = place_bytes(shape_of((place,)), cell, landmark.text if landmark else None)
    actions = [thing for thing in alias if isinstance(thing, Action)] or ([] if do is None else [do])
    windows = [window_of(coding, thing.t_s) for thing in alias if isinstance(thing, Time)]
    return canonical(
        where,
        sensors=[thing.value for thing in alias if isinstance(thing, Sensor)],
        action=actions[0] if actions else None,
        window=windows[0] if windows else None,
        messages=[*messages, *(thing.value for thing in alias if isinstance(thing, Message))],
        previous=previous,
    )


def alias_offset(coding: CodingConfig, alias: tuple[Observable, ...], rounded_mm: int = 1) -> Offset:
    """Return the offset of an alias's cells; x and y are rounded to multiples of `rounded_mm` within half a cell."""
    place = place_of(alias)
    if place is None:
        return Offset()
    exact = offset_of(coding, place)
    most = (coding.delta_mm + 1) // 2 // rounded_mm * rounded_mm
    x, y = (max(-most, min(most, round(value / rounded_mm) * rounded_mm)) for value in exact[:2])
    return exact._replace(x=x, y=y)


def direction_of(way: PlainWay, source: tuple[float, float] | None, target: tuple[float, float] | None) -> float | None:
    """Return the direction of a way, map frame: the given one or that of the straight line; None without places."""
    if way.direction_rad is not None:
        return way.direction_rad
    if source is None or target is None:
        return None
    dx, dy = target[0] - source[0], target[1] - source[1]
    return math.atan2(dy, dx) if dx or dy else None


def build(mission: Mission, options: BuildOptions, random: Random, spread: Spread = map) -> list[Built]:
    """Compile a mission; return one file for each part.

    `random(n)` returns n secure random bytes; `spread` is `map`, or that of a thread pool to run scrypt in parallel.
    Raises: UsageError: the mission cannot be encoded in this profile.
    Source: Encoded graphs §III, §IV-A; docs/spec/mission.md.
    """
    mission = mark_lookalikes(mission)
    if options.profile is Profile.PAPER:
        return [PaperMaker(mission, options, random).part(part) for part in mission.parts]
    maker = SealedMaker(mission, options, random)
    return [maker.part(part, spread) for part in mission.parts]


class SealedMaker(Maker):
    """Compiler for the sealed profile: random secrets behind gates; observations are used by scrypt only."""

    def __init__(self, mission: Mission, options: BuildOptions, random: Random) -> None:
        super().__init__(mission, options, random)
        if mission.roam:
            raise UsageError("roam in the sealed profile, whose nodes open one by one", "use --profile paper")
        self.tokens = {name: random(32) for name in self.sent} | self.external

    def part(self, part: str, spread: Spread) -> Built:
        """Return one robot's part."""
        nodes, number, ways = self.numbered(part)
        header = self.header(nodes)
        secrets = [self.random(32) for _ in nodes]
        shares: dict[tuple[str, str], bytes] = {}
        gates = [self._gate(node, shares) for node in nodes]
        hints = [tuple(self._hint(node, alias) for alias in node.see) for node in nodes]
        jobs = [(i, a) for i, node in enumerate(nodes) for a in range(len(node.see))]

        def lock(job: tuple[int, int]) -> Alias:
            i, a = job
            messages = tuple(self.tokens[name] for name in nodes[i].wait)
            salt = sealed.node_salt(gates[i], messages, header, i, a)
            observed = observed_bytes(self.coding, nodes[i].see[a], hints[i][a].offset)
            mark, key = sealed.try_observation(header, observed, hints[i][a], salt)
            return Alias(mark, secret=sealed.seal_secret(header, i, a, key, secrets[i]))

        def share(i: int, way: PlainWay) -> bytes:
            return sealed.onward(gates[i], shares[way.source, way.target], header, i, number[way.target])

        locks = dict(zip(jobs, spread(lock, jobs), strict=True))
        records = []
        for i, node in enumerate(nodes):
            record = NodeRecord(
                *self.common(node),
                aliases=tuple(locks[i, a] for a in range(len(node.see))),
                ways=tuple(self._way(way, secrets[i], node, nodes[number[way.target]], number) for way in ways[i]),
                visited=sealed.visited_hash(sealed.visited_proof(secrets[i])),
            )
            outs = tuple(sealed.WayOut(Gate(share(i, way), hints[number[way.target]]), way.do) for way in ways[i])
            content = sealed.Payload(node.name, node.do, node.place, tuple(self.tokens[n] for n in node.send), outs)
            payload = sealed.seal_payload(header, i, record, secrets[i], content)
            if len(payload) > PAYLOAD_LIMIT:
                raise UsageError(f"node {node.name!r} has too many ways out", "divide it into several nodes")
            records.append(replace(record, payload=payload))
        starts = {i: Gate(gates[i], hints[i]) for i, node in enumerate(nodes) if node.start}
        key = StartKey(header.mission_id, starts, self.external)
        opened = replace(key, messages={}).encode() if self.options.open_start else b""
        return Built(part, EncodedMission(header, tuple(records), opened), key)

    def _gate(self, node: Node, shares: dict[tuple[str, str], bytes]) -> bytes:
        """Return the gate of a node, and put a share for each way that leads to it into `shares`."""
        gate = self.random(32)
        before = [way.source for way in self.before[node.name]]
        for source in before:
            shares[source, node.name] = self.random(32) if node.join else gate
        if node.join and before:
            gate = join_shares([shares[source, node.name] for source in before])
        return gate

    def _hint(self, node: Node, alias: tuple[Observable, ...]) -> Hint:
        shape = shape_of(alias)
        if shape.messages:
            raise UsageError(f"node {node.name!r} sees a message of given bytes", "use a message name under wait")
        shape = shape._replace(messages=len(node.wait), previous=0)
        return Hint(shape, self.offset(alias))

    def _way(self, way: PlainWay, secret: bytes, source: Node, target: Node, number: dict[str, int]) -> Way:
        direction = direction_of(way, source.place, target.place)
        if direction is None or way.do is not None:
            return Way(number[way.target], (self.random(TAG_BYTES),))
        tag = sealed.direction_tag(secret, number[way.target], sector_of(direction, self.coding.sectors))
        return Way(number[way.target], (tag,))


class PaperMaker(Maker):
    """Compiler for the paper profile: hashes of observations. Source: Encoded graphs §III-A, §IV-A."""

    def part(self, part: str) -> Built:
        """Return one robot's part."""
        nodes, number, ways = self.numbered(part)
        marks: dict[str, list[bytes]] = {}
        by_name: dict[str, list[Seen]] = {}
        for node in self._chain_order(nodes):
            before = [mark for way in self.before[node.name] for mark in marks[way.source]] if node.chained else []
            previous: list[bytes | None] = [*before] or [None]
            by_name[node.name] = [
                (offset := self.offset(alias), self._bytes(node, alias, offset, mark), alias)
                for alias in node.see
                for mark in previous
            ]
            if len(by_name[node.name]) > 255 or (node.chained and not before):
                hint = "use 1 to 255, or the sealed profile"
                raise UsageError(f"node {node.name!r} is chained to {len(before)} previous aliases", hint)
            marks[node.name] = [sha3_256(observed) for _, observed, _ in by_name[node.name]]
        seen = [by_name[node.name] for node in nodes]
        header = self.header(nodes, (self._shape(node, alias) for node in nodes for alias in node.see))
        if len(header.shapes) > 255:
            raise UsageError(f"{len(header.shapes)} combinations of kinds of observables", "use at most 255")
        places = [node.place for node in nodes]
        records = []
        for i, node in enumerate(nodes):
            record = NodeRecord(
                *self.common(node),
                aliases=tuple(Alias(sha3_256(observed), offset) for offset, observed, _ in seen[i]),
                ways=tuple(self._way(way, number[way.target], seen[i], places[number[way.target]]) for way in ways[i]),
            )
            bindings = tuple(record.binding(header, i, observed) for _, observed, _ in seen[i])
            records.append(replace(record, bindings=bindings))
        key = StartKey(header.mission_id, {}, self.external)
        return Built(part, EncodedMission(header, tuple(records)), key)

    def _chain_order(self, nodes: list[Node]) -> list[Node]:
        """Return the nodes in an order with each chained node after all its predecessors."""
        by_name = {node.name: node for node in nodes}
        sorter: TopologicalSorter[str] = TopologicalSorter()
        for node in nodes:
            sorter.add(node.name, *(way.source for way in self.before[node.name] if node.chained))
        try:
            return [by_name[name] for name in sorter.static_order()]
        except CycleError as error:
            raise UsageError(
                f"node {error.args[1][0]!r} is chained to itself in a circle", "break it, or use the sealed profile"
            ) from error

    def _messages(self, node: Node) -> list[bytes]:
        out = []
        for name in node.wait:
            if name in self.external:
                out.append(self.external[name])
                continue
            sender = self.sent[name]
            if len(sender.see) > 1 or sender.chained:
                raise UsageError(
                    f"node {sender.name!r} sends {name!r} but is chained or has several alternatives under see",
                    "use one alternative, as the message is derived from it, or the sealed profile",
                )
            offset = self.offset(sender.see[0])
            observed = self._bytes(sender, sender.see[0], offset, None)
            out.append(message_of(observed, sender.send.index(name)))
        return out

    def _bytes(self, node: Node, alias: tuple[Observable, ...], offset: Offset, previous: bytes | None) -> bytes:
        return observed_bytes(self.coding, alias, offset, do=node.do, messages=self._messages(node), previous=previous)

    def _shape(self, node: Node, alias: tuple[Observable, ...]) -> Shape:
        shape = shape_of(alias)
        return shape._replace(
            messages=shape.messages + len(node.wait),
            action=int(shape.action or node.do is not None),
            previous=int(node.chained),
        )

    def _way(self, way: PlainWay, target: int, seen: list[Seen], to: tuple[float, float] | None) -> Way:
        if (action := way.do) is not None:
            hashes = tuple(action_hash(sha3_256(observed), action) for _, observed, _ in seen)
            return Way(target, hashes, WayKind.ACTION)
        out = []
        for _, observed, alias in seen:
            place = place_of(alias)
            direction = direction_of(way, None if place is None else (place.x_m, place.y_m), to)
            if direction is None:
                return Way(target, tuple(bytes(32) for _ in seen), WayKind.EMPTY)
            sectors = self.coding.sectors
            out.append(direction_hash(observed, sector_of(direction, sectors), sectors))
        return Way(target, tuple(out))
