"""Algorithms 2-4 of RoboRebound in plain Python, in both profiles; errors are the C's codes by name.

`paper` is the algorithms as printed with the errata of docs/spec/rebound-nodes.md; `hardened` is that page. The chain
keeps its batch as printed, and every message is put together here, not by phalanx.wire.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha1

from .lightmac import lightmac

ZERO_KEY, ZERO_HASH = bytes(20), bytes(20)
END_OF_CLOCK = 2**32 - 1
INPUT, RECV, SEND, ACMD = 1, 2, 3, 4
PACKET_MAX = 2048


class No(Exception):
    """A refusal; `args[0]` is the error's name."""


def u16(n: int) -> bytes:
    return n.to_bytes(2, "little")


def u32(n: int) -> bytes:
    return n.to_bytes(4, "little")


@dataclass
class Bucket:
    """A leaky bucket: `per_ms` come in each millisecond, up to `capacity`."""

    per_ms: int
    capacity: int
    level: int = 0
    last: int = 0

    def draw(self, now: int, cost: int) -> bool:
        self.level = min(self.capacity, self.level + self.per_ms * (now - self.last))
        self.last = now
        if self.level < cost:
            return False
        self.level -= cost
        return True


@dataclass
class Node:
    """Algorithm 2. `limits` is a phalanx.bti.nodes.Limits."""

    hardened: bool
    limits: object
    robot_id: int = 0
    master: bytes | None = None
    key_seq: int = 0

    def __post_init__(self):
        self.power_up()

    def power_up(self) -> None:
        self.key: bytes | None = None
        self.was_keyed = self.safe = False
        self.buffer: list[bytes] = []
        self.top = ZERO_HASH

    # --- keys

    def load_master(self, key: bytes, robot_id: int) -> None:
        if robot_id == 0:
            raise No("ARG")
        if self.master is not None and (self.hardened or self.master != ZERO_KEY):
            raise No("SEQ")
        self.master, self.robot_id = key, robot_id

    def load_mission(self, now: int, k: bytes, r: bytes, seq: int, mac: bytes) -> None:
        self.clock(now)
        if self.safe:
            raise No("SAFE_MODE")
        if self.hardened and self.master is None:
            raise No("NO_KEY")
        master = self.master or ZERO_KEY
        if lightmac(master, b"\x10" + k + r + u32(seq)) != mac:
            raise No("BAD_MAC")
        if seq <= self.key_seq or self.was_keyed:
            raise No("SEQ")
        self.key_seq = seq
        self.key = bytes(a ^ b for a, b in zip(k, sha1(r + master).digest(), strict=True))
        self.was_keyed = True
        if self.hardened:
            self.top, self.buffer = ZERO_HASH, []
        self.mission_starts(now)

    def mission_starts(self, now: int) -> None:
        pass

    def clock(self, now: int) -> None:
        if now == END_OF_CLOCK:
            self.safe, self.key = True, None
            raise No("CLOCK")

    def has_key(self) -> bool:
        return self.key is not None and (self.hardened or self.key != ZERO_KEY)

    def mac(self, message: bytes) -> bytes:
        if self.hardened and self.safe:
            raise No("SAFE_MODE")
        if self.hardened and self.key is None:
            raise No("NO_KEY")
        return lightmac(self.key or ZERO_KEY, message)

    # --- the chain

    def flush(self) -> None:
        if self.buffer:
            self.top = sha1(self.top + b"".join(self.buffer)).digest()
        self.buffer = []

    def append(self, entry: bytes) -> None:
        self.buffer.append(entry)
        if len(self.buffer) == self.limits.batch_size:
            self.flush()

    def may_forward(self, now: int, payload: bytes) -> None:
        self.clock(now)
        if self.safe:
            raise No("SAFE_MODE")
        if not self.has_key():
            raise No("NO_KEY")
        if len(payload) > PACKET_MAX:
            raise No("TOO_LONG")
        if not payload:
            raise No("ARG")

    def forward(self, kind: int, now: int, payload: bytes) -> bytes:
        entry = bytes([kind]) + u32(now) + u16(len(payload)) + payload
        if kind in (INPUT, ACMD) or not payload[0] & 0x80:
            self.append(entry)
        return entry

    # --- authenticators

    def auth_message(self, kind: int, top: bytes, robot_id: int, nonce: bytes) -> bytes:
        return bytes([kind]) + top + u16(robot_id) + (nonce if self.hardened else b"")

    def make_auth_as(self, kind: int, nonce: bytes) -> bytes:
        self.mac(b"")
        self.flush()
        return self.top + u16(self.robot_id) + self.mac(self.auth_message(kind, self.top, self.robot_id, nonce))

    def check_auth_as(self, kind: int, top: bytes, robot_id: int, nonce: bytes, mac: bytes) -> None:
        if self.mac(self.auth_message(kind, top, robot_id, nonce)) != mac:
            raise No("BAD_MAC")


class SNode(Node):
    """Algorithm 3."""

    def poll(self, now: int, reading: bytes) -> bytes:
        self.may_forward(now, reading)
        return self.forward(INPUT, now, reading)

    def make_auth(self, nonce: bytes) -> bytes:
        return self.make_auth_as(0x11, nonce)

    def check_auth(self, top: bytes, robot_id: int, nonce: bytes, mac: bytes) -> None:
        self.check_auth_as(0x11, top, robot_id, nonce, mac)

    def check_auth_a(self, top: bytes, robot_id: int, mac: bytes) -> None:
        self.check_auth_as(0x12, top, robot_id, b"", mac)


@dataclass
class ANode(Node):
    """Algorithm 4."""

    tokens: dict[int, int] = field(default_factory=dict)

    def power_up(self) -> None:
        super().power_up()
        lim = self.limits
        self.keyed_at = 0
        self.tokens = {}  # auditor: t, in the order in which they came
        self.requests = Bucket(1, lim.bucket_capacity * lim.bucket_period_ms)
        self.airtime = {
            False: Bucket(lim.send_us_per_s, lim.send_capacity_us * 1000),
            True: Bucket(lim.audit_us_per_s, lim.audit_capacity_us * 1000),
        }

    def mission_starts(self, now: int) -> None:
        self.keyed_at = now
        if not self.hardened:
            return
        self.tokens = {}
        self.requests.level, self.requests.last = 0, now
        for bucket in self.airtime.values():
            bucket.level, bucket.last = bucket.capacity, now

    def recv(self, now: int, packet: bytes) -> bytes:
        self.may_forward(now, packet)
        return self.forward(RECV, now, packet)

    def send(self, now: int, packet: bytes) -> bytes:
        self.may_forward(now, packet)
        if self.hardened:
            audit = packet[0] >= 0x80
            if audit and len(packet) < 6:
                raise No("ARG")
            lim = self.limits
            unicast = audit and packet[3:5] != b"\0\0"
            per_byte = lim.airtime_ns_per_byte_unicast if unicast else lim.airtime_ns_per_byte_broadcast
            if not self.airtime[audit].draw(now, lim.airtime_fixed_us * 1000 + per_byte * len(packet)):
                raise No("AIRTIME")
            if audit:
                packet = packet[:1] + u16(self.robot_id) + packet[3:]
        return self.forward(SEND, now, packet)

    def actuate(self, now: int, command: bytes) -> bytes:
        self.may_forward(now, command)
        return self.forward(ACMD, now, command)

    def make_auth_a(self) -> bytes:
        return self.make_auth_as(0x12, b"")

    # --- tokens

    def treq(self, t: int, auditee: int, auditor: int, top: bytes) -> bytes:
        return b"\x13" + u32(t) + u16(auditee) + u16(auditor) + (top if self.hardened else b"")

    def token(self, auditor: int, auditee: int, t: int, hckpt: bytes) -> bytes:
        return self.mac(b"\x14" + u16(auditor) + u16(auditee) + u32(t) + hckpt)

    def token_request(self, now: int, auditor: int) -> bytes:
        self.clock(now)
        self.mac(b"")
        if auditor == 0:
            raise No("ARG")
        if not self.requests.draw(now, self.limits.bucket_period_ms):
            raise No("BUCKET")
        top = ZERO_HASH
        if self.hardened:
            self.flush()
            top = self.top
        return u32(now) + top + self.mac(self.treq(now, self.robot_id, auditor, top))

    def issue_token(self, auditee: int, t: int, top: bytes, treq_mac: bytes, hckpt: bytes) -> bytes:
        self.mac(b"")
        if auditee == self.robot_id:
            raise No("SELF")
        if self.mac(self.treq(t, auditee, self.robot_id, top)) != treq_mac:
            raise No("BAD_MAC")
        return self.token(self.robot_id, auditee, t, hckpt)

    def check_token(self, auditor: int, auditee: int, t: int, hckpt: bytes, mac: bytes) -> None:
        if self.token(auditor, auditee, t, hckpt) != mac:
            raise No("BAD_MAC")

    def install_token(self, now: int, auditor: int, t: int, hckpt: bytes, mac: bytes) -> None:
        self.clock(now)
        self.check_token(auditor, self.robot_id, t, hckpt, mac)
        if auditor == 0:
            raise No("ARG")
        if self.hardened and t > now:
            raise No("FUTURE")
        if auditor in self.tokens:
            if not self.hardened or t > self.tokens[auditor]:
                self.tokens[auditor] = t
        elif len(self.tokens) < 2 * self.limits.f_max + 1:
            self.tokens[auditor] = t
        else:
            oldest = min(self.tokens, key=self.tokens.__getitem__)
            if t > self.tokens[oldest]:
                # In place: of two tokens of the same age the one in the earlier place goes first.
                self.tokens = dict((auditor, t) if o == oldest else (o, old) for o, old in self.tokens.items())

    def check(self, now: int) -> int:
        try:
            self.clock(now)
        except No:
            return 1
        if self.safe or not self.was_keyed or now < self.keyed_at + self.limits.t_val_ms:
            return int(self.safe)
        valid = sum(t >= now - self.limits.t_val_ms for t in self.tokens.values())
        if valid < self.limits.f_max + 1:
            self.safe, self.key = True, None
        return int(self.safe)
