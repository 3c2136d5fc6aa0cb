"""The C and the plain-Python nodes agree, call by call, and what they sign is what they may sign."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from asked_nodes import Nodes
from oracle import nodes as oracle
from oracle.lightmac import lightmac
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Refused, seal_mission_key
from small_limits import LIMITS

MASTER = bytes(range(100, 120))
MISSION = bytes(range(7, 27))
CHECKPOINTS = [bytes([n]) * 20 for n in (1, 2)]
N = 5
SELDOM = st.integers(0, 15).map(lambda n: n == 7)
ROBOTS = st.integers(0, N - 1)
IDS = st.integers(0, N + 1)
NONCES = st.sampled_from([bytes(8), b"nonce  1"])
PAYLOADS = st.one_of(
    st.binary(max_size=40),
    st.binary(max_size=60).map(lambda raw: b"\x80" + raw),
    st.tuples(st.integers(0, 255), st.sampled_from([2047, 2048, 2049, 5000])).map(lambda x: bytes([x[0]]) * x[1]),
)


@pytest.fixture(scope="module", autouse=True)
def _as_robots_compute():
    for profile in (trusted.HARDENED, trusted.PAPER):
        trusted.host_use(profile, 0)


class Both(RuleBasedStateMachine):
    """N robots twice. A c-node has every byte that it ever got, and tries them where they do not belong."""

    profile: int

    @initialize(unloaded=SELDOM)
    def manufacture(self, unloaded):
        self.hardened = self.profile == trusted.HARDENED
        self.c = Nodes(N, self.profile, LIMITS)
        self.s = [oracle.SNode(self.hardened, LIMITS) for _ in range(N)]
        self.a = [oracle.ANode(self.hardened, LIMITS) for _ in range(N)]
        self.now = 0
        self.made = set()
        self.macs = [bytes(8)]
        self.tops = [bytes(20)]
        self.requests = [(bytes(32), 0, 0)]
        if not unloaded:
            for i in range(N):
                self.load_master(i, MASTER, i + 1)
                self.load_mission(i, 1, 0)
            self.now = LIMITS.bucket_capacity * LIMITS.bucket_period_ms

    def same(self, i, name, *arguments, nodes="sa"):
        """What both answered: None where they refused, for the same reason."""
        try:
            said = getattr(self.c, name)(i, *arguments)
        except Refused as refused:
            said = refused.reason
        expected = None
        try:
            for kind in nodes:
                expected = getattr(getattr(self, kind)[i], name)(*arguments)
        except oracle.No as no:
            assert said == no.args[0].lower()
            return None
        assert said == expected
        self.remember_or_require(i, name, arguments, said)
        return said

    def remember_or_require(self, i, name, arguments, said):
        """In `hardened`, what is checked for good was made by the one who is named; what is issued was asked for."""
        node = self.s[i] if "auth" in name else self.a[i]
        if not self.hardened or node.key != MISSION:
            return
        if name == "make_auth":
            self.made.add(("auth", said[:20], i + 1, *arguments))
        elif name == "check_auth":
            assert ("auth", *arguments[:3]) in self.made
        elif name == "token_request":
            self.made.add(("request", i + 1, arguments[1], arguments[0], said[4:24]))
        elif name == "issue_token":
            auditee, t, top, _, hckpt = arguments
            assert ("request", auditee, i + 1, t, top) in self.made
            self.made.add(("token", i + 1, auditee, t, hckpt))
        elif name == "check_token":
            assert ("token", *arguments[:4]) in self.made
        elif name == "install_token":
            now, auditor, t, hckpt, _ = arguments
            assert ("token", auditor, i + 1, t, hckpt) in self.made
            assert t <= now

    @rule(ms=st.one_of(st.integers(0, 120), st.sampled_from([299, 300, 301])))
    def wait(self, ms):
        self.now = min(self.now + ms, 2**32 - 1)

    @rule(seldom=SELDOM, back=st.integers(0, 3))
    def wait_for_the_end_of_the_clock(self, seldom, back):
        if seldom:
            self.now = max(self.now, 2**32 - 1 - back)

    @rule(seldom=SELDOM, i=ROBOTS)
    def lose_power(self, seldom, i):
        if seldom:
            self.c.power_up(i)
            self.s[i].power_up()
            self.a[i].power_up()

    @rule(i=ROBOTS, key=st.sampled_from([MASTER, bytes(20)]), robot_id=IDS)
    def load_master(self, i, key, robot_id):
        self.same(i, "load_master", key, robot_id)

    @rule(i=ROBOTS, seq=st.integers(1, 4), wrong=st.sampled_from([0, 0, 0, 1, 2, 3, 4, 5]))
    def load_mission(self, i, seq, wrong):
        mission = bytes(20) if wrong == 5 else MISSION
        sealed = seal_mission_key(bytes(20) if wrong == 4 else MASTER, mission, bytes([seq]) * 20, seq)
        assert sealed.mac == lightmac(
            bytes(20) if wrong == 4 else MASTER, b"\x10" + sealed.k + sealed.r + oracle.u32(seq)
        )
        if wrong == 1:
            sealed = sealed._replace(k=bytes(20))
        elif wrong == 2:
            sealed = sealed._replace(seq=seq + 1)
        elif wrong == 3:
            sealed = sealed._replace(mac=self.macs[-1])
        try:
            self.c.load_mission(i, self.now, sealed)
            said = None
        except Refused as refused:
            said = refused.reason
        try:
            self.s[i].load_mission(self.now, *sealed)
            self.a[i].load_mission(self.now, *sealed)
            assert said is None
        except oracle.No as no:
            assert said == no.args[0].lower()

    @rule(i=ROBOTS, payload=PAYLOADS)
    def poll(self, i, payload):
        self.same(i, "poll", self.now, payload, nodes="s")

    @rule(i=ROBOTS, name=st.sampled_from(["recv", "send", "send", "actuate"]), payload=PAYLOADS)
    def forward(self, i, name, payload):
        self.same(i, name, self.now, payload, nodes="a")

    @rule(
        i=ROBOTS,
        head=st.sampled_from([b"\x01", b"\x80----", b"\x80--\0\0", b"\x80--\0\1"]),
        length=st.integers(5, 2048),
    )
    def shout(self, i, head, length):
        for _ in range(4):
            self.same(i, "send", self.now, head.ljust(length, b"!"), nodes="a")

    @rule(i=ROBOTS, nonce=NONCES, j=ROBOTS, swapped=st.booleans())
    def authenticate(self, i, nonce, j, swapped):
        said = self.same(i, "make_auth", nonce, nodes="s")
        if said:
            self.macs.append(said[22:])
            self.tops.append(said[:20])
            self.same(j, "check_auth", said[:20], i + 1, bytes(8) if swapped else nonce, said[22:], nodes="s")

    @rule(i=ROBOTS, j=ROBOTS)
    def authenticate_a(self, i, j):
        if self.hardened:
            return
        said = self.same(i, "make_auth_a", nodes="a")
        self.macs.append(said[22:])
        self.same(j, "check_auth_a", said[:20], i + 1, said[22:], nodes="s")
        self.same(j, "check_auth", said[:20], i + 1, bytes(8), said[22:], nodes="s")

    @rule(i=ROBOTS, auditor=IDS)
    def request(self, i, auditor):
        said = self.same(i, "token_request", self.now, auditor, nodes="a")
        if said:
            self.macs.append(said[24:])
            self.tops.append(said[4:24])
            self.requests.append((said, i + 1, auditor))

    @rule(data=st.data(), hckpt=st.sampled_from(CHECKPOINTS), wrong=st.sampled_from([0, 0, 0, 1, 2, 3]), install=IDS)
    def audit(self, data, hckpt, wrong, install):
        said, auditee, auditor = data.draw(st.sampled_from(self.requests))
        if not 1 <= auditor <= N:
            return
        t, top, mac = int.from_bytes(said[:4], "little"), said[4:24], said[24:]
        if wrong == 1:
            t = min(t + 50, 2**32 - 1)
        elif wrong == 2:
            top = data.draw(st.sampled_from(self.tops))
        elif wrong == 3:
            auditee = data.draw(IDS)
        token = self.same(auditor - 1, "issue_token", auditee, t, top, mac, hckpt, nodes="a")
        if token:
            self.macs.append(token)
            self.use_token(auditee, auditor, t, hckpt, token, install)

    @rule(auditee=st.integers(1, N), tors=st.permutations(range(1, N + 1)), ms=st.integers(60, 130))
    def round_of_audits(self, auditee, tors, ms):
        """What honest robots do, so that they live."""
        self.wait(ms)
        for auditor in tors[:3]:
            self.request(auditee - 1, auditor)
            said, asked, answering = self.requests[-1]
            if (asked, answering) == (auditee, auditor) and auditor != auditee:
                t = int.from_bytes(said[:4], "little")
                token = self.same(
                    auditor - 1, "issue_token", auditee, t, said[4:24], said[24:], CHECKPOINTS[0], nodes="a"
                )
                if token:
                    self.macs.append(token)
                    self.use_token(auditee, auditor, t, CHECKPOINTS[0], token, auditee)

    def use_token(self, auditee, auditor, t, hckpt, token, other):
        for i in {auditee - 1, other - 1} & set(range(N)):
            self.same(i, "check_token", auditor, auditee, t, hckpt, token, nodes="a")
            self.same(i, "install_token", self.now, auditor, t, hckpt, token, nodes="a")

    @rule(data=st.data(), auditor=IDS, i=ROBOTS, ahead=st.sampled_from([-100, 0, 1, 2**32]))
    def forge(self, data, auditor, i, ahead):
        """Any MAC ever seen, or one under the zero key, shown as a token, an authenticator and a request."""
        t, hckpt = max(0, min(self.now + ahead, 2**32 - 1)), CHECKPOINTS[0]
        zero = lightmac(bytes(20), b"\x14" + oracle.u16(auditor) + oracle.u16(i + 1) + oracle.u32(t) + hckpt)
        mac = data.draw(st.sampled_from([*self.macs[-20:], zero, zero]))
        top = data.draw(st.sampled_from(self.tops[-20:]))
        self.same(i, "check_token", auditor, i + 1, t, hckpt, mac, nodes="a")
        self.same(i, "install_token", self.now, auditor, t, hckpt, mac, nodes="a")
        self.same(i, "check_auth", top, auditor, bytes(8), mac, nodes="s")
        self.same(i, "issue_token", auditor, t, top, mac, hckpt, nodes="a")

    @rule()
    def check_tokens(self):
        said = self.c.check_all(np.full(N, self.now, np.uint32))
        assert list(said) == [a.check(self.now) for a in self.a]

    @rule(i=ROBOTS)
    def check_one(self, i):
        assert trusted.anode_check(self.profile, self.c.anode[i], self.now) == self.a[i].check(self.now)

    @invariant()
    def safe_modes_agree(self):
        if hasattr(self, "c"):
            assert [self.c.is_safe(i) for i in range(N)] == [a.safe for a in self.a]

    @invariant()
    def nothing_is_forwarded_in_safe_mode_or_without_a_key(self):
        # Bytes that would pass if anything did: on copies, so that the check changes nothing.
        if not hasattr(self, "c"):
            return
        for i in range(N):
            node, entry = self.c.anode[i].copy(), np.zeros(40, np.uint8)
            said = trusted.anode_actuate(self.profile, node, self.now, np.ones(4, np.uint8), 4, entry)
            if self.a[i].safe or not self.a[i].has_key():
                assert said < 0
                assert not entry.any()


class BothBound(Both):
    profile = trusted.HARDENED


class BothPaper(Both):
    profile = trusted.PAPER


RUNS = settings(
    max_examples=20,
    stateful_step_count=50,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)


class TestBound(BothBound.TestCase):
    settings = RUNS


class TestPaper(BothPaper.TestCase):
    settings = RUNS


@pytest.mark.long
class TestMoreOfBound(BothBound.TestCase):
    settings = settings(RUNS, max_examples=100)


@pytest.mark.long
class TestMoreOfPaper(BothPaper.TestCase):
    settings = settings(RUNS, max_examples=100)


def test_limits_have_the_order_of_the_c_struct():
    ffi, _ = trusted.FIRMWARE[trusted.HARDENED]
    assert [name for name, _ in ffi.typeof("phx_limits").fields] == [f.name for f in dataclasses.fields(Limits)]
