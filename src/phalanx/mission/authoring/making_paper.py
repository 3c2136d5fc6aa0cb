"""A plain mission in the paper profile."""

from __future__ import annotations

from dataclasses import replace
from graphlib import CycleError, TopologicalSorter

from phalanx.errors import UsageError
from phalanx.mission.file import paper
from phalanx.mission.file.canonical import Shape, shape_of
from phalanx.mission.file.records import Alias, EncodedMission, NodeRecord, Way, WayKind
from phalanx.mission.graph import Node, PlainWay
from phalanx.mission.observable import Observable, Offset, sector_of
from phalanx.mission.walk.gate import StartKey

from .making import Built, Maker, Spread, direction_of, observed_bytes, place_of

Seen = tuple[Offset, bytes, tuple[Observable, ...]]  # an alias: its offset, canonical bytes, and what they are of


class PaperMaker(Maker):
    """Hashes of what will be seen (Encoded graphs §III-A, §IV-A)."""

    def part(self, part: str, spread: Spread) -> Built:
        """One robot's half."""
        del spread  # nothing here is slow
        nodes, number, ways = self.numbered(part)
        marks: dict[str, list[bytes]] = {}
        by_name: dict[str, list[Seen]] = {}
        for node in self._chain_order(nodes):
            before = (
                [mark for way in self.before.get(node.name, []) for mark in marks[way.source]] if node.chained else []
            )
            previous: list[bytes | None] = [*before] or [None]
            by_name[node.name] = [
                (offset := self.offset(alias), self._bytes(node, alias, offset, mark), alias)
                for alias in node.see
                for mark in previous
            ]
            if len(by_name[node.name]) > 255 or (node.chained and not before):
                raise UsageError(f"node {node.name!r} is chained to {len(before)} experiences", "1 to 255; or seal it")
            marks[node.name] = [paper.node_hash(observed) for _, observed, _ in by_name[node.name]]
        seen = [by_name[node.name] for node in nodes]
        header = self.header(nodes, (self._shape(node, alias) for node in nodes for alias in node.see))
        if len(header.shapes) > 255:
            raise UsageError(f"{len(header.shapes)} kinds of conjunctions", "at most 255")
        places = [node.place for node in nodes]
        records = []
        for i, node in enumerate(nodes):
            record = NodeRecord(
                *self.common(node),
                aliases=tuple(Alias(paper.node_hash(observed), offset) for offset, observed, _ in seen[i]),
                ways=tuple(self._way(way, number[way.target], seen[i], places[number[way.target]]) for way in ways[i]),
            )
            bindings = tuple(paper.binding(header, i, record, observed) for _, observed, _ in seen[i])
            records.append(replace(record, bindings=bindings))
        key = StartKey(header.mission_id, {}, self.external)
        return Built(part, EncodedMission(header, tuple(records)), key)

    def _chain_order(self, nodes: list[Node]) -> list[Node]:
        """Every chained node after all that come before it."""
        by_name = {node.name: node for node in nodes}
        sorter: TopologicalSorter[str] = TopologicalSorter()
        for node in nodes:
            sorter.add(node.name, *(way.source for way in self.before.get(node.name, []) if node.chained))
        try:
            return [by_name[name] for name in sorter.static_order()]
        except CycleError as error:
            raise UsageError(
                f"node {error.args[1][0]!r} is chained to itself in a circle", "a chain needs a beginning; or seal it"
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
                    f"node {sender.name!r} sends {name!r} and can be experienced in several ways",
                    "in the paper profile a message is made of the one thing sensed; or seal it",
                )
            offset = self.offset(sender.see[0])
            observed = self._bytes(sender, sender.see[0], offset, None)
            out.append(paper.message_of(observed, sender.send.index(name)))
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

    def _way(
        self,
        way: PlainWay,
        target: int,
        seen: list[Seen],
        to: tuple[float, float] | None,
    ) -> Way:
        if way.do is not None:
            action = way.do
            hashes = tuple(paper.action_hash(paper.node_hash(observed), action) for _, observed, _ in seen)
            return Way(target, hashes, WayKind.ACTION)
        out = []
        for _, observed, alias in seen:
            place = place_of(alias)
            direction = direction_of(way, None if place is None else (place.x_m, place.y_m), to)
            if direction is None:
                return Way(target, tuple(bytes(32) for _ in seen), WayKind.EMPTY)
            sectors = self.coding.sectors
            out.append(paper.direction_hash(observed, sector_of(direction, sectors), sectors))
        return Way(target, tuple(out))
