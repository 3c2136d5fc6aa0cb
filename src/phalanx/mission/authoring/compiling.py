"""A plain mission becomes an encoded one. Random bytes are an argument; the slow step can be spread over threads."""

from __future__ import annotations

from dataclasses import replace
from graphlib import CycleError, TopologicalSorter

from phalanx.errors import UsageError
from phalanx.mission.file import paper, sealed
from phalanx.mission.file.canonical import Shape, shape_of
from phalanx.mission.file.records import (
    PAYLOAD_LIMIT,
    TAG_BYTES,
    Alias,
    EncodedMission,
    NodeRecord,
    Profile,
    Way,
    WayKind,
)
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.observable import Observable, Offset, sector_of
from phalanx.mission.walk.gate import Gate, Hint, StartKey, join_shares

from .apart import told_apart
from .making import BuildOptions, Built, Maker, Random, Spread, direction_of, observed_bytes, place_of


def build(
    mission: Mission,
    options: BuildOptions,
    random: Random,
    spread: Spread = map,
) -> list[Built]:
    """The encoded mission: one file for every part.

    Args:
        random: so many unpredictable bytes.
        spread: like `map`; a thread pool's, to try several slow hashes at once.
    Raises: UsageError: the mission cannot be said in this profile.
    Source: Encoded graphs §III, §IV-A; docs/spec/mission.md.
    """
    maker = (PaperMaker if options.profile is Profile.PAPER else SealedMaker)(told_apart(mission), options, random)
    return [maker.part(part, spread) for part in mission.parts]


class SealedMaker(Maker):
    """Random secrets behind gates; what will be seen goes into scrypt and nowhere else."""

    def __init__(self, mission: Mission, options: BuildOptions, random: Random) -> None:
        super().__init__(mission, options, random)
        if mission.roam:
            raise UsageError("a sealed mission to roam", "its nodes open one after the other; --profile paper")
        self.tokens = {name: random(32) for name in self.sent} | self.external

    def part(self, part: str, spread: Spread) -> Built:
        """One robot's half."""
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
            told = sealed.Payload(node.name, node.do, node.place, tuple(self.tokens[n] for n in node.send), outs)
            payload = sealed.seal_payload(header, i, record, secrets[i], told)
            if len(payload) > PAYLOAD_LIMIT:
                raise UsageError(f"node {node.name!r} has too many ways out", "divide it")
            records.append(replace(record, payload=payload))
        starts = {i: Gate(gates[i], hints[i]) for i, node in enumerate(nodes) if node.start}
        key = StartKey(header.mission_id, starts, self.external)
        opened = replace(key, messages={}).encode() if self.options.open_start else b""
        return Built(part, EncodedMission(header, tuple(records), opened), key)

    def _gate(self, node: Node, shares: dict[tuple[str, str], bytes]) -> bytes:
        """The node's gate; its shares are left with every way that leads there."""
        gate = self.random(32)
        before = [way.source for way in self.before.get(node.name, [])]
        for source in before:
            shares[source, node.name] = self.random(32) if node.join else gate
        if node.join and before:
            gate = join_shares([shares[source, node.name] for source in before])
        return gate

    def _hint(self, node: Node, alias: tuple[Observable, ...]) -> Hint:
        shape = shape_of(alias)
        if shape.messages:
            raise UsageError(f"node {node.name!r} sees a message of given bytes", "name it under wait")
        shape = shape._replace(messages=len(node.wait), previous=0)
        return Hint(shape, self.offset(alias))

    def _way(self, way: PlainWay, secret: bytes, source: Node, target: Node, number: dict[str, int]) -> Way:
        direction = direction_of(way, source.place, target.place)
        if direction is None or way.do is not None:
            return Way(number[way.target], (self.random(TAG_BYTES),))
        tag = sealed.direction_tag(secret, number[way.target], sector_of(direction, self.coding.sectors))
        return Way(number[way.target], (tag,))


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
