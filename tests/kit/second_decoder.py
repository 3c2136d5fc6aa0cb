"""A second decoder of missions, written from docs/spec/mission.md alone: nothing of phalanx is imported here.

It knows what there is to be experienced exactly, so it searches no cells: a file, a start key and a world give what the
author wrote. Whatever it cannot explain to the last byte is an error.
"""

from __future__ import annotations

import hmac
import math
import struct
from dataclasses import dataclass
from hashlib import scrypt, sha3_256
from itertools import combinations, product

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

TYPES = ("doorway", "corner_convex", "concave_left", "concave_right", "room", "qr")
POSITION = 7
SHAPE = (("place", 3), ("oriented", 1), ("area", 1), ("text", 1), ("sensors", 2), ("messages", 2), ("action", 1),
         ("time", 1), ("previous", 1))  # fmt: skip
ASKED = (("oriented", "facing"), ("area", "area"), ("text", "text"))
PAPER, SEALED = 0, 1
EMPTY, DIRECTION, ACTION = 0, 1, 2
Act = tuple[str, tuple[tuple[str, float | str], ...]]


@dataclass(frozen=True)
class Thing:
    """A landmark, or with the type "position" where the robot is."""

    type: str
    x: float
    y: float
    facing: float | None = None
    area: float | None = None
    text: str | None = None


@dataclass(frozen=True)
class World:
    """All that can be experienced."""

    things: tuple[Thing, ...] = ()
    sensors: tuple[bytes, ...] = ()
    actions: tuple[Act, ...] = ()
    times: tuple[float, ...] = ()
    messages: tuple[bytes, ...] = ()


@dataclass(frozen=True)
class Way:
    target: int
    sector: int | None
    do: Act | None


@dataclass(frozen=True)
class Node:
    """A decoded node."""

    flags: int
    timeout_s: int
    reach_dm: int
    name: str | None  # the paper profile has none
    alias: int
    place: tuple[float, float] | None
    facing: float | None
    do: Act | None
    sends: tuple[bytes, ...]
    ways: tuple[Way, ...]


class Bytes:
    def __init__(self, raw: bytes) -> None:
        self.raw, self.at = raw, 0

    def take(self, count: int) -> bytes:
        if self.at + count > len(self.raw):
            raise ValueError("too short")
        self.at += count
        return self.raw[self.at - count : self.at]

    def read(self, form: str) -> tuple:
        return struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))

    def one(self, form: str):
        return self.read(form)[0]

    def end(self) -> None:
        if self.at != len(self.raw):
            raise ValueError("too long")


def sha3(raw: bytes) -> bytes:
    return sha3_256(raw).digest()


def hkdf(secret: bytes, info: bytes) -> bytes:
    return HKDF(algorithm=SHA256(), length=32, salt=None, info=info).derive(secret)


# --- the file -------------------------------------------------------------------------------------------------------


class File:
    """A file, taken apart; its header and records keep their bytes, for what is bound to them."""

    def __init__(self, raw: bytes) -> None:
        r = Bytes(raw)
        magic, version, self.profile, self.flags, self.id, begin, end = r.read("4sBBB16sQQ")
        coding = r.read("HHHIIBB")
        self.delta_mm, self.bins, self.sectors, self.window_ms, self.area_cm2, self.log2_n, self.r = coding
        if magic != b"PHXM" or version != 2 or self.profile > SEALED or self.flags > 7 or not begin < end:
            raise ValueError("no mission file")
        if 0 in coding:
            raise ValueError("a step of no size")
        self.robots = rising(r)
        self.shapes = rising(r)
        count = r.one("I")
        if not 0 < count <= 1 << 20:
            raise ValueError("no nodes, or too many")
        self.digest = sha3(raw[: r.at])
        self.records = [Record(self, r) for _ in range(count)]
        if any(target >= count for record in self.records for target, *_ in record.ways):
            raise ValueError("a way to nowhere")
        self.start = r.take(r.one("I")) if self.flags & 4 else b""
        signed_part, signed = raw[: r.at], r.one("B")
        if signed > 1:
            raise ValueError("neither signed nor unsigned")
        if signed:
            key, signature = r.read("32s64s")
            Ed25519PublicKey.from_public_bytes(key).verify(signature, b"phalanx mission file 1\0" + signed_part)
        r.end()


def rising(r: Bytes) -> tuple[int, ...]:
    numbers = tuple(r.one("H") for _ in range(r.one("B")))
    if any(a >= b for a, b in zip(numbers, numbers[1:], strict=False)):
        raise ValueError("not rising")
    return numbers


class Record:
    def __init__(self, file: File, r: Bytes) -> None:
        begin = r.at
        self.flags, self.timeout_s, self.reach_dm, self.sends, aliases, ways = r.read("BHBBBH")
        if file.profile == PAPER:
            self.aliases = [(r.take(32), r.take(9)) for _ in range(aliases)]  # mark; offset and apart
            self.ways = [(*r.read("IB"), [r.take(32) for _ in range(aliases)]) for _ in range(ways)]
        else:
            self.aliases = [(r.take(32), r.take(48)) for _ in range(aliases)]  # mark; secret
            self.ways = [r.read("I16s") for _ in range(ways)]
            self.visited = r.take(32)
        self.core = r.raw[begin : r.at]
        if file.profile == PAPER:
            self.bindings = [r.take(32) for _ in range(aliases)]
        else:
            self.payload = r.take(r.one("H"))


# --- what is hashed -------------------------------------------------------------------------------------------------


def observable(tag: int, content: bytes) -> bytes:
    return struct.pack("<BH", tag, len(content)) + content


def short(text: str) -> bytes:
    raw = text.encode()
    return bytes([len(raw)]) + raw


def action_bytes(do: Act) -> bytes:
    out = short(do[0])
    for name, value in sorted(do[1]):
        is_text = isinstance(value, str)
        out += short(name) + (b"\1" + short(value) if is_text else b"\0" + struct.pack("<q", round(value * 1000)))
    return out


def action_of(raw: bytes) -> Act | None:
    if not raw:
        return None
    r = Bytes(raw)
    name, args = r.take(r.one("B")).decode(), []
    while r.at < len(raw):
        key = r.take(r.one("B")).decode()
        args.append((key, r.take(r.one("B")).decode() if r.one("B") else r.one("q") / 1000))
    return name, tuple(args)


def canonical(
    place: bytes = b"",
    sensors: tuple[bytes, ...] = (),
    do: Act | None = None,
    window: int | None = None,
    messages: tuple[bytes, ...] = (),
    previous: bytes | None = None,
) -> bytes:
    out = b"\1" + place
    out += b"".join(observable(3, digest) for digest in sorted(map(sha3, sensors)))
    out += observable(4, action_bytes(do)) if do else b""
    out += observable(5, struct.pack("<q", window)) if window is not None else b""
    out += b"".join(observable(6, digest) for digest in sorted(map(sha3, messages)))
    return out + (observable(7, previous) if previous is not None else b"")


def place_bytes(cell: tuple[int, int, int, int], place: int, text: str | None) -> bytes:
    if place == POSITION:
        return observable(2, struct.pack("<ii", *cell[:2]))
    digest = b"" if text is None else sha3(text.encode())
    return observable(1, struct.pack("<Biihi", place - 1, *cell) + digest)


def cell_of(file: File, shape: dict[str, int], offset: tuple[int, ...], thing: Thing) -> tuple[int, int, int, int]:
    delta, bin_rad, turn, area = file.delta_mm / 1000, math.tau / file.bins, -1, -1
    if shape["oriented"]:
        turn = round((thing.facing - offset[2] * 1e-4) / bin_rad) % (file.bins // (2 if thing.type == "doorway" else 1))
    if shape["area"]:
        area = max(0, round((thing.area - offset[3] * 0.01) / (file.area_cm2 / 10_000)))
    return round((thing.x - offset[0] / 1000) / delta), round((thing.y - offset[1] / 1000) / delta), turn, area


def shape_of(code: int) -> dict[str, int]:
    shape = {}
    for name, bits in SHAPE:
        shape[name], code = code & ((1 << bits) - 1), code >> bits
    return shape


# --- decoding -------------------------------------------------------------------------------------------------------


class Decoder:
    """Opens what can be opened, until nothing more does."""

    def __init__(self, raw: bytes, key: bytes | None, world: World) -> None:
        self.file, self.world = File(raw), world
        self.heard = list(world.messages)
        self.nodes: dict[int, Node] = {}
        self.marks: dict[int, bytes] = {}
        self.shares: dict[int, dict[int, tuple[bytes, list[bytes]]]] = {}  # by node, by where it comes from
        if self.file.profile == SEALED:
            self.take_key(key if key is not None else self.file.start)
        while any(self.try_node(v) for v in range(len(self.file.records)) if v not in self.nodes):
            pass

    def take_key(self, raw: bytes) -> None:
        r = Bytes(raw)
        magic, version, mission, count = r.read("4sB16sI")
        if (magic, version, mission) != (b"PHXK", 2, self.file.id):
            raise ValueError("another mission's start key")
        for _ in range(count):
            node = r.one("I")
            self.shares[node] = {-1: gate_of(r)}
        for _ in range(r.one("H")):
            r.take(r.one("B")).decode()  # its name, for the controller
            self.heard.append(r.take(32))
        r.end()

    def before(self, v: int) -> list[int]:
        return [u for u, record in enumerate(self.file.records) if any(way[0] == v for way in record.ways)]

    def try_node(self, v: int) -> bool:
        record = self.file.records[v]
        if record.flags & 4 and not self.nodes.keys() >= set(self.before(v)):
            return False
        return self.try_paper(v, record) if self.file.profile == PAPER else self.try_sealed(v, record)

    def conjunctions(self, shape: dict[str, int], offset: tuple[int, ...]):
        """(thing, cell, canonical place, sensors, action, window) of all that has this shape."""
        things = [None]
        if shape["place"]:
            type_ = "position" if shape["place"] == POSITION else TYPES[shape["place"] - 1]
            asked = [field for name, field in ASKED if shape[name]]
            things = [t for t in self.world.things if t.type == type_ and None not in [getattr(t, a) for a in asked]]
        windows = [math.floor(t * 1000 / self.file.window_ms) for t in self.world.times] if shape["time"] else [None]
        for thing, sensors, do, window in product(
            things,
            combinations(self.world.sensors, shape["sensors"]),
            self.world.actions if shape["action"] else [None],
            windows,
        ):
            cell = cell_of(self.file, shape, offset, thing) if thing else None
            place = place_bytes(cell, shape["place"], thing.text if shape["text"] else None) if thing else b""
            yield cell, place, sensors, do, window

    def try_paper(self, v: int, record: Record) -> bool:
        released = [self.marks[u] for u in self.before(v) if u in self.marks]
        for (a, (mark, packed)), code in product(enumerate(record.aliases), self.file.shapes):
            shape, offset = shape_of(code), struct.unpack("<hhhhB", packed)
            for cell, place, sensors, do, window in self.conjunctions(shape, offset):
                for messages, previous in product(
                    combinations(self.heard, shape["messages"]), released if shape["previous"] else [None]
                ):
                    observed = canonical(place, sensors, do, window, messages, previous)
                    if sha3(observed) != mark:
                        continue
                    bound = struct.pack("<IH", v, len(observed)) + observed + record.core
                    if record.bindings[a] != sha3(b"\x11bind" + self.file.digest + bound):
                        raise ValueError("bound to another")
                    self.marks[v] = mark
                    ways = tuple(self.paper_way(way, a, mark, observed) for way in record.ways)
                    sends = tuple(sha3(b"\x10message" + bytes([i]) + observed) for i in range(record.sends))
                    self.open(v, record, None, a, self.middle(offset, cell), do, sends, ways)
                    return True
        return False

    def paper_way(self, way, a: int, mark: bytes, observed: bytes) -> Way:
        target, kind, hashes = way
        if kind == EMPTY:
            if any(hashes[a]):
                raise ValueError("not empty")
            return Way(target, None, None)
        if kind == ACTION:
            return Way(
                target,
                None,
                next(do for do in self.world.actions if sha3(canonical(do=do, previous=mark)) == hashes[a]),
            )
        of = self.file.sectors
        directions = (observed + observable(8, struct.pack("<HH", sector, of)) for sector in range(of))
        return Way(target, [sha3(each) for each in directions].index(hashes[a]), None)

    def try_sealed(self, v: int, record: Record) -> bool:
        shares = self.shares.get(v, {})
        if not shares:
            return False
        hints = next(iter(shares.values()))[1]
        gate = next(iter(shares.values()))[0]
        if record.flags & 4:
            gate = bytes(32)
            for share, _ in shares.values():
                gate = xor(gate, share)
        for a, (hint, (mark, sealed)) in enumerate(zip(hints, record.aliases, strict=True)):
            code, *offset = struct.unpack("<HhhhhB", hint)
            shape = shape_of(code)
            for cell, place, sensors, do, window in self.conjunctions(shape, tuple(offset)):
                for messages in combinations(self.heard, shape["messages"]):
                    info = b"phalanx mission gate" + self.file.id + struct.pack("<IB", v, a)
                    salt = hkdf(gate + b"".join(sorted(messages)), info)
                    said = canonical(place, sensors, do, window) + hint
                    n, memory = 1 << self.file.log2_n, 1 << 26
                    out = scrypt(said, salt=salt, n=n, r=self.file.r, p=1, maxmem=memory, dklen=64)
                    if out[:32] == mark:
                        bound = self.file.digest + struct.pack("<I", v)
                        secret = AESGCM(out[32:]).decrypt(bytes(12), sealed, bound + bytes([a]))
                        self.open_sealed(v, record, gate, secret, (a, self.middle(tuple(offset), cell), do))
                        return True
        return False

    def open_sealed(self, v: int, record: Record, gate: bytes, secret: bytes, found) -> None:
        a, (place, facing), do = found
        bound = self.file.digest + struct.pack("<I", v) + record.core
        r = Bytes(AESGCM(hkdf(secret, b"payload")).decrypt(bytes(12), record.payload, bound))
        inner = Bytes(r.take(r.one("I")))
        if len(r.raw) % 64 or any(r.raw[r.at :]) or len(r.raw) - r.at >= 64:
            raise ValueError("padding")
        if sha3(b"visited" + hkdf(secret, b"visited")) != record.visited:
            raise ValueError("another's proof")
        name = inner.take(inner.one("B")).decode()
        do = action_of(inner.take(inner.one("H"))) or do
        given, x_mm, y_mm = inner.read("Bii")
        sends = tuple(inner.take(32) for _ in range(inner.one("B")))
        ways = []
        if inner.one("H") != len(record.ways):
            raise ValueError("other ways")
        for target, tag in record.ways:
            way_do = action_of(inner.take(inner.one("H")))
            padded, hints = gate_of(inner)
            pad = hkdf(gate, b"phalanx mission onward" + self.file.id + struct.pack("<II", v, target))
            self.shares.setdefault(target, {})[v] = xor(padded, pad), hints
            said = (b"dir" + struct.pack("<IH", target, sector) for sector in range(self.file.sectors))
            tags = [hmac.digest(secret, each, "sha256")[:16] for each in said]
            ways.append(Way(target, tags.index(tag) if tag in tags else None, way_do))
        inner.end()
        place = (x_mm / 1000, y_mm / 1000) if given else place
        self.open(v, record, name, a, (place, facing), do, sends, tuple(ways))

    def open(self, v: int, record: Record, name, a: int, where, do, sends, ways) -> None:
        self.heard += sends
        self.nodes[v] = Node(record.flags, record.timeout_s, record.reach_dm, name, a, *where, do, sends, ways)

    def middle(self, offset: tuple[int, ...], cell) -> tuple[tuple[float, float] | None, float | None]:
        """Where what was recognised is: the middle of its cell."""
        if cell is None:
            return None, None
        x, y = ((cell[i] * self.file.delta_mm + offset[i]) / 1000 for i in (0, 1))
        return (x, y), None if cell[2] < 0 else cell[2] * math.tau / self.file.bins + offset[2] * 1e-4


def gate_of(r: Bytes) -> tuple[bytes, list[bytes]]:
    share = r.take(32)
    return share, [r.take(11) for _ in range(r.one("B"))]


def xor(a: bytes, b: bytes) -> bytes:
    return bytes(x ^ y for x, y in zip(a, b, strict=True))
