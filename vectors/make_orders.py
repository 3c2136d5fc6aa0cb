"""Writes vectors/orders.json: frames, and whether a robot that has heard nothing yet obeys them.

Fields are packed and signed here with `struct` and the package cryptography: neither is the code's under test.
Run it as `python vectors/make_orders.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

HERE = Path(__file__).parent
GATEWAY, OPERATOR, STRANGER = (Ed25519PrivateKey.from_private_bytes(bytes([n]) * 32) for n in (1, 2, 3))
MISSION, ROBOT = 7, 3
NOTHING, WHEELS, LED, ROUTE, STOP, GO = range(6)
ORDER_OF_L = 2**252 + 27742317777372353535851937790883648493  # of Ed25519's group


def order(
    action: int,
    body: bytes = b"",
    *,
    key: Ed25519PrivateKey = GATEWAY,
    mission: int = MISSION,
    who: int = 0,
    number: int = 1,
    said: int = 1000,
    robot: int = ROBOT,
    kind: int = 4,
) -> bytes:
    frame = struct.pack("<BIBQQHB", kind, mission, who, number, said, robot, action) + body
    return frame + key.sign(frame)


def cases() -> list[dict[str, Any]]:
    drive, colour = struct.pack("<bb", 60, -40), bytes((1, 2, 3))
    way = struct.pack("<HB", 60, 2) + struct.pack("<4H", 500, 900, 900, 900)
    good = order(WHEELS, drive)
    s = int.from_bytes(good[-32:], "little")
    longest = struct.pack("<HB", 60, 32) + bytes(4 * 32)
    rows = [
        ("wheels", good, "obeyed"),
        ("led", order(LED, colour), "obeyed"),
        ("route", order(ROUTE, way), "obeyed"),
        ("longest route", order(ROUTE, longest), "obeyed"),
        ("empty route", order(ROUTE, struct.pack("<HB", 1, 0)), "obeyed"),
        ("beacon to all", order(NOTHING, robot=0), "obeyed"),
        ("stop to all", order(STOP, robot=0, number=0), "obeyed"),
        ("the operator's stop", order(STOP, robot=0, number=0, who=1, key=OPERATOR), "obeyed"),
        ("go", order(GO), "obeyed"),
        ("highest number", order(WHEELS, drive, number=2**63 - 1), "obeyed"),
        ("unsigned", good[:-64] + bytes(64), "ignored"),
        ("by a stranger", order(WHEELS, drive, key=STRANGER), "ignored"),
        ("by the operator in the gateway's name", order(WHEELS, drive, key=OPERATOR), "ignored"),
        ("by a third signer", order(WHEELS, drive, who=2), "ignored"),
        ("another mission's", order(WHEELS, drive, mission=8), "ignored"),
        ("another robot's", order(WHEELS, drive, robot=4), "ignored"),
        ("without a number", order(WHEELS, drive, number=0), "ignored"),
        ("number 2^63", order(WHEELS, drive, number=2**63), "ignored"),
        ("number 2^64 - 1", order(WHEELS, drive, number=2**64 - 1), "ignored"),
        ("stop with a number", order(STOP, number=1), "ignored"),
        ("said at 2^63", order(WHEELS, drive, said=2**63), "ignored"),
        ("another kind", order(WHEELS, drive, kind=7), "ignored"),
        ("no action", order(6), "ignored"),
        ("wheels without a body", order(WHEELS), "ignored"),
        ("stop with a body", order(STOP, b"\0", number=0), "ignored"),
        ("a byte more", order(WHEELS, drive + b"\0"), "ignored"),
        ("a point too few", order(ROUTE, way[:-4]), "ignored"),
        ("a point too many", order(ROUTE, struct.pack("<HB", 60, 33) + bytes(4 * 33)), "ignored"),
        ("never near enough", order(ROUTE, struct.pack("<HB", 0, 0)), "ignored"),
        ("altered", good[:25] + b"\x3d" + good[26:], "ignored"),
        ("cut", good[:-1], "ignored"),
        ("nothing", b"", "ignored"),
        # The same signature with another s would verify where nobody looks whether it is reduced.
        ("s not reduced", good[:-32] + (s + ORDER_OF_L).to_bytes(32, "little"), "ignored"),
    ]
    return [{"name": name, "frame": frame.hex(), "expect": expect} for name, frame, expect in rows]


def document() -> dict[str, Any]:
    keys = {
        name: key.public_key().public_bytes_raw().hex() for name, key in (("gateway", GATEWAY), ("operator", OPERATOR))
    }
    return {"mission": MISSION, "robot": ROBOT, **keys, "cases": cases()}


if __name__ == "__main__":
    (HERE / "orders.json").write_text(json.dumps(document(), indent=1) + "\n")
