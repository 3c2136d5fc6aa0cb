"""Writes vectors/edges.json: each limit and each error of the trusted nodes, on its edge and one beside it.

Answers are those of tests/kit/oracle, never the code's under test. `python vectors/make_edges.py`; a test checks that
what is committed is what it writes.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator
from hashlib import sha1
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests" / "kit"), str(HERE)]

from make_firmware import LIMITS, Case, Story, text  # noqa: E402

from oracle.lightmac import lightmac  # noqa: E402
from oracle.nodes import u16, u32  # noqa: E402

MASTER, MISSION, HCKPT, TOP = bytes(range(100, 120)), bytes(range(7, 27)), bytes(range(40, 60)), bytes(range(60, 80))
IDS = (0x1234, 0x5608, 0xFFFF, 7)  # of robots 0 to 3: both bytes count
END = 2**32 - 1
AIR = {"send_us_per_s": 10**6, "send_capacity_us": 10**6, "audit_us_per_s": 10**6, "audit_capacity_us": 10**6}


class Tale(Story):
    """A story whose robots have a mission key from the start."""

    def __init__(self, name: str, profile: str, now: int = 0, loaded: bool = True, **limits: int) -> None:
        self.limits = LIMITS | limits
        super().__init__(profile, self.limits)
        self.name, self.now = name, now
        for i, robot_id in enumerate(IDS if loaded else ()):
            for kind in ("snode", "anode"):
                self.call(f"{kind}_load_master", i, (robot_id,), (MASTER,))
            self.load_key(i, 1)

    def load_key(self, robot: int, seq: int) -> None:
        for kind in ("snode", "anode"):
            self.call(f"{kind}_load_mission", robot, (self.now, seq), sealed_key(seq))

    def token(self, robot: int, auditor: int, t: int, now: int | None = None, auditee: int | None = None) -> None:
        """Robot installs a true token."""
        mac = token_mac(auditor, IDS[robot] if auditee is None else auditee, t)
        self.call("anode_install_token", robot, (self.now if now is None else now, auditor, t), (HCKPT, mac))

    def case(self) -> Case:
        return {"name": f"{self.profile}: {self.name}", "profile": self.profile, "limits": self.limits} | {
            "calls": self.calls
        }


def sealed_key(seq: int) -> tuple[bytes, bytes, bytes]:
    r = bytes([seq & 255]) * 20
    k = bytes(a ^ b for a, b in zip(MISSION, sha1(r + MASTER).digest(), strict=True))
    return k, r, lightmac(MASTER, b"\x10" + k + r + u32(seq))


def token_mac(auditor: int, auditee: int, t: int) -> bytes:
    return lightmac(MISSION, b"\x14" + u16(auditor) + u16(auditee) + u32(t) + HCKPT)


def sealed_frame(t: int, src: int, frame: bytes = b"\x01far away") -> bytes:
    return frame + u32(t) + u16(src) + lightmac(MISSION, b"\x15" + u32(t) + u16(src) + sha1(frame).digest())


def to(dst: int, size: int) -> bytes:
    """An AUDIT frame whose other bytes do not look like its `dst`."""
    around = b"\1" if dst == 0 else b"\0"
    return b"\x80" + around * 2 + u16(dst) + around * (size - 5)


def flipped(numbers: tuple[int, ...], bits: tuple[int, ...], texts: tuple[bytes, ...]) -> Iterator[Any]:
    """The same arguments with one bit changed: each of the numbers' (so many `bits` of each), one of each byte."""
    for i, count in enumerate(bits):
        for bit in range(count):
            yield (*numbers[:i], numbers[i] ^ 1 << bit, *numbers[i + 1 :]), texts
    for i, raw in enumerate(texts):
        for at in range(len(raw)):
            changed = raw[:at] + bytes([raw[at] ^ 1 << at % 8]) + raw[at + 1 :]
            yield numbers, (*texts[:i], changed, *texts[i + 1 :])


def macs(profile: str) -> Case:
    """Every bit of what is MACed counts, and so does every byte of a MAC."""
    tale = Tale("all that is MACed", profile, now=5, loaded=False)
    for kind in ("snode", "anode"):
        tale.call(f"{kind}_load_master", 0, (IDS[0],), (MASTER,))
    k, r, mac = sealed_key(0x01020304)
    for name in ("snode", "anode"):
        for numbers, texts in flipped((5, 0x01020304), (0, 32), (k, r, mac)):
            tale.call(f"{name}_load_mission", 0, numbers, texts)
        tale.call(f"{name}_load_mission", 0, (5, 0x01020304), (k, r, mac))
    tale.now = 0x01020304
    auth = tale.call("snode_make_auth", 0, (), (b"nonce  1",)) or b""
    flips = flipped((IDS[0],), (16,), (auth[:20], b"nonce  1", auth[22:]))
    asked = tale.call("anode_token_request", 0, (tale.now, IDS[1])) or b""
    tale.call("snode_check_auth", 0, (IDS[0],), (auth[:20], b"nonce  1", auth[22:]))
    for numbers, texts in flips:
        tale.call("snode_check_auth", 0, numbers, texts)
    # The other robot is told the request, and it is the only one that has been asked.
    tale.call("anode_load_master", 1, (IDS[1],), (MASTER,))
    tale.call("anode_load_mission", 1, (tale.now, 9), sealed_key(9))
    request = (IDS[0], tale.now), (asked[4:24], asked[24:], HCKPT)
    for numbers, texts in [request, *flipped(request[0], (16, 32), request[1])]:
        tale.call("anode_issue_token", 1, numbers, texts)
    t = tale.now
    token = (IDS[1], IDS[0], t), (HCKPT, token_mac(IDS[1], IDS[0], t))
    for numbers, texts in [token, *flipped(token[0], (16, 16, 32), token[1])]:
        tale.call("anode_check_token", 1, numbers, texts)
    shown = (t + 1, IDS[1], t), token[1]
    for numbers, texts in [*flipped(shown[0], (0, 16, 32), shown[1]), shown]:
        tale.call("anode_install_token", 0, numbers, texts)
    return tale.case()


def zeros(profile: str) -> Case:
    """Time 0, robot 0 and a key of zeros are numbers like others: a MAC decides."""
    tale = Tale("zeros", profile)
    for t, auditee in ((0, IDS[0]), (0, 0), (5, 0)):
        treq = b"\x13" + u32(t) + u16(auditee) + u16(IDS[1]) + (TOP if tale.hardened else b"")
        for mac in (lightmac(MISSION, treq), lightmac(bytes(20), treq), bytes(8)):
            tale.call("anode_issue_token", 1, (auditee, t), (TOP, mac, HCKPT))
    for auditor, auditee, t in ((IDS[1], 0, 5), (IDS[1], IDS[0], 0), (0, IDS[0], 5), (0, 0, 0)):
        for mac in (token_mac(auditor, auditee, t), bytes(8)):
            tale.call("anode_check_token", 0, (auditor, auditee, t), (HCKPT, mac))
            tale.call("anode_install_token", 0, (6, auditor, t), (HCKPT, mac))
    for name in ("snode_load_mission", "anode_load_mission"):
        for mac in (sealed_key(0)[2], bytes(8)):
            tale.call(name, 2, (0, 0), (*sealed_key(0)[:2], mac))
    for name in ("snode_poll", "anode_recv", "anode_send", "anode_actuate"):
        tale.call(name, 2, (0,), (b"\0\0",))
    tale.call("anode_check", 2, (0,))
    auth = b"\x11" + TOP + u16(0) + (bytes(8) if tale.hardened else b"")
    for mac in (lightmac(MISSION, auth), bytes(8)):
        tale.call("snode_check_auth", 0, (0,), (TOP, bytes(8), mac))
    for mac in (lightmac(MISSION, b"\x12" + TOP + u16(0)), bytes(8)) if not tale.hardened else ():
        tale.call("snode_check_auth_a", 0, (0,), (TOP, mac))
    for robot in (0, 1):
        tale.token(robot, IDS[2], 0, now=0)
    tale.token(0, IDS[3], 0, now=0)
    for now in (LIMITS["t_val_ms"] - 1, LIMITS["t_val_ms"], LIMITS["t_val_ms"] + 1):
        for robot in (0, 1):  # which has two tokens of time 0, and one
            tale.call("anode_check", robot, (now,))
    return tale.case()


def errors(profile: str) -> Case:
    """Every call's every error, where two apply the first; and what was refused has changed nothing."""
    tale = Tale("errors", profile, loaded=False)
    if tale.hardened:
        tale.call("make_sealed", 3)
    early = {
        "snode_poll": ((1,), (b"x",)),
        "anode_recv": ((1,), (b"\x01",)),
        "anode_send": ((1,), (b"\x01",)),
        "anode_actuate": ((1,), (b"go",)),
        "snode_make_auth": ((), (b"nonce  1",)),
        "snode_check_auth": ((IDS[1],), (TOP, b"nonce  1", bytes(8))),
        "anode_token_request": ((1, IDS[1]), ()),
        "anode_issue_token": ((IDS[1], 1), (TOP, bytes(8), HCKPT)),
        "anode_check_token": ((IDS[1], IDS[0], 1), (HCKPT, bytes(8))),
        "anode_install_token": ((1, IDS[1], 1), (HCKPT, bytes(8))),
        "snode_load_mission": ((1, 1), sealed_key(1)),
        "anode_load_mission": ((1, 1), sealed_key(1)),
        "anode_check": ((1,), ()),
        "anode_is_safe": ((), ()),
    }

    def all_calls(robot: int, now: int) -> None:
        for name in ("snode_poll", "anode_recv", "anode_send", "anode_actuate"):
            tale.call(name, robot, (now,), (b"",))
        tale.call("anode_token_request", robot, (now, 0))
        for name, (numbers, texts) in early.items():
            has_time = numbers and name not in {"snode_check_auth", "anode_issue_token", "anode_check_token"}
            tale.call(name, robot, (now, *numbers[1:]) if has_time else numbers, texts)

    all_calls(0, 1)
    for kind in ("snode", "anode"):
        for robot_id, key in ((0, MASTER), (IDS[0], MASTER), (0, MASTER), (IDS[1], bytes(20))):
            tale.call(f"{kind}_load_master", 0, (robot_id,), (key,))
    all_calls(0, END)  # the clock comes to its end before there is a key
    all_calls(0, 5)
    for kind in ("snode", "anode"):
        tale.call(f"{kind}_power_up", 0)
    tale.load_key(0, 3)
    for seq in (0, 2, 3, 4):  # too low, used, and the second in one power-up
        tale.load_key(0, seq)
    long = b"\x01" * 2049
    for name in ("snode_poll", "anode_recv", "anode_send", "anode_actuate"):
        for raw in (b"", long[:2048], long, b"\x01"):
            tale.call(name, 0, (2,), (raw,))
    for size in range(7):
        tale.call("anode_send", 0, (3,), (b"\x80\1\2\3\4\5\6"[:size],))
        tale.call("anode_recv", 0, (3,), (b"\x80\1\2\3\4\5\6"[:size],))
    tale.call("anode_token_request", 0, (4, 0))
    tale.call("anode_token_request", 0, (LIMITS["bucket_period_ms"] - 1, IDS[1]))
    tale.call("anode_token_request", 0, (LIMITS["bucket_period_ms"], IDS[1]))
    tale.call("anode_token_request", 0, (LIMITS["bucket_period_ms"], IDS[1]))
    tale.call("anode_issue_token", 0, (IDS[0], 4), (TOP, bytes(8), HCKPT))
    for auditor, t in ((IDS[1], 51), (0, 51), (0, 50), (IDS[1], 50)):
        tale.token(0, auditor, t, now=50)
    tale.call("snode_poll", 0, (END - 1,), (b"one before the end",))
    tale.call("anode_recv", 0, (END - 1,), (b"\x01",))
    all_calls(0, END)
    all_calls(0, END)
    for kind in ("snode", "anode"):
        tale.call(f"{kind}_power_up", 0)
    tale.load_key(0, 3)
    tale.load_key(0, 4)
    tale.call("anode_send", 0, (1,), (b"\x01alive",))
    tale.call("anode_check", 0, (LIMITS["t_val_ms"],))  # without a token: Safe Mode
    all_calls(0, LIMITS["t_val_ms"])
    tale.call("anode_check", 0, (0,))
    return tale.case()


def tokens(profile: str, f_max: int) -> Case:
    """f_max + 1 auditors' tokens no older than T_val, the newest of each, whatever the order in which they come."""
    t_val = 700
    tale = Tale(f"tokens, f_max {f_max}", profile, now=1000, f_max=f_max, t_val_ms=t_val)
    at = 1000 + t_val
    tale.call("anode_check", 0, (at - 1,))  # in its grace
    for robot in range(3):
        for k in range(f_max + 1):  # robot 0 has f_max + 1, 1 one less, 2 one less and one twice
            if robot == 0 or k < f_max:
                tale.token(robot, 0x100 + k, 1100 + k, now=1200)
        if robot == 2:
            tale.token(robot, 0x100, 1150, now=1200)
    for robot in range(3):
        tale.call("anode_check", robot, (at,))
    if f_max == 0:
        return tale.case()
    # More auditors than places: old ones come first, last, and in between; of an auditor the newest counts.
    for k in range(f_max + 1):
        tale.token(3, 0x200 + k, 1010 + k, now=1200)
    tale.token(3, 0x300, 1005, now=1200)
    for k in range(f_max):
        tale.token(3, 0x310 + k, 1300 + k, now=1400)
    tale.token(3, 0x200 + f_max, 1011, now=1400)
    tale.call("anode_check", 3, (1010 + f_max + t_val,))
    tale.call("anode_check", 0, (1100 + t_val,))
    tale.call("anode_check", 0, (1100 + t_val + 1,))
    tale.token(3, 0x200, 1390, now=1400)
    tale.call("anode_check", 3, (1300 + t_val,))
    tale.token(3, 0x310, 1250, now=1400)  # older than its auditor's own
    tale.call("anode_check", 3, (1300 + t_val,))
    tale.call("anode_check", 3, (1300 + t_val + 1,))
    return tale.case()


def any_tokens(profile: str, seed: int) -> Case:
    """Tokens of a few auditors in any order, and a check when the last ones may be too old."""
    chance = random.Random(seed)  # noqa: S311
    f_max = 1 + seed % 3
    tale = Tale(f"any tokens, {seed}", profile, f_max=f_max, t_val_ms=100)
    for robot in range(4):
        for _ in range(3 * f_max + 3):
            tale.token(robot, 0x200 + chance.randrange(2 * f_max + 3), chance.randrange(100, 200), now=200)
        tale.call("anode_check", robot, (chance.randrange(240, 290),))
    return tale.case()


def late_keys(profile: str) -> Case:
    """A key that comes when the clock has more than 16 bits is followed by grace, and so has its number."""
    tale, t_val = Tale("keys that come late", profile, now=2**16 + 5), LIMITS["t_val_ms"]
    for ms in (t_val - 1, t_val):
        tale.call("anode_check", 0, (tale.now + ms,))
    for ms in (LIMITS["bucket_period_ms"] - 1, LIMITS["bucket_period_ms"]):
        tale.call("anode_token_request", 2, (tale.now + ms, IDS[0]))
    for k in range(4):  # in free places, and in that of the oldest
        tale.token(2, 0x300 + k, tale.now + k, now=tale.now + k)
    tale.call("anode_check", 2, (tale.now + t_val + 2,))
    tale.call("anode_check", 3, (tale.now + 2**16 + 1,))  # it has no token, and no grace again
    for seq in (2**16 + 1, 2, 2**16 + 1, 2**16 + 2):
        for kind in ("snode", "anode"):
            tale.call(f"{kind}_power_up", 1)
        tale.load_key(1, seq)
    return tale.case()


def places(f_max: int) -> Case:
    """In `paper` 2 f_max + 1 auditors are remembered, and an old token takes the place of its auditor's newer one."""
    tale, count = Tale(f"places, f_max {f_max}", "paper", f_max=f_max, t_val_ms=100), 2 * f_max + 1
    for robot, auditors in ((0, count), (1, count + 1)):  # of whom f_max + 1 are left with a token that is good
        for k in range(auditors):
            tale.token(robot, 0x300 + k, 100 + k, now=150)
        for k in range(f_max + 1, auditors):
            tale.token(robot, 0x300 + k, k, now=150)
        tale.call("anode_check", robot, (200,))
    return tale.case()


def keys() -> Case:
    """In `paper` a key of zeros is none, and every byte counts."""
    tale = Tale("keys that are nearly zero", "paper", loaded=False)
    for robot, key in enumerate((bytes(20), b"\1" + bytes(19), bytes(19) + b"\1", bytes(10) + b"\2" + bytes(9))):
        for kind in ("snode", "anode"):
            tale.call(f"{kind}_load_master", robot, (IDS[robot],), (key,))
            tale.call(f"{kind}_load_master", robot, (IDS[robot],), (MASTER,))
    return tale.case()


def clock() -> Case:
    """Tokens at the clock's end, and a T_val that reaches over it: sums of times have more than 32 bits."""
    tale = Tale("tokens near the end of the clock", "hardened", f_max=0, t_val_ms=100)
    for robot, t in ((0, END - 50), (1, END - 102), (2, END - 101)):
        tale.token(robot, IDS[3], t, now=END - 10)
    for robot in (0, 1, 2):
        tale.call("anode_check", robot, (END - 1,))
    tale.token(3, IDS[0], 4450, now=4500)
    tale.call("anode_check", 3, (2**16 + 4460,))
    return tale.case()


def buckets() -> Iterator[Case]:
    """Rates, capacities and costs whose products have more than 32 bits; and the last unit that counts."""
    idle = 2**22
    costs = {"airtime_fixed_us": 300, "send_capacity_us": 400}
    tale = Tale(
        "idle for 2^22 ms", "hardened", send_us_per_s=1024, audit_us_per_s=1024, bucket_period_ms=2**20, **costs
    )
    for at in (0, 0, idle, idle + 3, 2 * idle):
        for frame in (b"\x01", b"\x80" * 6):
            for _ in range(2):
                tale.call("anode_send", 0, (at,), (frame,))
        tale.call("anode_token_request", 0, (at, IDS[1]))
    yield tale.case()
    big = 4_294_968  # us: in ns, 704 more than 2^32
    wide = dict.fromkeys(("send_us_per_s", "send_capacity_us", "audit_us_per_s", "audit_capacity_us"), big)
    wide["airtime_fixed_us"] = 10**6
    tale = Tale("capacities above 2^32 ns", "hardened", bucket_capacity=2**16, bucket_period_ms=2**16, **wide)
    for at in (0, 2**16, 2**31):
        for frame in (b"\x01", b"\x80" * 6):
            for _ in range(5):  # of which four are let through
                tale.call("anode_send", 0, (at,), (frame,))
        tale.call("anode_token_request", 0, (at, IDS[1]))
        tale.call("anode_token_request", 0, (at, IDS[1]))
    yield tale.case()
    # What is left after a draw has more than 32 bits.
    wide = {"send_capacity_us": 10**7, "audit_capacity_us": 10**7, "airtime_fixed_us": 3 * 10**6}
    tale = Tale("more than 2^32 ns left", "hardened", **wide)
    for frame in (b"\x01", b"\x80" * 6):
        for _ in range(4):
            tale.call("anode_send", 0, (0,), (frame,))
    yield tale.case()
    # Costs above 2^32 ns: 32 bits would let the second frame through.
    for name, costs in {
        "a fixed part": {"airtime_fixed_us": big, "airtime_ns_per_byte_broadcast": 0, "airtime_ns_per_byte_unicast": 0},
        "its bytes": {"airtime_ns_per_byte_broadcast": 2**28, "airtime_ns_per_byte_unicast": 2**28},
    }.items():
        wide = {"send_us_per_s": 1, "send_capacity_us": big + 99, "audit_us_per_s": 1, "audit_capacity_us": big + 99}
        tale = Tale(f"costs above 2^32 ns, {name}", "hardened", **wide | costs)
        for robot, frame in enumerate((b"\x01" * 16, b"\x80" + bytes(15), b"\x80" * 16)):
            for _ in range(2):
                tale.call("anode_send", robot, (1,), (frame,))
        yield tale.case()
    # One ns too little, and enough: 100 us and 10 ns a byte, 7 ns a byte to one robot.
    costs = {"airtime_fixed_us": 100, "airtime_ns_per_byte_broadcast": 10, "airtime_ns_per_byte_unicast": 7}
    caps = {"send_us_per_s": 1, "send_capacity_us": 101, "audit_us_per_s": 3, "audit_capacity_us": 102}
    too_long = {0: b"\x01" + bytes(100), 1: to(0, 201), 2: to(0x0100, 286), 3: to(1, 286)}
    enough = {0: b"\x01" + bytes(99), 1: to(0, 200), 2: to(0x0100, 285), 3: to(1, 285)}
    tale = Tale("to the last ns", "hardened", **costs | caps)
    for at in (0, 33_665, 33_666, 34_000, 67_999, 68_000, 100_999, 101_000, 10**9):
        for robot in range(4):
            tale.call("anode_send", robot, (at,), (too_long[robot],))
            tale.call("anode_send", robot, (at,), (enough[robot],))
    yield tale.case()
    tale = Tale("token requests come singly", "hardened", now=500, bucket_capacity=2)
    for at in (500, 539, 540, 540, 579, 580, 700, 700, 700, 739, 740):
        tale.call("anode_token_request", 0, (at, IDS[1]))
    yield tale.case()


def sealed() -> Iterator[Case]:
    """Late by 2000 ms and 2001, behind by 63 ms and 64, ahead by 256 ms and 257, the 65th sender, and each error."""
    tale = Tale("a frame that is late", "hardened", t_val_ms=10**9, **AIR)
    # By t and now; the least `now - t` so far may grow by 1 ms at 2048 ms, by 2 at 4096.
    late = ((1000, 1000), (1040, 3040), (1041, 3042), (1046, 3047), (1047, 3048))
    # A quicker frame makes all that follow later.
    late += ((3100, 3050), (5099, 7050), (5100, 7052), (5193, 7145), (5194, 7146))
    for robot, begins, earlier in ((0, 0, 0), (1, 0x02030000, 1000)):
        for t, now in late:
            tale.call("sealed_recv", robot, (now - earlier,), (sealed_frame(begins + t, 0x2001),))
    # As late as the quickest, which stays the quickest; and behind the quickest in time.
    for t, now in ((1000, 1000), (5047, 5048), (5093, 7095)):
        tale.call("sealed_recv", 2, (now,), (sealed_frame(t, 0x2001),))
    for t, now in ((3100, 7100), (3090, 7150), (5200, 11_205), (5203, 11_205)):
        tale.call("sealed_recv", 2, (now,), (sealed_frame(t, 0x2002),))
    for t, now in ((0, 5), (0, 5), (1, 5)):
        tale.call("sealed_recv", 3, (now,), (sealed_frame(t, 0x2001),))
    # Half of the clock later: 2000 ms late when drift is taken off, and 2001.
    since = 2**31 + 2**21
    t = 5 + since - since // 2048 - 2000
    for late_t, now in ((5, 5), (t - 1, 5 + since), (t, 5 + since), (END, END - 1)):
        tale.call("sealed_recv", 3, (now,), (sealed_frame(late_t, 0x2003),))
    yield tale.case()
    tale, chance = Tale("a frame that is behind", "hardened", t_val_ms=10**9, **AIR), random.Random(3)  # noqa: S311
    newest = 100
    for t in (100, 100, 99, 99, 68, 68, 163, 100, 99, 227, 164, 163, 291, 292, 229, 228):
        tale.call("sealed_recv", 0, (300,), (sealed_frame(t, 0x2001),))
    for _ in range(150):
        ahead = chance.choice((1, 2, 5, 17, 31, 32, 33, 40, 63, 64, 65))
        t = newest + chance.choice((ahead, *[-chance.randrange(66)] * 4))
        newest = max(newest, t)
        tale.call("sealed_recv", 0, (900,), (sealed_frame(t, 0x2002),))
    yield tale.case()
    tale = Tale("a burst", "hardened", **AIR)
    for at, count in ((0, 1), (1000, 259), (1001, 2), (1002, 1), (2000, 2), (END - 1, 2)):
        for _ in range(count):
            tale.call("sealed_send", 0, (at,), (b"\x01",))
    yield tale.case()
    tale = Tale("senders", "hardened", now=1000, t_val_ms=500, **AIR)
    for k in range(64):
        tale.call("sealed_recv", 0, (1000 + k,), (sealed_frame(70_000 + k, 0x100 + k),))
    tale.call("sealed_recv", 0, (1100,), (sealed_frame(5, 0x900),))  # a 65th
    tale.call("sealed_recv", 0, (1100,), (sealed_frame(70_100, 0x100),))  # whose place is judged by it from now on
    for now in (1501, 1502, 1502, 1503, 1504):
        tale.call("sealed_recv", 0, (now,), (sealed_frame(now, 0x900 + now),))
    for src in (0x101, 0x102, 0x103):  # of whom two have lost their places
        tale.call("sealed_recv", 0, (1504,), (sealed_frame(70_000 + (src & 255), src),))
    # Who takes a place takes nothing over from who had it.
    for t in (70_123, 70_143, 70_168):
        tale.call("sealed_recv", 0, (1600,), (sealed_frame(t, 0x103),))
    for k in range(64):
        tale.call("sealed_recv", 0, (2200,), (sealed_frame(500, 0x901 + k),))
        if k == 0:  # which took the place of the oldest, not of the last that is old
            tale.call("sealed_recv", 0, (2200,), (sealed_frame(70_063, 0x13F),))
    for k in range(64):
        tale.call("sealed_recv", 0, (2200,), (sealed_frame(455, 0x901 + k),))
    yield tale.case()
    tale = Tale("errors of a sealed radio", "hardened", now=1000, **AIR)
    good = sealed_frame(1000, 0x2001)
    whole = (good + bytes(2049), sealed_frame(1, 0), sealed_frame(1, IDS[0]), good, good)
    for raw in (b"", good[-14:], good[-15:], *whole):
        tale.call("sealed_recv", 0, (1000,), (raw,))
    for _, (raw,) in flipped((), (), (sealed_frame(1001, 0x2001),)):
        tale.call("sealed_recv", 0, (1001,), (raw,))
    for size in (0, 1, 2033, 2034, 2035, 2048, 2049):
        tale.call("sealed_send", 0, (1002,), (b"\x01" * size,))
    tale.call("sealed_recv", 1, (1002,), (sealed_frame(7, 0x2001, b"\x01" * 2034),))
    tale.call("sealed_send", 0, (1003,), (b"\x80\1\2\3\4",))
    tale.call("sealed_send", 0, (1003,), (b"\x80\1\2\3\4\5",))
    for name in ("sealed_send", "sealed_recv"):
        tale.call(name, 0, (END,), (good,))
        tale.call(name, 0, (END,), (good,))
    tale.call("anode_power_up", 1)
    for name in ("sealed_send", "sealed_recv"):
        for raw in (good, b"", b"\x01" * 2040, b"\x01" * 2049):
            tale.call(name, 1, (1003,), (raw,))
            tale.call(name, 0, (END,), (raw,))
    tale.call("make_sealed", 1)
    yield tale.case()


def refused(profile: str) -> Case:
    """Limits with which no node is made; what it had it keeps."""
    none = [name for name in LIMITS if name != "f_max" and not name.startswith("airtime")]
    bad = [LIMITS | {"f_max": 16}, LIMITS | {"f_max": END}, *(LIMITS | {name: 0} for name in none)]
    return {"name": f"{profile}: limits that make no sense", "profile": profile, "limits": LIMITS, "refused": bad} | {
        "calls": Tale("", profile).calls
    }


def edges() -> list[Case]:
    both = [make(profile) for make in (macs, zeros, errors, refused, late_keys) for profile in ("hardened", "paper")]
    kept = [tokens(profile, f_max) for f_max in (0, 1, 2, 15) for profile in ("hardened", "paper") if f_max < 8]
    return [
        *both,
        *kept,
        tokens("hardened", 15),
        *(any_tokens(profile, seed) for profile in ("hardened", "paper") for seed in range(9)),
        *map(places, (1, 2, 3)),
        keys(),
        clock(),
        *buckets(),
        *sealed(),
    ]


VECTORS = {"edges": edges}

if __name__ == "__main__":
    (HERE / "edges.json").write_text(text(edges()))
