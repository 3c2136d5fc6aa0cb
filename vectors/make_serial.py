"""Writes vectors/serial.json: streams of bytes and the payloads in them, which Python and C both find.

Frames are stuffed here as COBS was published, byte by byte, with a CRC taken bit by bit: neither is the code's under
test.
Run it as `python vectors/make_serial.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LONGEST = 2052  # of a payload to a board


def crc(raw: bytes) -> bytes:
    value = 0xFFFFFFFF
    for byte in raw:
        for k in range(8):
            bit = value & 1 ^ byte >> k & 1
            value = value >> 1 ^ (0xEDB88320 if bit else 0)
    return (value ^ 0xFFFFFFFF).to_bytes(4, "little")


def stuffed(raw: bytes) -> bytes:
    done, block = b"", b""
    for byte in raw:
        if byte:
            block += bytes([byte])
        if not byte or len(block) == 254:
            done += bytes([len(block) + 1]) + block
            block, full = b"", bool(byte)
    if block or not raw or not (full and raw[-1]):
        done += bytes([len(block) + 1]) + block
    return done


def frame(payload: bytes) -> bytes:
    return b"\0" + stuffed(payload + crc(payload)) + b"\0"


def cases() -> list[dict[str, Any]]:
    chance = random.Random(11)  # noqa: S311

    def payload(length: int) -> bytes:
        return bytes(chance.choice([0, 0, 1, 255, chance.randrange(256)]) for _ in range(length))

    def case(name: str, stream: bytes, *payloads: bytes) -> dict[str, Any]:
        return {"name": name, "stream": stream.hex(), "payloads": [each.hex() for each in payloads]}

    rows = [case(f"{n} bytes", frame(p), p) for n in (3, 4, 20, 249, 250, 251, 252, 600) for p in [payload(n)]]
    rows += [case(f"{n} zeros", frame(bytes(n)), bytes(n)) for n in (3, 260)]
    rows += [case(f"{n} bytes, no zero", frame(b"a" * n), b"a" * n) for n in (249, 250, 251, 503, 504, 505, LONGEST)]
    one, two = payload(30), payload(40)
    f, g = frame(one), frame(two)
    middle = len(f) // 2
    rows += [
        case("one after the other", f + g, one, two),
        case("one mark between", f + g[1:], one, two),
        case("many marks", b"\0\0\0" + f + b"\0\0" + g + b"\0", one, two),
        case("rubbish before", b"\x05garbage" + f, one),
        case("rubbish with marks before", b"\xff\0\x01\0\x02\x01\0\xfe" + f, one),
        case("rubbish between", f + bytes(range(256)) + g, one, two),
        case("rubbish inside", f[:middle] + b"\x07" + f[middle:] + g, two),
        case("a mark inside", f[:middle] + b"\0" + f[middle:] + g, two),
        case("altered", f[:middle] + bytes([f[middle] ^ 1 or 2]) + f[middle + 1 :] + g, two),
        case("cut off", f[:middle] + g, two),
        case("cut off before its last mark", f[:-1] + g, one, two),
        case("begun in the middle", f[middle:] + g, two),
        case("a length that leads past the end", b"\0\xff" + f + g, one, two),
        case("too long", frame(b"a" * (LONGEST + 1)) + g, two),
        case("far too long", b"a" * 5000 + g, two),
        case("too short", frame(b"ab") + g, two),
        case("nothing but a CRC", frame(b"") + g, two),
        case("the end is missing", f + g[:-1], one),
    ]
    return rows


def text() -> str:
    """The file, a case a line."""
    return '{"cases": [\n' + ",\n".join(json.dumps(case) for case in cases()) + "\n]}\n"


if __name__ == "__main__":
    (HERE / "serial.json").write_text(text())
