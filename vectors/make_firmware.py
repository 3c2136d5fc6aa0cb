"""Writes the vectors of the trusted nodes: vectors/{present,sha1,lightmac,nodes,sealed}.json, which Python and C run.

PRESENT and SHA-1 are the published ones; LightMACs and what the nodes answer are those of tests/kit/oracle, never the
code's under test. Run it as `python vectors/make_firmware.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import hashlib
import json
import random
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests" / "kit"))

from oracle.lightmac import lightmac, present80  # noqa: E402
from oracle.nodes import No, SNode, u16, u32  # noqa: E402
from oracle.sealed import SealedANode  # noqa: E402

Case = dict[str, Any]


def present() -> list[Case]:
    # Bogdanov et al., CHES 2007, appendix I.
    zero, ones = "00", "ff"
    rows = [
        (zero, zero, "5579c1387b228445"),
        (ones, zero, "e72c46c0f5945049"),
        (zero, ones, "a112ffc72f68417b"),
        (ones, ones, "3333dcd3213210d2"),
    ]
    return [
        {"name": f"key {k}…, plaintext {p}…", "key": k * 10, "plain": p * 8, "cipher": cipher} for k, p, cipher in rows
    ]


def sha1() -> list[Case]:
    # FIPS 180-2, appendix A; the empty message is NIST's (CAVS SHA1ShortMsg).
    rows = [
        ("nothing", b"", 1, "da39a3ee5e6b4b0d3255bfef95601890afd80709"),
        ("one block", b"abc", 1, "a9993e364706816aba3e25717850c26c9cd0d89d"),
        (
            "two blocks",
            b"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
            1,
            "84983e441c3bd26ebaae4aa1f95129e5e54670f1",
        ),
        ("a million a", b"a", 1_000_000, "34aa973cd4c4daa4f61eeb2bdbad27316534016f"),
    ]
    # Around the edges of a block, where padding goes wrong.
    rows += [
        (f"{n} bytes", bytes(range(n)), 1, hashlib.sha1(bytes(range(n))).hexdigest()) for n in (55, 56, 63, 64, 65)
    ]
    return [{"name": name, "message": raw.hex(), "times": times, "digest": digest} for name, raw, times, digest in rows]


def lightmacs() -> list[Case]:
    key = bytes(range(20))

    def case(name: str, key: bytes, message: bytes, **more: str) -> Case:
        made = {"name": name, "expect": "ok", "key": key.hex(), "message": message.hex()}
        return made | (more or {"mac": lightmac(key, message).hex()})

    # By hand: K1 = 00 01 … 09, K2 = 0. The one whole block is encrypted as 01 ‖ M, which gives V = V6 ‖ 8000 (M was
    # searched for this); the rest of the message is V6, padded V6 ‖ 80 ‖ 00 = V; so K2 encrypts V xor V = 0, and the
    # MAC is the published ciphertext of PRESENT-80 for key 0 and plaintext 0.
    block = bytes.fromhex(BY_HAND)
    v = present80(bytes(range(10)), b"\x01" + block)
    by_hand = case("by hand", bytes(range(10)) + bytes(10), block + v[:6], mac="5579c1387b228445")
    lengths = [*range(16), 23, 29, 31, 40, 45, 1785, 1791]
    rows = [case(f"{n} bytes", key, bytes(i % 256 for i in range(n))) for n in lengths]
    long = case("256 whole blocks", key, bytes(1792), expect="TOO_LONG")
    return [by_hand, *rows, long]


BY_HAND = "000000000155c5"

# --- what nodes answer -----------------------------------------------------------------------------------------------

LIMITS = {
    "f_max": 1,
    "t_val_ms": 700,
    "batch_size": 3,
    "bucket_capacity": 3,
    "bucket_period_ms": 40,
    "send_us_per_s": 200,
    "send_capacity_us": 3000,
    "audit_us_per_s": 200,
    "audit_capacity_us": 400,
    "airtime_fixed_us": 50,
    "airtime_ns_per_byte_broadcast": 1333,
    "airtime_ns_per_byte_unicast": 300,
}
# Each function of the C: whose it is, and the oracle's method with numbers and byte strings in the C's order.
CALLS: dict[str, tuple[str, Callable[..., Any]]] = {
    "snode_load_master": ("s", lambda o, n, b: o.load_master(b[0], n[0])),
    "anode_load_master": ("a", lambda o, n, b: o.load_master(b[0], n[0])),
    "snode_load_mission": ("s", lambda o, n, b: o.load_mission(n[0], b[0], b[1], n[1], b[2])),
    "anode_load_mission": ("a", lambda o, n, b: o.load_mission(n[0], b[0], b[1], n[1], b[2])),
    "snode_power_up": ("s", lambda o, n, b: o.power_up()),
    "anode_power_up": ("a", lambda o, n, b: o.power_up()),
    "snode_poll": ("s", lambda o, n, b: o.poll(n[0], b[0])),
    "anode_recv": ("a", lambda o, n, b: o.recv(n[0], b[0])),
    "anode_send": ("a", lambda o, n, b: o.send(n[0], b[0])),
    "make_sealed": ("a", lambda o, n, b: o.sealed_make()),
    "sealed_send": ("a", lambda o, n, b: o.sealed_send(n[0], b[0])),
    "sealed_recv": ("a", lambda o, n, b: o.sealed_recv(n[0], b[0])),
    "anode_actuate": ("a", lambda o, n, b: o.actuate(n[0], b[0])),
    "snode_make_auth": ("s", lambda o, n, b: o.make_auth(b[0])),
    "snode_check_auth": ("s", lambda o, n, b: o.check_auth(b[0], n[0], b[1], b[2])),
    "anode_make_auth": ("a", lambda o, n, b: o.make_auth_a()),
    "snode_check_auth_a": ("s", lambda o, n, b: o.check_auth_a(b[0], n[0], b[1])),
    "anode_token_request": ("a", lambda o, n, b: o.token_request(*n)),
    "anode_issue_token": ("a", lambda o, n, b: o.issue_token(*n, *b)),
    "anode_check_token": ("a", lambda o, n, b: o.check_token(*n, *b)),
    "anode_install_token": ("a", lambda o, n, b: o.install_token(*n, *b)),
    "anode_check": ("a", lambda o, n, b: o.check(*n)),
    "anode_is_safe": ("a", lambda o, n, b: int(o.safe)),
}
ROBOTS = 4
SEALED_LIMITS = LIMITS | {"send_us_per_s": 10**6, "audit_us_per_s": 10**6, "audit_capacity_us": 3000}


class Story:
    """Calls and the oracle's answers, as they are written down."""

    def __init__(self, profile: str, limits_of: dict[str, int] = LIMITS) -> None:
        limits = SimpleNamespace(**limits_of)
        hardened = profile == "hardened"
        self.profile, self.hardened, self.now = profile, hardened, 0
        self.nodes = {
            "s": [SNode(hardened, limits) for _ in range(ROBOTS)],
            "a": [SealedANode(hardened, limits) for _ in range(ROBOTS)],
        }
        self.calls: list[Case] = []

    def call(self, name: str, robot: int, numbers: tuple[int, ...] = (), texts: tuple[bytes, ...] = ()) -> bytes | None:
        """What the node answered, None if it refused."""
        kind, method = CALLS[name]
        expect, out, code = "ok", b"", 0
        try:
            said = method(self.nodes[kind][robot], numbers, texts)
            out, code = (said, 0) if isinstance(said, bytes) else (b"", said or 0)
        except No as no:
            expect = no.args[0]
        row: Case = {"call": name, "robot": robot, "numbers": list(numbers), "bytes": [text.hex() for text in texts]}
        self.calls.append(row | {"expect": expect, "code": code, "out": out.hex()})
        return out if expect == "ok" else None

    def load(self, robot: int, seq: int, master: bytes, mission: bytes) -> None:
        r = bytes([seq]) * 20
        k = bytes(a ^ b for a, b in zip(mission, hashlib.sha1(r + master).digest(), strict=True))
        mac = lightmac(master, b"\x10" + k + r + u32(seq))
        for kind in ("snode", "anode"):
            self.call(f"{kind}_load_mission", robot, (self.now, seq), (k, r, mac))
            self.call(f"{kind}_load_mission", robot, (self.now, seq + 1), (k, r, mac))


def story(profile: str, seed: int) -> Case:
    """A mission of four robots: most of what they do is right, the rest must be refused."""
    chance = random.Random(seed)  # noqa: S311
    tale = Story(profile)
    master, mission = chance.randbytes(20), chance.randbytes(20)
    tale.call("snode_poll", 0, (0,), (b"early",))
    tale.call("anode_token_request", 0, (0, 2))
    zero_token = lightmac(bytes(20), b"\x14" + u16(2) + u16(0) + u32(2**32 - 1) + bytes(20))
    tale.call("anode_install_token", 0, (0, 2, 2**32 - 1), (bytes(20), zero_token))
    for i in range(ROBOTS):
        for kind in ("snode", "anode"):
            tale.call(f"{kind}_load_master", i, (0,), (master,))
            tale.call(f"{kind}_load_master", i, (i + 1,), (master,))
            tale.call(f"{kind}_load_master", i, (9,), (bytes(20),))
        tale.load(i, 1, master, mission)
    requests: list[tuple[bytes, int, int]] = []
    macs, hckpt = [bytes(8)], bytes(range(20))
    tale.now = LIMITS["bucket_capacity"] * LIMITS["bucket_period_ms"]
    for _ in range(4):
        tale.call("anode_send", 2, (tale.now,), (b"\x80" * 300,))
        tale.call("anode_send", 2, (tale.now,), (b"\x01" * 900,))
    for step in range(70):
        tale.now += chance.choice([0, 1, 7, 20, 30])
        i = chance.randrange(ROBOTS)
        frame = chance.choice([b"\x01", b"\x02", b"\x80", b"\x81"]) + chance.randbytes(chance.randrange(30))
        if step in {20, 21}:
            frame = bytes([frame[0]]) * (2048 + step - 20)
        what = chance.choice("snode_poll anode_recv anode_send anode_send anode_actuate auth round round round".split())
        if what == "auth":
            nonce = chance.choice([bytes(8), b"12345678"])
            auth = tale.call("snode_make_auth", i, (), (nonce,))
            if auth:
                macs.append(auth[22:])
                tale.call("snode_check_auth", 3 - i, (i + 1,), (auth[:20], nonce, auth[22:]))
                tale.call("snode_check_auth", 3 - i, (i + 2,), (auth[:20], nonce, auth[22:]))
            if profile == "paper":
                auth = tale.call("anode_make_auth", i)
                if auth:
                    tale.call("snode_check_auth_a", 3 - i, (i + 1,), (auth[:20], auth[22:]))
        elif what == "round":
            audits(tale, chance, i, hckpt, requests, macs)
        else:
            tale.call(what, i, (tale.now,), (frame,))
        if step % 5 == 0:
            for j in range(ROBOTS - 1 if step < 50 else ROBOTS):
                tale.call("anode_check", j, (tale.now,))
    tale.now += LIMITS["t_val_ms"] + 1
    for name, texts in {
        "anode_recv": (b"\x01",),
        "anode_check": (),
        "anode_actuate": (b"go",),
        "snode_poll": (b"x",),
    }.items():
        tale.call(name, 2, (tale.now,), texts)
    tale.call("anode_check", 0, (2**32 - 1,))
    tale.call("snode_poll", 1, (2**32 - 1,), (b"late",))
    for kind in ("snode", "anode"):
        tale.call(f"{kind}_power_up", 1)
    tale.now = 5
    tale.load(1, 1, master, mission)
    tale.load(1, 2, master, mission)
    tale.call("anode_send", 1, (6,), (b"\x01alive",))
    tale.call("anode_is_safe", 0)
    tale.call("anode_is_safe", 1)
    return {"name": f"{profile}, story {seed}", "profile": profile, "limits": LIMITS, "calls": tale.calls}


def audits(tale: Story, chance: random.Random, i: int, hckpt: bytes, requests: list[Any], macs: list[bytes]) -> None:
    """Robot i asks two others, and shows somebody's MAC where it does not belong."""
    for auditor in chance.sample(range(1, ROBOTS + 1), 2):
        asked = tale.call("anode_token_request", i, (tale.now, auditor))
        if asked:
            requests.append((asked, i + 1, auditor))
    if not requests:
        return
    for asked, auditee, auditor in (requests[-1], chance.choice(requests)):
        t, top, mac = int.from_bytes(asked[:4], "little"), asked[4:24], asked[24:]
        token = tale.call("anode_issue_token", auditor - 1, (auditee, t), (top, mac, hckpt))
        tale.call("anode_issue_token", auditor - 1, (auditee, t), (top, chance.choice(macs), hckpt))
        if token:
            macs.append(token)
            tale.call("anode_check_token", chance.randrange(ROBOTS), (auditor, auditee, t), (hckpt, token))
            tale.call("anode_install_token", auditee - 1, (tale.now, auditor, t), (hckpt, token))
            tale.call("anode_install_token", auditee % ROBOTS, (tale.now, auditor, t), (hckpt, token))


def nodes() -> list[Case]:
    return [story(profile, 1) for profile in ("hardened", "paper")]


def sealed() -> list[Case]:
    """Three robots whose clocks began at other times; frames come at once, late, twice, altered or bare."""
    tale, chance = Story("hardened", SEALED_LIMITS), random.Random(5)  # noqa: S311
    master, mission = bytes(range(100, 120)), bytes(range(7, 27))
    ahead = (0, 40_000, 3_000_000)
    for i in range(len(ahead)):
        for kind in ("snode", "anode"):
            tale.call(f"{kind}_load_master", i, (i + 1,), (master,))
        tale.load(i, 1, master, mission)
    air: list[bytes] = []
    for step in range(160):
        tale.now += chance.choice([0, 0, 1, 7, 30, 60, 64, 65, 700, 2001])
        i = chance.randrange(len(ahead))
        if step % 2 == 0:
            kind = chance.choice([b"\x01", b"\x80"])
            frame = kind + chance.randbytes(chance.choice([0, 5, 26, 40]))
            if step in {20, 22}:
                frame = kind * (2034 + step - 20)
            said = tale.call("sealed_send", i, (tale.now + ahead[i],), (frame,))
            air += [said[7:]] if said else []
            continue
        for frame in air and (air[-1], chance.choice(air[-6:]), chance.choice(air)):
            cut = chance.randrange(len(frame))
            altered = frame[:cut] + bytes([frame[cut] ^ 1]) + frame[cut + 1 :]
            heard = chance.choice([frame] * 8 + [altered, frame[:-14], frame[-14:]])
            tale.call("sealed_recv", i, (tale.now + ahead[i],), (heard,))
    tale.call("sealed_send", 3, (tale.now,), (b"\x01without a key",))
    tale.call("sealed_recv", 3, (tale.now,), (air[-1],))
    tale.call("sealed_recv", 0, (2**32 - 1,), (air[-1],))
    return [{"name": "sealed, three robots", "profile": "hardened", "limits": SEALED_LIMITS, "calls": tale.calls}]


VECTORS = {"present": present, "sha1": sha1, "lightmac": lightmacs, "nodes": nodes, "sealed": sealed}


def text(cases: list[Case]) -> str:
    """The file, with a case or a call of a story on each line."""
    rows = ",\n".join(json.dumps(case, ensure_ascii=True) for case in cases)
    return '{"cases": [\n' + rows.replace('{"call"', '\n{"call"') + "\n]}\n"


if __name__ == "__main__":
    for name, write in VECTORS.items():
        (HERE / f"{name}.json").write_text(text(write()))
