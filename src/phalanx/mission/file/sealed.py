"""The sealed profile's cryptography: no stored byte depends on an observation except through scrypt.

Node v has a random secret S and a random gate G. Whoever holds G and makes the observation again gets M and W out of
scrypt: M is stored and commits to the key, W opens S, and S opens the payload. Each W and each payload key seals one
message, so the nonce is zero. Only this file derives or opens anything of a sealed node.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from phalanx.crypto.keys import hkdf_sha256, scrypt
from phalanx.crypto.sha3 import sha3_256
from phalanx.mission.observable import MM_PER_M, Action
from phalanx.mission.refused import Altered, MalformedMission
from phalanx.mission.walk.gate import Gate, Hint, parse_gate
from phalanx.wire import missions as table

from .canonical import Reader, action_bytes, parse_action, text_of
from .records import SECRET_BYTES, TAG_BYTES, Header, NodeRecord, Profile

NONCE = bytes(12)
PAD = 64  # payloads grow in such steps, so that their length tells little


@dataclass(frozen=True, slots=True)
class WayOut:
    """One way in a payload: the gate of the node it leads to (`onward`), and the instruction to get there."""

    gate: Gate
    do: Action | None = None


@dataclass(frozen=True, slots=True)
class Payload:
    """Contents of a sealed node, readable once it is opened."""

    name: str
    do: Action | None
    place_m: tuple[float, float] | None  # where the node is, map frame, to the mm
    sends: tuple[bytes, ...]  # messages of 32 bytes to give out
    ways: tuple[WayOut, ...]  # in the order of the record's ways


def node_salt(gate: bytes, messages: tuple[bytes, ...], header: Header, node: int, alias: int) -> bytes:
    """The salt of one alias: nobody without the gate, and the messages, can begin to try."""
    info = b"phalanx mission gate" + header.mission_id + table.OF_ALIAS.form.pack(node, alias)
    return hkdf_sha256(gate + b"".join(sorted(messages)), info, SECRET_BYTES)


def onward(gate: bytes, share: bytes, header: Header, node: int, target: int) -> bytes:
    """Return the share of a gate as the payload before it has it, or back: only who held that node's gate can use it.

    An auditor of a decode, which opens the payload too, has the salt, which is made of the gate, and not the gate.
    """
    info = b"phalanx mission onward" + header.mission_id + table.OF_WAY.form.pack(node, target)
    pad = hkdf_sha256(gate, info, SECRET_BYTES)
    return bytes(a ^ b for a, b in zip(share, pad, strict=True))


def try_observation(header: Header, canonical: bytes, hint: Hint, salt: bytes) -> tuple[bytes, bytes]:
    """(mark M, key W) of what was observed; the one slow step.

    The hint is part of it: with another offset the same cell would be elsewhere, for a robot whose start key was
    altered, and for an auditor who is told the offset by whom it audits.
    """
    coding = header.coding
    out = scrypt(canonical + hint.encode(), salt, log2_n=coding.kdf_log2_n, r=coding.kdf_r, length=table.TRIED.size)
    mark, key = table.TRIED.form.unpack(out)
    return mark, key


def seal_secret(header: Header, node: int, alias: int, key: bytes, secret: bytes) -> bytes:
    """S under W."""
    return AESGCM(key).encrypt(NONCE, secret, header.digest + table.OF_ALIAS.form.pack(node, alias))


def open_secret(header: Header, node: int, alias: int, key: bytes, sealed: bytes) -> bytes:
    """S, or Altered: the mark was right, so the record or the header is not."""
    try:
        return AESGCM(key).decrypt(NONCE, sealed, header.digest + table.OF_ALIAS.form.pack(node, alias))
    except InvalidTag as error:
        raise Altered("a node's secret does not open under its own mark") from error


def _payload_key(secret: bytes) -> AESGCM:
    return AESGCM(hkdf_sha256(secret, b"payload", SECRET_BYTES))


def _bound_to(header: Header, node: int, record: NodeRecord) -> bytes:
    return header.digest + table.OF_NODE.form.pack(node) + record.core(Profile.SEALED)


def seal_payload(header: Header, node: int, record: NodeRecord, secret: bytes, payload: Payload) -> bytes:
    """The payload under HKDF(S), bound to the header, the node and all of its record."""
    return _payload_key(secret).encrypt(NONCE, encode_payload(payload), _bound_to(header, node, record))


def open_payload(header: Header, node: int, record: NodeRecord, secret: bytes) -> Payload:
    """The payload, or Altered."""
    try:
        raw = _payload_key(secret).decrypt(NONCE, record.payload, _bound_to(header, node, record))
        payload = parse_payload(raw)
    except (InvalidTag, MalformedMission) as error:
        raise Altered("a node's payload does not open under its own secret") from error
    if len(payload.ways) != len(record.ways) or len(payload.sends) != record.sends:
        raise Altered("a payload does not fit its record")
    return payload


def direction_tag(secret: bytes, target: int, sector: int) -> bytes:
    """Return the tag stored for the direction of a way; decoders try each sector."""
    message = b"dir" + table.OF_SECTOR.form.pack(target, sector)
    return hmac.digest(secret, message, "sha256")[:TAG_BYTES]


def visited_proof(secret: bytes) -> bytes:
    """Return the proof that a robot decoded the node; it reveals nothing about the secret."""
    return hkdf_sha256(secret, b"visited", SECRET_BYTES)


def visited_hash(proof: bytes) -> bytes:
    """Return the hash stored to check such a proof."""
    return sha3_256(b"visited" + proof)


def _action(action: Action | None) -> bytes:
    return table.DO.encode(action=b"" if action is None else action_bytes(action))


def encode_payload(payload: Payload) -> bytes:
    """Length, content, and zeros up to the next step of PAD bytes."""
    name = payload.name.encode()
    place = (0, 0, 0)
    if payload.place_m is not None:
        place = (1, round(payload.place_m[0] * MM_PER_M), round(payload.place_m[1] * MM_PER_M))
    out = [table.COUNT_U8.form.pack(len(name)), name, _action(payload.do), table.PLACE.form.pack(*place)]
    out += [table.COUNT_U8.form.pack(len(payload.sends)), *payload.sends]
    out.append(table.COUNT_U16.form.pack(len(payload.ways)))
    out += [_action(way.do) + way.gate.encode() for way in payload.ways]
    content = b"".join(out)
    told = table.COUNT_U32.form.pack(len(content)) + content
    return told.ljust(-(-len(told) // PAD) * PAD, b"\x00")


def parse_payload(raw: bytes) -> Payload:
    """The payload in these bytes; they were sealed, but by whoever wrote the file. Raises: MalformedMission."""
    outer = Reader(raw)
    reader = Reader(outer.behind(table.COUNT_U32))
    if outer.left >= PAD or any(outer.take(outer.left)):
        raise MalformedMission("a payload is not padded with zeros")
    name, do = text_of(reader.behind(table.COUNT_U8)), _parse_action(reader)
    given, x_mm, y_mm = reader.unpack(table.PLACE)
    place = (x_mm / MM_PER_M, y_mm / MM_PER_M) if given else None
    sends = tuple(reader.take(SECRET_BYTES) for _ in range(reader.number(table.COUNT_U8)))
    ways = []
    for _ in range(reader.number(table.COUNT_U16)):
        way_do = _parse_action(reader)
        ways.append(WayOut(parse_gate(reader), way_do))
    reader.end()
    return Payload(name, do, place, sends, tuple(ways))


def _parse_action(reader: Reader) -> Action | None:
    raw = reader.behind(table.DO)
    return parse_action(raw) if raw else None
