"""Cryptography of the sealed profile: stored bytes depend on observations only through scrypt.

Each node has a random secret S and a random gate G. From G and the observation scrypt derives M and W: M is stored and
commits to the key, W decrypts S, and a key derived from S decrypts the payload. Each W and each payload key encrypts
one message, so the nonce is zero. Only this file derives keys of sealed nodes or decrypts them.
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
PAD = 64  # payloads are padded to multiples of this, so that their length reveals little


@dataclass(frozen=True, slots=True)
class WayOut:
    """A way in a payload: the encrypted gate of its target (see `onward`), and the action to get there."""

    gate: Gate
    do: Action | None = None


@dataclass(frozen=True, slots=True)
class Payload:
    """Decrypted content of a sealed node."""

    name: str
    do: Action | None
    place_m: tuple[float, float] | None  # place of the node, map frame, to the mm
    sends: tuple[bytes, ...]  # messages of 32 bytes to send
    ways: tuple[WayOut, ...]  # in the order of the record's ways


def node_salt(gate: bytes, messages: tuple[bytes, ...], header: Header, node: int, alias: int) -> bytes:
    """Return the salt of an alias, derived from the gate and the messages: without them no try is possible."""
    info = b"phalanx mission gate" + header.mission_id + table.OF_ALIAS.form.pack(node, alias)
    return hkdf_sha256(gate + b"".join(sorted(messages)), info, SECRET_BYTES)


def onward(gate: bytes, share: bytes, header: Header, node: int, target: int) -> bytes:
    """Encrypt or decrypt the share of a target's gate with the gate of the node whose payload has it.

    An auditor of a decode can decrypt the payload too, but has only a salt derived from the node's gate, not the gate,
    so that it cannot use the gates in the payload.
    """
    info = b"phalanx mission onward" + header.mission_id + table.OF_WAY.form.pack(node, target)
    pad = hkdf_sha256(gate, info, SECRET_BYTES)
    return bytes(a ^ b for a, b in zip(share, pad, strict=True))


def try_observation(header: Header, canonical: bytes, hint: Hint, salt: bytes) -> tuple[bytes, bytes]:
    """Return (mark M, key W) of an observation, with scrypt; the only slow step.

    The hint is hashed too, because with another offset the same cell would be at another place. A robot could get such
    an offset from an altered start key, an auditor from the robot that it audits.
    """
    coding = header.coding
    out = scrypt(canonical + hint.encode(), salt, log2_n=coding.kdf_log2_n, r=coding.kdf_r, length=table.TRIED.size)
    mark, key = table.TRIED.form.unpack(out)
    return mark, key


def seal_secret(header: Header, node: int, alias: int, key: bytes, secret: bytes) -> bytes:
    """Encrypt the secret S with the key W."""
    return AESGCM(key).encrypt(NONCE, secret, header.digest + table.OF_ALIAS.form.pack(node, alias))


def open_secret(header: Header, node: int, alias: int, key: bytes, sealed: bytes) -> bytes:
    """Decrypt the secret S with the key W. Raises: Altered: the mark matched, so the record or header was changed."""
    try:
        return AESGCM(key).decrypt(NONCE, sealed, header.digest + table.OF_ALIAS.form.pack(node, alias))
    except InvalidTag as error:
        raise Altered("the secret of a matching node does not decrypt") from error


def _payload_key(secret: bytes) -> AESGCM:
    return AESGCM(hkdf_sha256(secret, b"payload", SECRET_BYTES))


def _bound_to(header: Header, node: int, record: NodeRecord) -> bytes:
    return header.digest + table.OF_NODE.form.pack(node) + record.core(Profile.SEALED)


def seal_payload(header: Header, node: int, record: NodeRecord, secret: bytes, payload: Payload) -> bytes:
    """Encrypt a payload with a key derived from S; header, index and record of the node are authenticated."""
    return _payload_key(secret).encrypt(NONCE, encode_payload(payload), _bound_to(header, node, record))


def open_payload(header: Header, node: int, record: NodeRecord, secret: bytes) -> Payload:
    """Decrypt and parse a payload. Raises: Altered: the payload, the record or the header was changed."""
    try:
        raw = _payload_key(secret).decrypt(NONCE, record.payload, _bound_to(header, node, record))
        payload = parse_payload(raw)
    except (InvalidTag, MalformedMission) as error:
        raise Altered("the payload of an opened node does not decrypt") from error
    if len(payload.ways) != len(record.ways) or len(payload.sends) != record.sends:
        raise Altered("a payload does not match its record")
    return payload


def direction_tag(secret: bytes, target: int, sector: int) -> bytes:
    """Return the tag that is stored for the direction of a way; robots try each sector."""
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
    """Return length and content of a payload, padded with zeros to a multiple of PAD bytes."""
    name = payload.name.encode()
    place = (0, 0, 0)
    if payload.place_m is not None:
        place = (1, round(payload.place_m[0] * MM_PER_M), round(payload.place_m[1] * MM_PER_M))
    out = [table.COUNT_U8.form.pack(len(name)), name, _action(payload.do), table.PLACE.form.pack(*place)]
    out += [table.COUNT_U8.form.pack(len(payload.sends)), *payload.sends]
    out.append(table.COUNT_U16.form.pack(len(payload.ways)))
    out += [_action(way.do) + way.gate.encode() for way in payload.ways]
    content = b"".join(out)
    raw = table.COUNT_U32.form.pack(len(content)) + content
    return raw.ljust(-(-len(raw) // PAD) * PAD, b"\x00")


def parse_payload(raw: bytes) -> Payload:
    """Parse decrypted bytes, which are untrusted: anyone may have written the file. Raises: MalformedMission."""
    outer = Reader(raw)
    reader = Reader(outer.behind(table.COUNT_U32))
    if outer.left >= PAD or any(outer.take(outer.left)):
        raise MalformedMission("a payload has invalid padding")
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
