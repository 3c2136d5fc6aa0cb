"""The file of an encoded mission: header, node records, optional start key, signature; and the checks before a start.

The parser is total: for any bytes it returns a mission or raises a PeerError, and its work is proportional to their
length, not to numbers in them. Each mission has one encoding: a parsed mission encodes to the same bytes again.
docs/spec/mission.md has the layout.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from phalanx.config.mission import CodingConfig
from phalanx.crypto.sha3 import DIGEST_BYTES, sha3_256
from phalanx.errors import NotAuthentic, TooLarge, UsageError
from phalanx.mission.observable import Offset
from phalanx.mission.refused import AlreadyStarted, MalformedMission, NotForUs, OutsideWindow, Unsigned
from phalanx.wire import missions as table

from .canonical import Reader, Shape, parse_shape

MAGIC = b"PHXM"
VERSION = 2
FILE_LIMIT = 64 << 20
FOREVER_S = (1 << 64) - 1
TAG_BYTES = 16
SECRET_BYTES = 32
PAYLOAD_LIMIT = 60_000
REPEATABLE, ROAM, OPEN_START = 1, 2, 4  # header flags
START, FINAL, JOIN = 1, 2, 4  # node flags
_FLAGS = 7
# Domain separation: a signature by the same key on other data never verifies as one on a mission.
CONTEXT = b"phalanx mission file 1\x00"
_CODING = tuple(each.name for each in table.HEADER.fields if each.name in CodingConfig.__dataclass_fields__)


class Profile(IntEnum):
    """Encoding of a mission: hashes as in the paper, or encryption with scrypt."""

    PAPER = 0
    SEALED = 1


class WayKind(IntEnum):
    """Kind of encoding of a way from one node to the next (paper profile)."""

    EMPTY = 0
    DIRECTION = 1
    ACTION = 2


@dataclass(frozen=True, slots=True)
class Header:
    """Header of a mission; every node is bound to its digest."""

    profile: Profile
    mission_id: bytes  # 16 random bytes
    coding: CodingConfig
    nodes: int
    flags: int = 0  # REPEATABLE, ROAM, OPEN_START
    valid_from_s: int = 0  # seconds on the mission's clock
    valid_to_s: int = FOREVER_S  # likewise; FOREVER_S is no end
    robots: tuple[int, ...] = ()  # ids of the robots that may run it; empty is any
    shapes: tuple[Shape, ...] = ()  # all shapes of its nodes (paper profile; sealed payloads reveal them node by node)

    def encode(self) -> bytes:
        """Return the stored bytes."""
        fixed = table.HEADER.form.pack(
            MAGIC,
            VERSION,
            self.profile,
            self.flags,
            self.mission_id,
            self.valid_from_s,
            self.valid_to_s,
            *(getattr(self.coding, name) for name in _CODING),
        )
        rising = _rising(self.robots) + _rising([shape.code for shape in self.shapes])
        return fixed + rising + table.COUNT_U32.form.pack(self.nodes)

    @property
    def digest(self) -> bytes:
        """Return the digest that binds nodes to this header."""
        return sha3_256(self.encode())


@dataclass(frozen=True, slots=True)
class Alias:
    """One of the conjunctions of observables that decode a node."""

    mark: bytes  # hash H of the node (paper), or the half of scrypt's output that commits to the key (sealed)
    # Offset of the cells (paper; in the sealed profile the previous node's payload has it)
    offset: Offset = Offset()  # noqa: RUF009  # an immutable NamedTuple
    secret: bytes = b""  # the node's secret, encrypted with the other half (sealed)


@dataclass(frozen=True, slots=True)
class Way:
    """A way from one node to the next."""

    target: int  # index of the next node, public, for planning
    # Hashes for each alias of the source node (paper), or one tag of the direction (sealed)
    hashes: tuple[bytes, ...]
    kind: WayKind = WayKind.DIRECTION  # paper profile


@dataclass(frozen=True, slots=True)
class NodeRecord:
    """A node as stored in the file."""

    flags: int  # START, FINAL, JOIN
    timeout_s: int  # 0 is the robot's default
    reach_dm: int  # largest distance to the landmark in 0.1 m; 0 is any distance
    sends: int  # number of messages that the node sends
    aliases: tuple[Alias, ...]
    ways: tuple[Way, ...]  # by target, ascending
    visited: bytes = b""  # hash of the proof of a visit (sealed)
    payload: bytes = b""  # encrypted `Payload` (sealed)
    # For each alias a hash that binds this record and the header to the alias's observables (paper)
    bindings: tuple[bytes, ...] = ()

    def core(self, profile: Profile) -> bytes:
        """Return the stored bytes without the payload or the bindings, which authenticate them."""
        fixed = (self.flags, self.timeout_s, self.reach_dm, self.sends, len(self.aliases), len(self.ways))
        out = [table.NODE.form.pack(*fixed)]
        if profile is Profile.PAPER:
            out += [table.PAPER_ALIAS.form.pack(alias.mark, *alias.offset) for alias in self.aliases]
            out += [table.PAPER_WAY.form.pack(way.target, way.kind) + b"".join(way.hashes) for way in self.ways]
        else:
            out += [table.SEALED_ALIAS.form.pack(alias.mark, alias.secret) for alias in self.aliases]
            out += [table.SEALED_WAY.form.pack(way.target, way.hashes[0]) for way in self.ways]
            out.append(self.visited)
        return b"".join(out)

    def binding(self, header: Header, node: int, observed: bytes) -> bytes:
        """Return the hash that binds this record, its index and the header to the node's observables (paper).

        An addition to the paper: a node does not decode if its record or the header was changed, signed or not.
        """
        bound = header.digest + table.BOUND.form.pack(node, len(observed)) + observed
        return sha3_256(table.BINDING + bound + self.core(Profile.PAPER))

    def encode(self, profile: Profile) -> bytes:
        """Return the stored bytes."""
        if profile is Profile.PAPER:
            return self.core(profile) + b"".join(self.bindings)
        return self.core(profile) + table.COUNT_U16.form.pack(len(self.payload)) + self.payload


@dataclass(frozen=True, slots=True)
class EncodedMission:
    """A parsed mission file of unverified origin: call `check_signature`."""

    header: Header
    nodes: tuple[NodeRecord, ...]
    start: bytes = b""
    signer: bytes = b""
    signature: bytes = b""

    def signed_part(self) -> bytes:
        """Return the bytes that the signature covers."""
        out = [self.header.encode(), *(node.encode(self.header.profile) for node in self.nodes)]
        if self.header.flags & OPEN_START:
            out.append(table.COUNT_U32.form.pack(len(self.start)) + self.start)
        return b"".join(out)

    def encode(self) -> bytes:
        """Return the bytes of the file."""
        by = table.SIGNATURE.form.pack(self.signer, self.signature) if self.signer else b""
        return self.signed_part() + table.SIGNED.form.pack(bool(self.signer)) + by


def _rising(numbers: Sequence[int]) -> bytes:
    return table.COUNT_U8.form.pack(len(numbers)) + b"".join(map(table.RISING.form.pack, numbers))


def parse_mission(raw: bytes) -> EncodedMission:
    """Parse a mission file. Raises: TooLarge, MalformedMission."""
    if len(raw) > FILE_LIMIT:
        raise TooLarge(f"{len(raw)} bytes of mission, limit {FILE_LIMIT}")
    reader = Reader(raw)
    header = _header(reader)
    nodes = tuple(_node(reader, header) for _ in range(header.nodes))
    start = reader.behind(table.COUNT_U32) if header.flags & OPEN_START else b""
    signer = signature = b""
    signed = reader.number(table.SIGNED)
    if signed > 1:
        raise MalformedMission("invalid signature flag")
    if signed:
        signer, signature = reader.unpack(table.SIGNATURE)
    reader.end()
    return EncodedMission(header, nodes, start, signer, signature)


def _header(reader: Reader) -> Header:
    magic, version, profile, flags, mission_id, begin, end, *coding = reader.unpack(table.HEADER)
    if magic != MAGIC:
        raise MalformedMission("not a mission file")
    if version != VERSION:
        raise MalformedMission(f"mission file of version {version}, not {VERSION}: build the mission again")
    if profile > Profile.SEALED or flags > _FLAGS or begin >= end:
        raise MalformedMission("invalid profile, flags or period of validity")
    try:
        config = CodingConfig(**dict(zip(_CODING, coding, strict=True)))
    except UsageError as error:
        raise MalformedMission(str(error)) from error
    robots, codes = (tuple(reader.number(table.RISING) for _ in range(reader.number(table.COUNT_U8))) for _ in range(2))
    if list(robots) != sorted(set(robots)) or list(codes) != sorted(set(codes)):
        raise MalformedMission("robots or shapes are not in ascending order")
    if (profile == Profile.PAPER) != bool(codes) or (profile == Profile.PAPER and flags & OPEN_START):
        raise MalformedMission("only the paper profile has shapes, only the sealed profile a start key")
    nodes = reader.number(table.COUNT_U32)
    # Check the count before allocating: each node takes at least this many bytes.
    if not 0 < nodes <= reader.left // (table.NODE.size + DIGEST_BYTES):
        raise MalformedMission(f"{nodes} nodes in {reader.left} bytes")
    shapes = tuple(parse_shape(code) for code in codes)
    return Header(Profile(profile), mission_id, config, nodes, flags, begin, end, robots, shapes)


def _node(reader: Reader, header: Header) -> NodeRecord:
    flags, timeout_s, reach_dm, sends, alias_count, way_count = reader.unpack(table.NODE)
    if flags > _FLAGS or not alias_count:
        raise MalformedMission("a node with unknown flags or without an alias")
    aliases: list[Alias] = []
    ways: list[Way] = []
    paper = header.profile is Profile.PAPER
    for _ in range(alias_count):
        if paper:
            mark, *offset = reader.unpack(table.PAPER_ALIAS)
            aliases.append(Alias(mark, Offset(*offset)))
        else:
            mark, secret = reader.unpack(table.SEALED_ALIAS)
            aliases.append(Alias(mark, secret=secret))
    before = -1
    for _ in range(way_count):
        target, kind_or_tag = reader.unpack(table.PAPER_WAY if paper else table.SEALED_WAY)
        kind = kind_or_tag if paper else WayKind.DIRECTION
        if not before < target < header.nodes or kind > WayKind.ACTION:
            raise MalformedMission("a way with an invalid target or kind, or out of order")
        before = target
        hashes = tuple(reader.take(DIGEST_BYTES) for _ in aliases) if paper else (kind_or_tag,)
        ways.append(Way(target, hashes, WayKind(kind)))
    common = (flags, timeout_s, reach_dm, sends, tuple(aliases), tuple(ways))
    if paper:
        return NodeRecord(*common, bindings=tuple(reader.take(DIGEST_BYTES) for _ in aliases))
    visited = reader.take(DIGEST_BYTES)
    payload = reader.behind(table.COUNT_U16)
    if not TAG_BYTES < len(payload) <= PAYLOAD_LIMIT:
        raise MalformedMission("a payload of an invalid length")
    return NodeRecord(*common, visited, payload)


def public_key(key: Ed25519PrivateKey) -> bytes:
    """Return the 32 bytes of the public key, for the robots' lists of trusted keys."""
    return key.public_key().public_bytes_raw()


def sign(mission: EncodedMission, key: Ed25519PrivateKey) -> EncodedMission:
    """Return the mission, signed. Source: RFC 8032 (Ed25519)."""
    bare = replace(mission, signer=b"", signature=b"")
    return replace(bare, signer=public_key(key), signature=key.sign(CONTEXT + bare.signed_part()))


def check_signature(mission: EncodedMission, trusted: Collection[bytes] | None) -> None:
    """Check that the mission was signed by one of the `trusted` public keys (32 bytes each) and is unaltered.

    None accepts any signer, and proves only that the file was not altered since. Raises: Unsigned, NotAuthentic.
    """
    if not mission.signer:
        raise Unsigned("the mission is not signed")
    if trusted is not None and mission.signer not in trusted:
        raise Unsigned(f"signed by {mission.signer.hex()}, which is not trusted")
    try:
        Ed25519PublicKey.from_public_bytes(mission.signer).verify(mission.signature, CONTEXT + mission.signed_part())
    except (InvalidSignature, ValueError) as error:
        raise NotAuthentic("the signature does not verify: wrong key, or the file was altered") from error


def admit(mission: EncodedMission, robot: int, now_s: float, started: Collection[bytes]) -> None:
    """Check that a robot may start the mission at `now_s` on its clock; `started` are ids of missions started before.

    Raises: NotForUs, OutsideWindow, AlreadyStarted. Source: Encoded graphs §VI-G (replay).
    """
    header = mission.header
    if header.robots and robot not in header.robots:
        raise NotForUs(f"the mission is for robots {', '.join(map(str, header.robots))}, this is robot {robot}")
    ends = header.valid_to_s if header.valid_to_s < FOREVER_S else float("inf")
    if not header.valid_from_s <= now_s < ends:
        raise OutsideWindow(f"valid from {header.valid_from_s} s to {ends:g} s, now is {now_s:.0f} s")
    if header.mission_id in started and not header.flags & REPEATABLE:
        raise AlreadyStarted("this robot has started this mission before")
