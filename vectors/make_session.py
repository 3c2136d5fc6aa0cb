"""Writes vectors/session.json, which Python and TypeScript both run: `python vectors/make_session.py`.

Bytes are packed and sealed here by struct and cryptography directly, not by the code under test. Only the handshake is
that of phalanx.link.session.noise, which vectors/noise.json holds to the published vectors.
"""

from __future__ import annotations

import base64
import hmac
import json
import struct
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from phalanx.link.session.noise import Initiator, respond

HERE = Path(__file__).parent
STATIC = X25519PrivateKey.from_private_bytes(bytes(range(32)))
PUBLIC = STATIC.public_key().public_bytes_raw()
SIGNER = Ed25519PrivateKey.from_private_bytes(bytes(range(32, 64)))
KINDS = {"open": 1, "ticket": 2, "room": 3, "resume": 4}
SECRETS = {
    "open": bytes(range(16)),
    "ticket": bytes(range(16, 32)),
    "room": b"01234567",
    "resume": bytes(range(64, 96)),
}
BROKER, ROOT = "wss://broker.example:8884/mqtt", "/lab"

Case = dict[str, Any]


def b64(raw: bytes) -> str:
    return base64.urlsafe_b64encode(raw).rstrip(b"=").decode()


def derive(secret: bytes, purpose: str, length: int) -> bytes:
    return HKDF(algorithm=SHA256(), length=length, salt=None, info=b"phalanx/1 " + purpose.encode()).derive(secret)


def mac(key: bytes, data: bytes) -> bytes:
    return hmac.digest(key, data, "sha256")


def v8(raw: bytes) -> bytes:
    return bytes([len(raw)]) + raw


def id_of(kind: str) -> bytes:
    return bytes(8) if kind == "room" else derive(SECRETS[kind], "id", 8)


def prologue(kind: str, root: str, broker: str) -> bytes:
    fields = (b"\1", bytes([KINDS[kind]]), id_of(kind), root.encode(), broker.encode())
    return b"".join(map(v8, fields))


def padded(content: bytes) -> bytes:
    whole = len(content) + 4
    size = next((each for each in (128, 512, 2048) if whole <= each), -(-whole // 2048) * 2048)
    return (struct.pack("<I", len(content)) + content).ljust(size, b"\0")


def seal(key: bytes, counter: int, plaintext: bytes, associated: bytes) -> bytes:
    return ChaCha20Poly1305(key).encrypt(bytes(4) + struct.pack("<Q", counter), plaintext, associated)


def secrets() -> list[Case]:
    hello = bytes(range(58))
    return [
        {
            "name": kind,
            "kind": kind,
            "raw": raw.hex(),
            "psk": derive(raw, kind, 32).hex(),
            "id": id_of(kind).hex(),
            "hello": hello.hex(),
            "mac1": mac(derive(raw, "mac1", 32), hello)[:16].hex(),
            "accept_topic": b64(derive(raw + hello, "accept", 16)),
        }
        for kind, raw in SECRETS.items()
    ]


def invitations() -> list[Case]:
    def raw(
        version: int = 1, kind: int = 1, mqtt: int = 5, root: bytes = b"/lab", broker: bytes = BROKER.encode()
    ) -> bytes:
        return bytes([version, kind]) + PUBLIC + SECRETS["open"] + bytes([mqtt]) + v8(root) + v8(broker)

    direct = {"kind": 2, "mqtt": 0, "root": b"", "broker": b""}
    good = [("on a broker", raw(), "open"), ("direct", raw(**direct), "ticket")]
    bad = {
        "another version": raw(version=2),
        "a room code": raw(kind=3),
        "a resume secret": raw(kind=4),
        "kind 0": raw(kind=0),
        "MQTT 3": raw(mqtt=3),
        "no root": raw(root=b""),
        "root without a slash": raw(root=b"lab"),
        "root with a wildcard": raw(root=b"/+"),
        "broker over http": raw(broker=b"http://broker.example/"),
        "broker with a login": raw(broker=b"ws://a:b@broker.example/"),
        "a root on direct": raw(**direct | {"root": b"/lab"}),
        "not UTF-8": raw(root=b"/\xff"),
        "a byte less": raw()[:-1],
        "a byte more": raw() + b"\0",
        "empty": b"",
    }
    words = {name: "j=" + b64(each) for name, each in bad.items()}
    words |= {
        "no such word": "k=" + b64(raw()),
        "padding": "j=" + b64(raw()) + "=",
        "of mode qrkey": "v=1&pin=123456789012",
    }
    return [
        {
            "name": name,
            "expect": "ok",
            "fragment": "j=" + b64(each),
            "kind": kind,
            "static": PUBLIC.hex(),
            "secret": SECRETS["open"].hex(),
            "broker": "" if kind == "ticket" else BROKER,
            "root": "" if kind == "ticket" else ROOT,
            "mqtt": 0 if kind == "ticket" else 5,
        }
        for name, each, kind in good
    ] + [{"name": name, "expect": "BadInvitation", "fragment": word} for name, word in words.items()]


def paddings() -> list[Case]:
    good = [
        {"name": f"{n} bytes", "expect": "ok", "content": "5a" * n, "plaintext": padded(b"\x5a" * n).hex()}
        for n in (0, 1, 124, 125, 508, 509, 2044, 2045)
    ]
    plain = padded(b"hello")
    bad = {
        "empty": b"",
        "a byte less": plain[:-1],
        "a byte more": plain + b"\0",
        "not zeros": plain[:-1] + b"\1",
        "a longer size": plain.ljust(512, b"\0"),
        "a length beyond the end": b"\x7d\0\0\0" + plain[4:],
        "a length of 2^32 - 1": b"\xff" * 4 + plain[4:],
    }
    return good + [{"name": name, "expect": "MalformedRecord", "plaintext": raw.hex()} for name, raw in bad.items()]


def windows() -> list[Case]:
    def case(name: str, *steps: tuple[int, bool]) -> Case:
        return {
            "name": name,
            "steps": [{"counter": counter, "expect": "ok" if ok else "Replayed"} for counter, ok in steps],
        }

    return [
        case("in order, and again", (0, True), (1, True), (0, False), (1, False)),
        case("out of order", (5, True), (3, True), (4, True), (3, False), (6, True)),
        case(
            "1024 are remembered", (0, True), (1023, True), (0, False), (1, True), (1024, True), (0, False), (2, True)
        ),
        case("further behind is refused unseen", (5000, True), (3976, False), (3977, True)),
        case("a jump, and what lies before it", (0, True), (2**40, True), (0, False), (2**40 - 1023, True)),
        case("counters that nobody reaches", (2**48 - 1, True), (2**48, False), (2**48 - 2, True)),
    ]


def handshake(kind: str, root: str, broker: str, *, name: str) -> Case:
    """A whole session: hello, accept, a record each way, with every key."""
    psk = derive(SECRETS[kind], kind, 32)
    opening = prologue(kind, root, broker)
    initiator = Initiator(opening, PUBLIC, psk, b"\x11" * 32)
    first = initiator.write()
    hello = bytes([1, KINDS[kind]]) + id_of(kind) + first
    _, second, server = respond(opening, STATIC, psk, b"\x22" * 32, first)
    keys = server.to_server._key, server.to_client._key  # noqa: SLF001
    if broker:
        hello += mac(derive(SECRETS[kind], "mac1", 32), hello)[:16]
    content = b"\x22" if kind == "resume" else b"\x21" + v8("Zoë".encode())
    head, back = (b"\x10\x07" + struct.pack("<Q", counter) for counter in (0, 5))
    reply = b'\x45\x09\0\0\0{"a":1}'
    return {
        "name": name,
        "kind": kind,
        "secret": SECRETS[kind].hex(),
        "root": root,
        "broker": broker,
        "mqtt": 5 if broker else 0,
        "prologue": opening.hex(),
        "static": PUBLIC.hex(),
        "client_ephemeral": (b"\x11" * 32).hex(),
        "hello": hello.hex(),
        "accept": (b"\x02\x07" + second).hex(),
        "to_server": keys[0].hex(),
        "to_client": keys[1].hex(),
        "topic_to_server": b64(mac(keys[0], b"phalanx/1 topic")[:16]),
        "topic_to_client": b64(mac(keys[1], b"phalanx/1 topic")[:16]),
        "hello_topic": b64(derive(PUBLIC, "hello", 16)),
        "nickname": "Zoë",
        "first_record": (head + seal(keys[0], 0, padded(content), head)).hex(),
        "reply_record": (back + seal(keys[1], 5, padded(reply), back)).hex(),
        "reply": reply[5:].hex(),
        "reply_number": 9,
    }


def handshakes() -> list[Case]:
    return [
        handshake("open", "", "", name="an open code, direct"),
        handshake("ticket", ROOT, BROKER, name="a ticket, on a broker"),
        handshake("room", "", "", name="a room code"),
        handshake("resume", "", "", name="a resume"),
    ]


def messages() -> list[Case]:
    def text(word: str) -> bytes:
        return v8(word.encode())

    server = {
        "welcome": (
            b"\x41" + struct.pack("<I", 7) + bytes(32) + text("Zoë"),
            {"visitor": 7, "signer": "00" * 32, "name": "Zoë"},
        ),
        "secret": (b"\x42" + b"\5" * 32 + struct.pack("<I", 28800), {"secret": "05" * 32, "lifetime_s": 28800}),
        "epoch": (
            b"\x43" + struct.pack("<IQ", 3, 2**40) + b"\6" * 32 + b"\7" * 16,
            {"epoch": 3, "counter": 2**40, "chain": "06" * 32, "topic": "07" * 16},
        ),
        "standing": (
            b"\x44\2\1" + struct.pack("<HI", 4, 120_000) + text("R1"),
            {"role": "drive", "waiting": True, "place": 4, "left_ms": 120_000, "robot": "R1"},
        ),
        "reply": (b"\x45" + struct.pack("<I", 9) + b"[]", {"number": 9, "payload": b"[]".hex()}),
        "refused": (b"\x47" + struct.pack("<I", 0) + b"\1", {"number": 0, "reason": "late"}),
        "end": (b"\x48\1", {"reason": "removed"}),
    }
    good = [
        {"name": kind, "expect": "ok", "from": "server", "kind": kind, "content": raw.hex(), "fields": fields}
        for kind, (raw, fields) in server.items()
    ]
    client = {
        "join": (b"\x21" + text("Zoë"), {"name": "Zoë"}),
        "ready": (b"\x22", {}),
        "stored": (b"\x23" + bytes(range(8)), {"id": bytes(range(8)).hex()}),
        "command": (
            b"\x24\1" + struct.pack("<Q", 77) + bytes(range(8)) + text("DECAFBAD00000001") + text("move_raw") + b"{}",
            {
                "stop": True,
                "seen": 77,
                "digest": bytes(range(8)).hex(),
                "robot": "DECAFBAD00000001",
                "name": "move_raw",
                "payload": b"{}".hex(),
            },
        ),
        "request": (b"\x25" + struct.pack("<I", 1) + text("robots"), {"number": 1, "name": "robots", "payload": ""}),
        "leave": (b"\x26\1", {"keep": True}),
        "alive": (b"\x27", {}),
    }
    good += [
        {"name": kind, "expect": "ok", "from": "client", "kind": kind, "content": raw.hex(), "fields": fields}
        for kind, (raw, fields) in client.items()
    ]
    bad = {
        "empty": ("server", b"", "Unexpected"),
        "a client's message": ("server", b"\x22", "Unexpected"),
        "a server's message": ("client", b"\x48\1", "Unexpected"),
        "no such message": ("server", b"\x40", "Unexpected"),
        "a byte more": ("server", b"\x48\1\0", "MalformedRecord"),
        "a byte less": ("server", b"\x48", "MalformedRecord"),
        "a reason that means nothing": ("server", b"\x48\x63", "MalformedRecord"),
        "reason 0": ("server", b"\x47" + bytes(5), "MalformedRecord"),
        "role 0": ("server", b"\x44\0\0" + bytes(7), "MalformedRecord"),
        "role 4": ("server", b"\x44\4\0" + bytes(7), "MalformedRecord"),
        "waiting is 2": ("server", b"\x44\1\2" + bytes(7), "MalformedRecord"),
        "a name that is not UTF-8": ("server", b"\x41" + bytes(36) + v8(b"\xff"), "MalformedRecord"),
        "a name that is cut off": ("server", b"\x41" + bytes(36) + b"\x05ab", "MalformedRecord"),
        "an address with a slash": ("client", b"\x24\0" + bytes(16) + text("a/b") + text("x"), "MalformedRecord"),
        "a command without a name": ("client", b"\x24\0" + bytes(16) + text("a") + text(""), "MalformedRecord"),
        "keep is 2": ("client", b"\x26\2", "MalformedRecord"),
        "stop is 2": ("client", b"\x24\2" + bytes(16) + text("a") + text("x"), "MalformedRecord"),
    }
    return good + [
        {"name": name, "expect": expect, "from": end, "content": raw.hex()} for name, (end, raw, expect) in bad.items()
    ]


def update(chain: bytes, epoch: int, counter: int, state: bytes, *, signer: Ed25519PrivateKey = SIGNER) -> bytes:
    """An update under the chain key of its own counter."""
    place = struct.pack("<IQ", epoch, counter)
    sealed = seal(mac(chain, b"phalanx/1 update"), counter, padded(state), b"\x11" + place)
    return b"\x11" + place + signer.sign(b"\x12" + place + sealed) + sealed


def chains(first: bytes, steps: int) -> bytes:
    for _ in range(steps):
        first = mac(first, b"phalanx/1 chain")
    return first


def updates() -> list[Case]:
    one, two = b"\x31" * 32, b"\x32" * 32

    def learn(epoch: int, counter: int, chain: bytes) -> Case:
        return {"do": "learn", "epoch": epoch, "counter": counter, "chain": chain.hex(), "topic": "00" * 16}

    def opens(raw: bytes, state: bytes) -> Case:
        return {
            "do": "open",
            "update": raw.hex(),
            "expect": "ok",
            "state": state.hex(),
            "digest": sha256(raw).digest()[:8].hex(),
        }

    def refuses(raw: bytes, expect: str) -> Case:
        return {"do": "open", "update": raw.hex(), "expect": expect}

    a, b, c = (update(chains(one, n), 1, 10 + n, b"state %d" % n) for n in (0, 1, 5))
    later = update(chains(two, 3), 2, 18, b"next epoch")
    stranger = Ed25519PrivateKey.from_private_bytes(b"\x55" * 32)
    forged = update(chains(one, 1), 1, 11, b"forged", signer=stranger)
    altered = b[:-1] + bytes([b[-1] ^ 1])
    far = b[:5] + struct.pack("<Q", 10 + 20_001) + b[13:]
    return [
        {
            "name": "in order, with a gap",
            "steps": [learn(1, 10, one), opens(a, b"state 0"), opens(b, b"state 1"), opens(c, b"state 5")],
        },
        {
            "name": "again, and an earlier one",
            "steps": [learn(1, 10, one), opens(b, b"state 1"), refuses(b, "Replayed"), refuses(a, "Replayed")],
        },
        {
            "name": "before the chain",
            "steps": [learn(1, 11, chains(one, 1)), refuses(a, "Replayed"), opens(b, b"state 1")],
        },
        {"name": "no key", "steps": [refuses(a, "UnknownEpoch"), learn(2, 15, two), refuses(a, "UnknownEpoch")]},
        {
            "name": "forged, altered, too far ahead, cut off",
            "steps": [
                learn(1, 10, one),
                refuses(forged, "NotAuthentic"),
                refuses(altered, "NotAuthentic"),
                refuses(far, "UnknownEpoch"),
                refuses(b[:76], "MalformedRecord"),
                refuses(b"", "MalformedRecord"),
                opens(b, b"state 1"),
            ],
        },
        {
            "name": "a new epoch, after which the one before is refused",
            "steps": [
                learn(1, 10, one),
                opens(a, b"state 0"),
                learn(2, 15, two),
                opens(later, b"next epoch"),
                refuses(b, "UnknownEpoch"),
            ],
        },
        {
            "name": "a chain that is told again does not go back",
            "steps": [
                learn(1, 10, one),
                opens(b, b"state 1"),
                learn(1, 10, one),
                refuses(a, "Replayed"),
                opens(c, b"state 5"),
            ],
        },
        {
            "name": "of three epochs the oldest is dropped",
            "steps": [
                learn(1, 10, one),
                learn(2, 15, two),
                learn(3, 20, one),
                refuses(a, "UnknownEpoch"),
                opens(later, b"next epoch"),
            ],
        },
    ]


GROUPS = {
    "secrets": secrets,
    "invitations": invitations,
    "padding": paddings,
    "window": windows,
    "handshakes": handshakes,
    "messages": messages,
    "updates": updates,
}


def made() -> Case:
    """Everything, as it is committed."""
    signer = SIGNER.public_key().public_bytes_raw().hex()
    return {"signer": signer, **{name: make() for name, make in GROUPS.items()}}


def main() -> int:
    (HERE / "session.json").write_text(json.dumps(made(), indent=1, ensure_ascii=True) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
