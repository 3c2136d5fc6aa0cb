"""The trusted nodes: published vectors, what they refuse, and the printed protocol's holes, open and closed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asked_nodes import Nodes
from keyed_nodes import LIMITS, MASTER, MISSION, R, keyed, refusal
from oracle.lightmac import lightmac
from oracle.nodes import u16, u32
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Refused, seal_mission_key
from phalanx.config import BtiConfig
from phalanx.errors import UsageError
from phalanx.wire import table

ROOT = Path(__file__).parent.parent
VECTORS = ROOT / "vectors"
HCKPT = b"checkpoint" * 2
STATE = b"\x01".ljust(27, b"s")
BOTH = pytest.mark.parametrize("profile", [trusted.HARDENED, trusted.PAPER], ids=["hardened", "paper"])


@pytest.fixture(scope="module", autouse=True)
def _as_robots_compute():
    for profile in (trusted.HARDENED, trusted.PAPER):
        trusted.host_use(profile, 0)


def cases(name):
    return json.loads((VECTORS / f"{name}.json").read_text())["cases"]


def each(name):
    return pytest.mark.parametrize("case", cases(name), ids=lambda case: case["name"])


def row(raw):
    return np.frombuffer(bytearray(raw), np.uint8)


def audited(nodes, auditee, auditor, now):
    """A token for robot `auditee` from robot `auditor`, by rows: (t, mac)."""
    request = nodes.token_request(auditee, now, auditor + 1)
    t = int.from_bytes(request[:4], "little")
    return t, nodes.issue_token(auditor, auditee + 1, t, request[4:24], request[24:], HCKPT)


class TestVectors:
    @each("present")
    def test_present_encrypts_as_published(self, case):
        ffi, lib = trusted.FIRMWARE[trusted.HARDENED]
        cipher = bytearray(8)
        lib.phx_present80(
            bytes.fromhex(case["key"]), bytes.fromhex(case["plain"]), ffi.from_buffer("uint8_t[]", cipher)
        )
        assert cipher.hex() == case["cipher"]

    @each("sha1")
    def test_sha1_hashes_as_published(self, case):
        message, digest = row(bytes.fromhex(case["message"]) * case["times"]), np.zeros(20, np.uint8)
        assert trusted.sha1(message, len(message), digest) == 0
        assert digest.tobytes().hex() == case["digest"]

    @each("lightmac")
    def test_lightmac_authenticates_as_the_oracle_does(self, case):
        message, mac = row(bytes.fromhex(case["message"])), np.zeros(8, np.uint8)
        code = trusted.lightmac(row(bytes.fromhex(case["key"])), message, len(message), mac)
        if case["expect"] == "ok":
            assert (code, mac.tobytes().hex()) == (0, case["mac"])
        else:
            assert trusted.REASONS[code] == case["expect"].lower()

    @each("nodes")
    def test_nodes_answer_as_the_oracle_does(self, case):
        profile = ["hardened", "paper"].index(case["profile"])
        ffi, lib = trusted.FIRMWARE[profile]
        nodes = Nodes(4, profile, Limits(**case["limits"]))
        for step, call in enumerate(case["calls"]):
            function = getattr(lib, f"phx_{call['call']}")
            node = getattr(nodes, call["call"].partition("_")[0])[call["robot"]]
            texts = [bytes.fromhex(text) for text in call["bytes"]]
            numbers = iter([*call["numbers"], len(texts[0]) if texts else 0])
            out = np.zeros(table.PACKET_MAX + table.ENTRY_HEADER_BYTES, np.uint8)
            left = iter(texts)
            values = [ffi.cast("void *", node.ctypes.data)]
            for argument in ffi.typeof(function).args[1:]:
                pointer = argument.kind == "pointer"
                values.append(next(left, ffi.from_buffer("uint8_t[]", out)) if pointer else next(numbers))
            code = function(*values) or 0
            if call["expect"] != "ok":
                assert trusted.REASONS[code] == call["expect"].lower(), step
                continue
            forwards = code > 1
            assert code == (len(call["out"]) // 2 if forwards else call["code"]), step
            assert out[: len(call["out"]) // 2].tobytes().hex() == call["out"], step


class TestForwarding:
    @BOTH
    def test_a_chain_hashes_what_was_forwarded_in_batches(self, profile):
        nodes = keyed(profile, batch_size=2)
        entries = [nodes.poll(0, 10 + k, bytes([k]) * (k + 1)) for k in range(5)]
        assert entries[2] == b"\x01" + u32(12) + u16(3) + b"\2\2\2"
        top = bytes(20)
        for batch in (entries[:2], entries[2:4], entries[4:]):
            top = hashlib.sha1(top + b"".join(batch)).digest()
        assert nodes.make_auth(0, bytes(8))[:20] == top

    @BOTH
    def test_audit_frames_are_forwarded_and_not_chained(self, profile):
        nodes = keyed(profile)
        before = nodes.token_request(0, 5000, 2)[4:24] if profile == trusted.HARDENED else nodes.make_auth_a(0)[:20]
        packet = b"\x80" + u16(7) + u16(2) + b"\x01fragment"
        assert nodes.recv(0, 5001, packet)[7:] == packet
        sent = nodes.send(0, 5002, packet)[7:]
        after = nodes.token_request(0, 5003, 2)[4:24] if profile == trusted.HARDENED else nodes.make_auth_a(0)[:20]
        assert before == after
        # In `hardened` nobody sends one in another's name.
        assert sent == (b"\x80" + u16(1) + packet[3:] if profile == trusted.HARDENED else packet)

    def test_only_audit_frames_get_their_true_source(self):
        packet = b"\x01" + u16(9) + bytes(24)
        assert keyed().send(0, 1, packet)[7:] == packet

    @BOTH
    @pytest.mark.parametrize("call", ["poll", "recv", "send", "actuate"])
    def test_what_is_too_long_or_empty_is_refused_and_leaves_no_trace(self, profile, call):
        nodes = keyed(profile)
        before = nodes.snode.copy(), nodes.anode.copy()
        forward = getattr(nodes, call)
        assert refusal(forward, 0, 5, bytes(2049)) == "too_long"
        assert refusal(forward, 0, 5, bytes(100_000)) == "too_long"
        assert refusal(forward, 0, 5, b"") == "arg"
        assert (nodes.snode == before[0]).all()
        assert (nodes.anode == before[1]).all()
        assert len(forward(0, 5, b"\x01" * 2048)) == 2055 if call != "send" else True

    @BOTH
    def test_without_a_mission_key_nothing_passes(self, profile):
        nodes = Nodes(1, profile, LIMITS)
        nodes.load_master(0, MASTER, 1)
        for forward in (nodes.poll, nodes.recv, nodes.send, nodes.actuate):
            assert refusal(forward, 0, 5, STATE) == "no_key"

    def test_a_jammer_runs_out_of_airtime(self):
        nodes = keyed()
        audit = b"\x80" + bytes(5) + bytes(2000)
        sent = 0
        while sent < 1000:
            try:
                nodes.send(0, 10, audit)
            except Refused as refused:
                assert refused.reason == "airtime"
                break
            sent += 1
        cost_us = LIMITS.airtime_fixed_us + LIMITS.airtime_ns_per_byte_broadcast * len(audit) / 1000
        assert sent == int(LIMITS.audit_capacity_us / cost_us)
        # The other sort has a bucket of its own, which four states empty and time fills again.
        for _ in range(4):
            nodes.send(0, 10, STATE)
        assert refusal(nodes.send, 0, 10, STATE) == "airtime"
        assert nodes.send(0, 1510, STATE)

    def test_an_honest_robot_never_meets_its_limits(self):
        config = BtiConfig()
        nodes = keyed()
        size = int(config.t_val_ms / 1000 * config.log_bytes_per_s) + 66 + 26 * config.n_max + 300
        for round_at in range(4000, 60_000, 4000):
            for k in range(2 * config.f_max + 1):
                nodes.token_request(0, round_at + 50 * k, 2)
                for at in range(0, size, 2038):
                    nodes.send(0, round_at + 50 * k, b"\x80" + u16(1) + u16(2) + bytes(5 + min(2038, size - at)))
            for k in range(6 * config.f_max):
                nodes.send(0, round_at + 500 + k, b"\x80" + u16(1) + u16(3) + bytes(15))
            for k in range(2):
                nodes.send(0, round_at + 1000 + 1500 * k, STATE)


class TestKeys:
    @BOTH
    def test_the_master_key_is_set_once(self, profile):
        nodes = Nodes(1, profile, LIMITS)
        assert refusal(nodes.load_master, 0, MASTER, 0) == "arg"
        nodes.load_master(0, MASTER, 1)
        assert refusal(nodes.load_master, 0, bytes(20), 2) == "seq"

    @BOTH
    def test_a_mission_key_needs_the_master_key_and_a_new_number(self, profile):
        nodes = Nodes(1, profile, LIMITS)
        nodes.load_master(0, MASTER, 1)
        good = seal_mission_key(MASTER, MISSION, R, 5)
        for bad in (
            good._replace(mac=bytes(8)),
            good._replace(seq=6),
            good._replace(k=MISSION),
            good._replace(r=bytes(20)),
        ):
            assert refusal(nodes.load_mission, 0, 0, bad) == "bad_mac"
        nodes.load_mission(0, 0, good)
        # A second key in one power-up would bring a second time of grace.
        assert refusal(nodes.load_mission, 0, 0, seal_mission_key(MASTER, MISSION, R, 6)) == "seq"
        nodes.power_up(0)
        assert refusal(nodes.load_mission, 0, 0, good) == "seq"
        assert refusal(nodes.send, 0, 1, STATE) == "no_key"
        nodes.load_mission(0, 0, seal_mission_key(MASTER, MISSION, R, 6))
        assert nodes.send(0, 1, STATE)

    def test_the_mission_key_travels_blinded(self):
        sealed = seal_mission_key(MASTER, MISSION, R, 1)
        assert sealed.k != MISSION
        assert bytes(a ^ b for a, b in zip(sealed.k, hashlib.sha1(R + MASTER).digest())) == MISSION
        with pytest.raises(UsageError, match="20 bytes"):
            seal_mission_key(MASTER, MISSION, b"", 1)

    def test_an_audit_frame_is_at_least_its_header(self):
        nodes, packet = keyed(n=1), b"\x80" + bytes(5)
        nodes.send(0, 100, packet)
        assert refusal(nodes.send, 0, 100, packet[:-1]) == refusal(nodes.send, 0, 100, b"")

    def test_limits_that_make_no_sense_are_refused(self):
        Nodes(1, trusted.HARDENED, replace(LIMITS, f_max=15))
        for wrong in ({"f_max": 16}, {"batch_size": 0}, {"bucket_period_ms": 0}, {"t_val_ms": -1}, {"t_val_ms": 2**32}):
            with pytest.raises(UsageError, match="limit"):
                Nodes(1, trusted.HARDENED, replace(LIMITS, **wrong))


class TestTokens:
    @BOTH
    def test_enough_fresh_tokens_keep_a_robot_alive(self, profile):
        nodes = keyed(profile, n=5, f_max=1)
        for now in range(4000, 40_000, 4000):
            for auditor in (1, 2):
                t, mac = audited(nodes, 0, auditor, now)
                nodes.install_token(0, now, auditor + 1, t, HCKPT, mac)
            assert trusted.anode_check(profile, nodes.anode[0], now) == 0
        last = 36_000
        assert trusted.anode_check(profile, nodes.anode[0], last + LIMITS.t_val_ms) == 0
        assert trusted.anode_check(profile, nodes.anode[0], last + LIMITS.t_val_ms + 1) == 1
        for forward in (nodes.recv, nodes.send, nodes.actuate):
            assert refusal(forward, 0, 50_000, STATE) == "safe_mode"
        assert nodes.is_safe(0)
        assert refusal(nodes.load_mission, 0, 50_000, seal_mission_key(MASTER, MISSION, R, 2)) in {"seq", "safe_mode"}

    @BOTH
    def test_many_tokens_of_one_auditor_count_once(self, profile):
        nodes = keyed(profile, f_max=1)
        for now in (4000, 8000, 9999):
            t, mac = audited(nodes, 0, 1, now)
            nodes.install_token(0, now, 2, t, HCKPT, mac)
        assert trusted.anode_check(profile, nodes.anode[0], 10_000) == 1

    @BOTH
    def test_when_all_places_are_taken_the_oldest_token_goes_and_no_newer_one(self, profile):
        # f_max = 1: three places. Two fresh tokens are needed, so the age of the second newest shows.
        nodes = keyed(profile, n=6, f_max=1)
        late = audited(nodes, 0, 5, 3900)
        for auditor, now in ((1, 4000), (3, 6000), (2, 5000), (4, 7000)):
            t, mac = audited(nodes, 0, auditor, now)
            nodes.install_token(0, 7000, auditor + 1, t, HCKPT, mac)
        nodes.install_token(0, 7000, 6, late[0], HCKPT, late[1])
        nodes.anode[1] = nodes.anode[0]
        assert trusted.anode_check(profile, nodes.anode[0], 6000 + LIMITS.t_val_ms) == 0
        assert trusted.anode_check(profile, nodes.anode[1], 6001 + LIMITS.t_val_ms) == 1

    @BOTH
    def test_a_late_token_does_not_take_back_a_newer_one(self, profile):
        nodes = keyed(profile, f_max=1)
        old, new = audited(nodes, 0, 1, 4000), audited(nodes, 0, 1, 8000)
        other = audited(nodes, 0, 2, 8000)
        for auditor, (t, mac) in ((2, new), (3, other), (2, old)):
            nodes.install_token(0, 9000, auditor, t, HCKPT, mac)
        # As printed the map is overwritten with whatever comes last.
        assert trusted.anode_check(profile, nodes.anode[0], 15_000) == (profile == trusted.PAPER)

    @BOTH
    def test_grace_ends_after_t_val(self, profile):
        nodes = keyed(profile, now=500)
        assert trusted.anode_check(profile, nodes.anode[0], 500 + LIMITS.t_val_ms - 1) == 0
        assert trusted.anode_check(profile, nodes.anode[0], 500 + LIMITS.t_val_ms) == 1

    @BOTH
    def test_nobody_audits_itself_and_no_token_serves_another(self, profile):
        nodes = keyed(profile)
        request = nodes.token_request(0, 5000, 1)
        assert refusal(nodes.issue_token, 0, 1, 5000, request[4:24], request[24:], HCKPT) == "self"
        t, mac = audited(nodes, 0, 1, 5000)
        nodes.check_token(2, 2, 1, t, HCKPT, mac)
        assert refusal(nodes.install_token, 2, 5000, 2, t, HCKPT, mac) == "bad_mac"
        assert refusal(nodes.install_token, 0, 5000, 3, t, HCKPT, mac) == "bad_mac"
        assert refusal(nodes.install_token, 0, 5000, 2, t + 1, HCKPT, mac) == "bad_mac"
        assert refusal(nodes.install_token, 0, 5000, 2, t, bytes(20), mac) == "bad_mac"
        nodes.install_token(0, 5000, 2, t, HCKPT, mac)

    def test_a_full_map_keeps_its_tokens_when_an_older_one_comes_late(self):
        nodes = keyed(n=6, f_max=1)
        late = audited(nodes, 0, 5, 3900)
        for auditor, now in ((1, 4000), (2, 5000), (3, 6000)):
            t, mac = audited(nodes, 0, auditor, now)
            nodes.install_token(0, 7000, auditor + 1, t, HCKPT, mac)
        before = nodes.anode[0].copy()
        nodes.install_token(0, 7000, 6, late[0], HCKPT, late[1])
        assert (nodes.anode[0] == before).all()

    @BOTH
    def test_nobody_is_auditor_0(self, profile):
        """Whose MAC is right, were there one: 0 marks a free place."""
        nodes = keyed(profile)
        mac = lightmac(MISSION, b"\x14" + u16(0) + u16(1) + u32(5000) + HCKPT)
        nodes.check_token(0, 0, 1, 5000, HCKPT, mac)
        before = nodes.anode[0].copy()
        assert refusal(nodes.install_token, 0, 5000, 0, 5000, HCKPT, mac) == "arg"
        assert (nodes.anode[0] == before).all()

    def test_a_token_of_a_time_to_come_is_refused(self):
        # Kept over a power-up, with the same mission key loaded again by a careless operator.
        nodes = keyed()
        t, mac = audited(nodes, 0, 1, 9000)
        nodes.power_up(0)
        nodes.load_mission(0, 0, seal_mission_key(MASTER, MISSION, R, 2))
        assert refusal(nodes.install_token, 0, 8999, 2, t, HCKPT, mac) == "future"
        nodes.install_token(0, 9000, 2, t, HCKPT, mac)

    @BOTH
    def test_token_requests_run_out_and_come_again(self, profile):
        nodes = keyed(profile, bucket_capacity=2, bucket_period_ms=1000)
        assert refusal(nodes.token_request, 0, 999, 2) == "bucket"
        assert nodes.token_request(0, 1000, 2)
        for now in (50_000, 50_000):
            assert nodes.token_request(0, now, 2)
        assert refusal(nodes.token_request, 0, 50_999, 2) == "bucket"
        assert nodes.token_request(0, 51_000, 2)

    @BOTH
    def test_the_end_of_the_clock_is_the_end_of_the_mission(self, profile):
        nodes, end = keyed(profile), 2**32 - 1
        assert nodes.poll(0, end - 1, STATE)
        assert refusal(nodes.poll, 0, end, STATE) == "clock"
        assert refusal(nodes.poll, 0, 5, STATE) == "safe_mode"
        assert refusal(nodes.send, 0, end, STATE) == "clock"
        assert nodes.is_safe(0)
        assert trusted.anode_check(profile, nodes.anode[1], end) == 1


def mark_lookalikes(one, other):
    """Where two nodes' memories differ."""
    found = (one != other).nonzero()[0]
    assert len(found) > 0
    return found


@pytest.mark.parametrize("name", ["snode", "anode"])
def test_nothing_of_a_key_is_left_in_safe_mode(name):
    nodes, others = keyed(), Nodes(3, trusted.HARDENED, LIMITS)
    others.load_master(0, MASTER, 1)
    others.load_mission(0, 0, seal_mission_key(MASTER, bytes(20), R, 1))
    at = mark_lookalikes(getattr(nodes, name)[0], getattr(others, name)[0])
    assert len(at) > 300, "what the key was expanded to"
    with pytest.raises(Refused):
        (nodes.poll if name == "snode" else nodes.recv)(0, 2**32 - 1, STATE)
    assert not getattr(nodes, name)[0, at].any()


def test_an_s_node_that_goes_on_after_safe_mode_helps_nobody():
    nodes = keyed()
    request = nodes.token_request(0, 5000, 2)
    assert trusted.anode_check(trusted.HARDENED, nodes.anode[0], LIMITS.t_val_ms) == 1
    later = 2 * LIMITS.t_val_ms
    assert nodes.poll(0, later, STATE)
    kept = nodes.make_auth(0, request[24:])
    nodes.check_auth(1, kept[:20], 1, request[24:], kept[22:])  # as good as ever
    assert refusal(nodes.token_request, 0, later, 2) == "safe_mode"
    t, mac = 5000, nodes.issue_token(1, 1, 5000, request[4:24], request[24:], HCKPT)
    assert refusal(nodes.install_token, 0, later, 2, t, HCKPT, mac) == "safe_mode"
    for forward in (nodes.send, nodes.recv, nodes.actuate):
        assert refusal(forward, 0, later, STATE) == "safe_mode"
    nodes.power_up(0)
    assert refusal(nodes.make_auth, 0, bytes(8)) == refusal(nodes.poll, 0, 1, STATE) == "no_key"


class TestHolesOfThePrintedProtocol:
    def test_an_old_authenticator_answers_a_new_request_in_paper_only(self):
        for profile in (trusted.HARDENED, trusted.PAPER):
            nodes = keyed(profile)
            nodes.poll(0, 10, STATE)
            first = nodes.token_request(0, 5000, 2)
            kept = nodes.make_auth(0, first[24:])
            nodes.poll(0, 6000, b"what must not be seen")
            second = nodes.token_request(0, 7000, 2)
            show = (1, kept[:20], 1, second[24:], kept[22:])
            if profile == trusted.PAPER:
                nodes.check_auth(*show)
            else:
                assert refusal(nodes.check_auth, *show) == "bad_mac"

    def test_an_old_chain_cannot_be_shown_for_a_new_request_in_bound(self):
        nodes = keyed()
        old = nodes.token_request(0, 5000, 2)
        nodes.send(0, 5100, STATE)
        new = nodes.token_request(0, 6000, 2)
        assert old[4:24] != new[4:24]
        assert refusal(nodes.issue_token, 1, 1, 6000, old[4:24], new[24:], HCKPT) == "bad_mac"

    def test_the_zero_key_makes_a_token_for_ever_in_paper_only(self):
        for profile in (trusted.HARDENED, trusted.PAPER):
            nodes = Nodes(1, profile, replace(LIMITS, f_max=1))
            nodes.load_master(0, MASTER, 1)
            forged = {
                auditor: lightmac(bytes(20), b"\x14" + u16(auditor) + u16(1) + u32(2**32 - 1) + HCKPT)
                for auditor in (2, 3)
            }
            for auditor, mac in forged.items():
                if profile == trusted.PAPER:
                    nodes.install_token(0, 0, auditor, 2**32 - 1, HCKPT, mac)
                else:
                    assert refusal(nodes.install_token, 0, 0, auditor, 2**32 - 1, HCKPT, mac) == "no_key"
            nodes.load_mission(0, 0, seal_mission_key(MASTER, MISSION, R, 1))
            an_hour_later = trusted.anode_check(profile, nodes.anode[0], 3_600_000)
            assert an_hour_later == (0 if profile == trusted.PAPER else 1)

    def test_without_a_key_no_mac_is_made_in_bound(self):
        nodes = Nodes(1, trusted.HARDENED, LIMITS)
        assert refusal(nodes.load_mission, 0, 0, seal_mission_key(bytes(20), bytes(20), R, 1)) == "no_key"
        nodes.load_master(0, MASTER, 1)
        assert refusal(nodes.make_auth, 0, bytes(8)) == "no_key"
        assert refusal(nodes.token_request, 0, 9000, 2) == "no_key"
        assert refusal(nodes.issue_token, 0, 2, 0, bytes(20), bytes(8), HCKPT) == "no_key"
        assert refusal(nodes.check_token, 0, 2, 1, 0, HCKPT, bytes(8)) == "no_key"
        assert refusal(nodes.check_auth, 0, bytes(20), 2, bytes(8), bytes(8)) == "no_key"
