"""Writes vectors/places.json and routes.json: where robots are and go, as frames tell it; TypeScript reads them.

Packed here record by record, as docs/spec/vocabulary.md says it, not by the code under test. Run it as
`python vectors/make_places.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import base64
import json
import random
import struct
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent

Row = tuple[int, int, int, int]


def b64(raw: bytes) -> str:
    return base64.urlsafe_b64encode(raw).decode()


def packed(rows: list[Row]) -> list[Any]:
    left, top = min(row[1] for row in rows), min(row[2] for row in rows)
    extent = max(max(x - left, y - top) for _, x, y, _ in rows)
    step = max(1, -(-extent // 65535))
    first = due = rows[0][0]
    records = b""
    for number, x, y, direction in rows:
        while number - due >= 181:
            records += struct.pack("<HHH", 181 * 360, 0, 0)
            due += 181
        word = 360 * (number - due) + direction
        records += struct.pack("<HHH", word, round((x - left) / step), round((y - top) / step))
        due = number + 1
    return [first, left, top, step, b64(records)]


def read(rows: list[Row], places: list[Any]) -> list[Row]:
    """What arrives: with a step of more than 1 mm, places are rounded to it."""
    _, left, top, step, _ = places

    def rounded(at: int, edge: int) -> int:
        return edge + step * round((at - edge) / step)

    return [(n, rounded(x, left), rounded(y, top), d) for n, x, y, d in rows]


def cases() -> list[dict[str, Any]]:
    chance = random.Random(0)  # noqa: S311
    some = sorted(chance.sample(range(3000), 40))
    good: dict[str, list[Row]] = {
        "one robot": [(7, -12, 3456, 359)],
        "neighbours": [(0, 0, 0, 0), (1, 2000, 1000, 90), (2, 1999, 1, 180)],
        "180 left out": [(3, 5, 5, 1), (184, 6, 6, 2)],
        "181 left out": [(3, 5, 5, 1), (185, 6, 6, 2)],
        "a thousand left out": [(3, 5, 5, 1), (1004, 6, 6, 2), (1005, 7, 7, 3)],
        "exact up to 65 m": [(0, -32767, 0, 10), (1, 32768, 65535, 20)],
        "in steps of 2 mm beyond": [(0, 0, 0, 10), (1, 65536, 30001, 20), (2, 12345, 7, 30)],
        "far away": [(0, -10_000_000, 10_000_000, 45), (1, 9_999_999, -9_999_999, 46)],
        "at random": [(n, chance.randrange(2000), chance.randrange(2000), chance.randrange(360)) for n in some],
    }
    one = packed(good["one robot"])
    bad: dict[str, Any] = {
        "no piece": None,
        "no list": "places",
        "too short": one[:4],
        "a number too much to count": [1e300, *one[1:]],
        "a corner that is none": [7, "0", 0, 1, one[4]],
        "a step that is none": [7, 0, 0, None, one[4]],
        "no text": [7, 0, 0, 1, 5],
        "not base64url": [7, 0, 0, 1, "AAAA+AAA"],
        "a letter beyond ASCII": [7, 0, 0, 1, "AAAA\u0141AAA"],
        "half a record": [7, 0, 0, 1, "AAAA"],
        "more than anybody keeps": [7, 0, 0, 1, "A" * 8 * 4001],
    }
    return [
        {"name": name, "rows": rows, "places": [piece := packed(rows)], "read": read(rows, piece)}
        for name, rows in good.items()
    ] + [
        {"name": "two pieces, and what is none between them", "places": [one, 7, one], "read": 2 * good["one robot"]},
        {
            "name": "a word beyond the last",
            "places": [[0, 0, 0, 1, b64(struct.pack("<6H", 65535, 1, 2, 10, 3, 4))]],
            "read": [(181, 3, 4, 10)],
        },
        *({"name": name, "places": [piece], "read": []} for name, piece in bad.items()),
        {"name": "no list at all", "places": {"0": one}, "read": []},
    ]


def route_cases() -> list[dict[str, Any]]:
    good = {
        "where it stood, and one point": [(100, 200), (300, 50)],
        "no route": [],
        "exact up to 65 m": [(-5, 0), (65530, 65535)],
        "in steps of 2 mm beyond": [(0, 0), (65536, 30000)],
        "as many points as a server takes": [(n * 7 % 2000, n * 13 % 2000) for n in range(65)],
    }
    packed_points = {}
    for name, points in good.items():
        left, top = (min((point[axis] for point in points), default=0) for axis in (0, 1))
        step = max(1, -(-max((max(x - left, y - top) for x, y in points), default=0) // 65535))
        raw = b"".join(struct.pack("<HH", (x - left) // step, (y - top) // step) for x, y in points)
        packed_points[name] = [7, left, top, step, b64(raw).rstrip("=")]
    one = packed_points["where it stood, and one point"]
    bad: dict[str, Any] = {
        "no list": "route",
        "too short": one[:4],
        "no number": ["7", *one[1:]],
        "no text": [*one[:4], 5],
        "half a point": [*one[:4], "AAA"],
        "more points than anybody gives": [*one[:4], b64(bytes(4 * 66)).rstrip("=")],
    }
    return [
        {"name": name, "points": points, "route": packed_points[name], "read": points} for name, points in good.items()
    ] + [{"name": name, "route": route, "read": None} for name, route in bad.items()]


def texts() -> dict[str, str]:
    """Return both files by name, with a case on each line."""
    return {
        name: '{"cases": [\n' + ",\n".join(json.dumps(case, ensure_ascii=True) for case in made) + "\n]}\n"
        for name, made in (("places.json", cases()), ("routes.json", route_cases()))
    }


if __name__ == "__main__":
    for name, text in texts().items():
        (FOLDER / name).write_text(text)
