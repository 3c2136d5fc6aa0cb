"""Open a matched node: its content and the ways that lead on. Raise `Altered` if it does not fit the mission file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.angles import TWO_PI, wrap_rad
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import AT_POSITION, action_hash, message_of, with_direction
from phalanx.mission.file.records import EncodedMission, Way, WayKind
from phalanx.mission.observable import LANDMARK_TYPES, Action, Direction, Experience, Landmark, middle_of
from phalanx.mission.refused import Altered
from phalanx.wire import missions as table

from .claims import Claim, Found
from .gate import Gate


@dataclass(frozen=True, slots=True)
class OpenWay:
    """A way from an opened node to the next."""

    target: int
    direction_rad: float | None = None  # map frame, from the node's place; None if none is encoded
    do: Action | None = None
    # Gate of the next node, or a share of it, encrypted with the gate of this node (sealed profile)
    gate: Gate | None = None


@dataclass(frozen=True, slots=True)
class Known:
    """The parts of a decoded node that the state keeps: its place and ways, without gates or other secrets."""

    alias: int  # the alias that matched
    place_m: tuple[float, float] | None  # as in `Opened`
    landmark: Landmark | None  # likewise
    ways: tuple[OpenWay, ...]  # without gates
    name: str = field(default="", compare=False)  # for display; not in checkpoints


@dataclass(frozen=True, slots=True)
class Opened:
    """A decoded node with its decrypted content."""

    node: int
    alias: int
    name: str  # the author's name of the node ("" in the paper profile)
    place_m: tuple[float, float] | None  # map frame, or None
    landmark: Landmark | None  # the recognised landmark at its true place; None for nodes without one
    do: Action | None
    sends: tuple[bytes, ...]
    ways: tuple[OpenWay, ...]
    proof: bytes  # proves to another robot that this robot decoded the node
    claim: Claim  # lets an auditor check the decode with one hash or KDF

    @property
    def known(self) -> Known:
        """Return the parts to keep in the state."""
        landmark = self.landmark and replace(self.landmark, area_m2=None)
        ways = tuple(replace(way, gate=None) for way in self.ways)
        return Known(self.alias, self.place_m, landmark, ways, self.name)


def open_found(mission: EncodedMission, found: Found, seen: Experience) -> Opened:
    """Return the node of a match, opened.

    Raises: Altered: the alias matched, but the rest of the record or the header was changed.
    """
    claim, record, header = found.claim, mission.nodes[found.claim.node], mission.header
    if found.key:
        secret = sealed.open_secret(header, claim.node, claim.alias, found.key, record.aliases[claim.alias].secret)
        payload = sealed.open_payload(header, claim.node, record, secret)
        proof = sealed.visited_proof(secret)
        if sealed.visited_hash(proof) != record.visited:
            raise Altered("a node's proof of a visit does not match its hash")
        name, place_m, do, sends = payload.name, payload.place_m, payload.do or found.action, payload.sends
        ways = tuple(
            OpenWay(way.target, _sealed_direction(mission, secret, way), out.do, out.gate)
            for way, out in zip(record.ways, payload.ways, strict=True)
        )
    else:
        if record.bindings[claim.alias] != record.binding(header, claim.node, claim.observed):
            raise Altered("a node matches, but its record does not match its binding")
        mark, proof = record.aliases[claim.alias].mark, sha3_256(table.VISITED + claim.observed)
        name, place_m, do = "", None, found.action
        sends = tuple(message_of(claim.observed, i) for i in range(record.sends))
        ways = tuple(_paper_way(mission, way, found, mark, seen.actions) for way in record.ways)
    place, landmark = _where(mission, found)
    return Opened(claim.node, claim.alias, name, place_m or place, landmark, do, sends, ways, proof, claim)


def _where(mission: EncodedMission, found: Found) -> tuple[tuple[float, float] | None, Landmark | None]:
    """Return the true place of a match, and its landmark, each None if it has none."""
    claim = found.claim
    if not claim.shape.place:
        return None, None
    x_m, y_m, orientation = middle_of(mission.header.coding, claim.offset, claim.cell)
    if claim.shape.place == AT_POSITION:
        return (x_m, y_m), None
    observed = found.seen
    assert observed is not None, "a match of a landmark shape has a landmark"
    kind = LANDMARK_TYPES[claim.shape.place - 1]
    apart_m = claim.offset.apart_m
    return (x_m, y_m), Landmark(kind, x_m, y_m, orientation, observed.area_m2, observed.text, apart_m)


def _to_direction(sector: int, sectors: int) -> float:
    return wrap_rad(sector * TWO_PI / sectors)


@lru_cache(maxsize=16)
def _directions(sectors: int) -> tuple[bytes, ...]:
    """Return the suffix of a node's canonical bytes for each direction."""
    return tuple(with_direction(b"", Direction(sector, sectors)) for sector in range(sectors))


def _paper_way(mission: EncodedMission, way: Way, found: Found, mark: bytes, pool: tuple[Action, ...]) -> OpenWay:
    wanted = way.hashes[found.claim.alias]
    if way.kind is WayKind.ACTION:
        return OpenWay(way.target, do=next((a for a in pool if action_hash(mark, a) == wanted), None))
    if way.kind is WayKind.EMPTY:
        return OpenWay(way.target)
    sectors = mission.header.coding.sectors
    directions = enumerate(_directions(sectors))
    hit = next((sector for sector, suffix in directions if sha3_256(found.claim.observed + suffix) == wanted), None)
    return OpenWay(way.target, None if hit is None else _to_direction(hit, sectors))


def _sealed_direction(mission: EncodedMission, secret: bytes, way: Way) -> float | None:
    sectors = mission.header.coding.sectors
    tags = (sealed.direction_tag(secret, way.target, sector) for sector in range(sectors))
    return next((_to_direction(i, sectors) for i, tag in enumerate(tags) if tag == way.hashes[0]), None)
