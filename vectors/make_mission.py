"""Writes vectors/mission.json: canonical bytes, hashes, locks and files of encoded missions.

Everything is packed here by hand from docs/spec/mission.md, with hashlib, hmac and cryptography, and not by the code
under test. Run it as `python vectors/make_mission.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import struct
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

HERE = Path(__file__).parent
TYPES = ("doorway", "corner_convex", "concave_left", "concave_right", "room", "qr")
MISSION_ID = bytes(range(16))
OPERATOR = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))


def sha3(raw: bytes) -> bytes:
    return hashlib.sha3_256(raw).digest()


def hkdf(secret: bytes, info: bytes) -> bytes:
    """RFC 5869 with SHA-256, no salt, 32 bytes: one round of expansion."""
    return hmac.digest(hmac.digest(bytes(32), secret, "sha256"), info + b"\x01", "sha256")


def tlv(tag: int, content: bytes) -> bytes:
    return struct.pack("<BH", tag, len(content)) + content


def landmark(kind: str, x: int, y: int, turn: int = -1, area: int = -1, text: str | None = None) -> bytes:
    content = struct.pack("<Biihi", TYPES.index(kind), x, y, turn, area)
    return tlv(1, content + (b"" if text is None else sha3(text.encode())))


def position(x: int, y: int) -> bytes:
    return tlv(2, struct.pack("<ii", x, y))


def canonical_cases() -> list[dict[str, Any]]:
    lift = b"\x04lift" + b"\x05floor\x00" + struct.pack("<q", 2000) + b"\x02to\x01\x04roof"
    door = {"type": "doorway", "x": 30, "y": -7, "bin": 3}
    rows: list[tuple[str, dict[str, Any], bytes]] = [
        ("nothing", {}, b""),
        ("a doorway", {"landmark": door}, landmark("doorway", 30, -7, 3)),
        (
            "a room with an area",
            {"landmark": {"type": "room", "x": 1, "y": 2, "area": 26}},
            landmark("room", 1, 2, -1, 26),
        ),
        (
            "a code with a text",
            {"landmark": {"type": "qr", "x": -1, "y": 0, "bin": 23, "text": "shelf 3"}},
            landmark("qr", -1, 0, 23, -1, "shelf 3"),
        ),
        ("a position", {"position": [2**30, -(2**30)]}, position(2**30, -(2**30))),
        (
            "two readings, sorted by their digests",
            {"sensors": ["red", "warm"]},
            b"".join(sorted(tlv(3, sha3(word)) for word in (b"red", b"warm"))),
        ),
        ("an action", {"action": ["lift", {"floor": 2, "to": "roof"}]}, tlv(4, lift)),
        ("a window of time", {"window": -3}, tlv(5, struct.pack("<q", -3))),
        ("a message", {"messages_hex": ["00" * 32]}, tlv(6, sha3(bytes(32)))),
        ("what the node before released", {"previous_hex": "aa" * 32}, tlv(7, b"\xaa" * 32)),
        ("a direction", {"direction": [5, 120]}, tlv(8, struct.pack("<HH", 5, 120))),
        (
            "a doorway, a reading and a direction",
            {"landmark": door, "sensors": ["red"], "direction": [119, 120]},
            landmark("doorway", 30, -7, 3) + tlv(3, sha3(b"red")) + tlv(8, struct.pack("<HH", 119, 120)),
        ),
    ]
    return [
        {
            "name": name,
            "expect": "ok",
            **words,
            "canonical_hex": (b"\x01" + raw).hex(),
            "hash_hex": sha3(b"\x01" + raw).hex(),
        }
        for name, words, raw in rows
    ]


def header(profile: int, nodes: int, *, flags: int = 0, end: int = 2**64 - 1, shapes: tuple[int, ...] = ()) -> bytes:
    fixed = struct.pack("<4sBBB16sQQ", b"PHXM", 2, profile, flags, MISSION_ID, 0, end)
    coding = struct.pack("<HHHIIBB", 100 if profile == 0 else 400, 24, 120, 10_000, 20_000, 4, 8)
    tail = struct.pack(f"<BB{len(shapes)}H", 0, len(shapes), *shapes)
    return fixed + coding + tail + struct.pack("<I", nodes)


# A start at a position (3.0, 1.5), and a final doorway at (9.03, 12.0), 0.3 rad round.
SEEN = (b"\x01" + position(30, 15), b"\x01" + landmark("doorway", 90, 120, 1))
POSITION_SHAPE, DOOR_SHAPE = 7, 1 | 1 << 3


def paper_file() -> bytes:
    head = header(0, 2, shapes=(POSITION_SHAPE, DOOR_SHAPE))
    way = sha3(SEEN[0] + tlv(8, struct.pack("<HH", 20, 120)))
    # The next door that looks the same is 11.8 m away.
    # 0.3 rad is 382 tenths of a milliradian past the middle of the bin at 15 degrees.
    cores = (
        struct.pack("<BHBBBH", 1, 30, 0, 0, 1, 1)
        + sha3(SEEN[0])
        + struct.pack("<hhhhB", 0, 0, 0, 0, 255)
        + struct.pack("<IB", 1, 1)
        + way,
        struct.pack("<BHBBBH", 2, 0, 25, 1, 1, 0) + sha3(SEEN[1]) + struct.pack("<hhhhB", 30, 0, 382, 0, 118),
    )
    out = [head]
    for i, (core, seen) in enumerate(zip(cores, SEEN, strict=True)):
        bound = b"\x11bind" + sha3(head) + struct.pack("<IH", i, len(seen)) + seen + core
        out.append(core + sha3(bound))
    return b"".join(out)


def sealed_file() -> tuple[bytes, bytes]:
    """(file without a trailer, start key)."""
    head = header(1, 1)
    gate, secret = b"\x47" * 32, b"\x53" * 32
    seen = b"\x01" + position(7, 4)
    salt = hkdf(gate, b"phalanx mission gate" + MISSION_ID + struct.pack("<IB", 0, 0))
    # 3.0 m is the 7th or 8th cell of 0.4 m: it lies 200 mm from 2.8 m; 1.5 m lies 100 mm before 1.6 m.
    hint = struct.pack("<HhhhhB", POSITION_SHAPE, 200, -100, 0, 0, 255)
    out = hashlib.scrypt(seen + hint, salt=salt, n=16, r=8, p=1, dklen=64)
    bound = sha3(head) + struct.pack("<I", 0)
    locked = AESGCM(out[32:]).encrypt(bytes(12), secret, bound + b"\x00")
    visited = sha3(b"visited" + hkdf(secret, b"visited"))
    core = struct.pack("<BHBBBH", 3, 0, 0, 0, 1, 0) + out[:32] + locked + visited
    told = b"\x04dock" + struct.pack("<H", 0) + struct.pack("<Bii", 1, 3000, 1500) + b"\x00" + struct.pack("<H", 0)
    padded = (struct.pack("<I", len(told)) + told).ljust(64, b"\x00")
    payload = AESGCM(hkdf(secret, b"payload")).encrypt(bytes(12), padded, bound + core)
    record = core + struct.pack("<H", len(payload)) + payload
    key = b"PHXK\x02" + MISSION_ID + struct.pack("<II", 1, 0) + gate + b"\x01" + hint + struct.pack("<H", 0)
    return head + record, key


def signed(body: bytes) -> bytes:
    public = OPERATOR.public_key().public_bytes_raw()
    return body + b"\x01" + public + OPERATOR.sign(b"phalanx mission file 1\x00" + body)


def file_cases() -> list[dict[str, Any]]:
    paper = paper_file()
    sealed, key = sealed_file()
    head = len(header(0, 2, shapes=(POSITION_SHAPE, DOOR_SHAPE)))

    def patched(raw: bytes, at: int, new: bytes) -> bytes:
        return raw[:at] + new + raw[at + len(new) :]

    place = {"landmark": None, "x_m": 3.0, "y_m": 1.5}
    good = [
        {"name": "paper, signed", "file_hex": signed(paper).hex(), "walk": [place, {"landmark": "doorway"}]},
        {"name": "paper, unsigned", "file_hex": (paper + b"\x00").hex(), "walk": [place, {"landmark": "doorway"}]},
        {"name": "sealed, signed", "file_hex": signed(sealed).hex(), "key_hex": key.hex(), "walk": [place]},
    ]
    bad = {
        "empty": ("MalformedMission", b""),
        "another magic": ("MalformedMission", patched(paper + b"\x00", 0, b"PHXN")),
        "version 1": ("MalformedMission", patched(paper + b"\x00", 4, b"\x01")),
        "no such profile": ("MalformedMission", patched(paper + b"\x00", 5, b"\x02")),
        "no such flag": ("MalformedMission", patched(paper + b"\x00", 6, b"\x08")),
        "it ends before it begins": ("MalformedMission", patched(paper + b"\x00", 31, bytes(8))),
        "cells of no size": ("MalformedMission", patched(paper + b"\x00", 39, bytes(2))),
        "2^31 nodes": ("MalformedMission", patched(paper + b"\x00", head - 4, struct.pack("<I", 1 << 31))),
        "no nodes": ("MalformedMission", patched(paper + b"\x00", head - 4, bytes(4))),
        "a way to nowhere": ("MalformedMission", patched(paper + b"\x00", head + 8 + 41, struct.pack("<I", 2))),
        "a byte too many": ("MalformedMission", paper + b"\x00\x00"),
        "half a signature": ("MalformedMission", signed(paper)[:-1]),
        "neither signed nor unsigned": ("MalformedMission", paper + b"\x02"),
        "signed, then altered": ("NotAuthentic", patched(signed(paper), head + 20, b"\x00")),
        "nobody signed it": ("Unsigned", paper + b"\x00"),
    }
    rows = [{**case, "expect": "ok"} for case in good]
    return rows + [{"name": name, "expect": error, "file_hex": raw.hex()} for name, (error, raw) in bad.items()]


def sealed_cases() -> list[dict[str, Any]]:
    rows = []
    for name, messages in {"no message": [], "two messages": ["11" * 32, "00" * 32]}.items():
        gate, node, alias = bytes(range(32)), 7, 2
        secret = gate + b"".join(sorted(bytes.fromhex(message) for message in messages))
        salt = hkdf(secret, b"phalanx mission gate" + MISSION_ID + struct.pack("<IB", node, alias))
        hint = struct.pack("<HhhhhB", POSITION_SHAPE, 20, -10, 0, 0, 7)
        out = hashlib.scrypt(SEEN[1] + hint, salt=salt, n=16, r=8, p=1, dklen=64)
        rows.append(
            {
                "name": name,
                "expect": "ok",
                "gate_hex": gate.hex(),
                "messages_hex": messages,
                "node": node,
                "alias": alias,
                "canonical_hex": SEEN[1].hex(),
                "offset": [20, -10, 0, 0, 7],
                "salt_hex": salt.hex(),
                "mark_hex": out[:32].hex(),
                "key_hex": out[32:].hex(),
            }
        )
    return rows


def mission() -> dict[str, Any]:
    return {"canonical": canonical_cases(), "locks": sealed_cases(), "cases": file_cases()}


if __name__ == "__main__":
    (HERE / "mission.json").write_text(json.dumps(mission(), indent=1) + "\n")
    print("vectors/mission.json")
