"""A plain mission in the sealed profile."""

from __future__ import annotations

from dataclasses import replace

from phalanx.errors import UsageError
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import shape_of
from phalanx.mission.file.records import PAYLOAD_LIMIT, TAG_BYTES, Alias, EncodedMission, NodeRecord, Way
from phalanx.mission.graph import Mission, Node, PlainWay
from phalanx.mission.observable import Observable, sector_of
from phalanx.mission.walk.gate import Gate, Hint, StartKey, join_shares

from .making import BuildOptions, Built, Maker, Random, Spread, direction_of, observed_bytes


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
