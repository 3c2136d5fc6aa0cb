"""What the a-node's buckets hold, to the nanosecond: at a new key, and when they are full again."""

from __future__ import annotations

import pytest

from keyed_nodes import keyed, refusal

KEYED_MS = 100_000
NS_PER_BYTE = 1000
# A bucket of one packet of 1000 bytes, filled in one second; another byte is one too many.
AIR = {
    "airtime_fixed_us": 0,
    "airtime_ns_per_byte_broadcast": NS_PER_BYTE,
    "airtime_ns_per_byte_unicast": NS_PER_BYTE,
    "send_us_per_s": 1000,
    "send_capacity_us": 1000,
    "audit_us_per_s": 1000,
    "audit_capacity_us": 1000,
}
both_sorts = pytest.mark.parametrize("kind", [b"\x01", b"\x80"], ids=["ordinary", "audit"])


def packet(kind, length):
    """To all."""
    return kind.ljust(length, b"\0")


@both_sorts
@pytest.mark.parametrize("after_ms", [0, 1000, 50_000])
def test_airtime_is_full_at_a_new_key_and_never_fuller(kind, after_ms):
    nodes = keyed(now=KEYED_MS, **AIR)
    assert nodes.send(0, KEYED_MS + after_ms, packet(kind, 994))
    assert nodes.send(0, KEYED_MS + after_ms, packet(kind, 6))
    assert refusal(nodes.send, 0, KEYED_MS + after_ms, packet(kind, 6)) == "airtime"
    assert refusal(nodes.send, 0, KEYED_MS + after_ms + 5, packet(kind, 6)) == "airtime"
    assert nodes.send(0, KEYED_MS + after_ms + 6, packet(kind, 6))


@both_sorts
@pytest.mark.parametrize("length, passes", [(10, True), (11, False)])
def test_a_frame_costs_its_fixed_time_and_its_bytes(kind, length, passes):
    nodes = keyed(now=KEYED_MS, **(AIR | {"airtime_fixed_us": 990}))
    if passes:
        assert nodes.send(0, KEYED_MS, packet(kind, length))
    else:
        assert refusal(nodes.send, 0, KEYED_MS, packet(kind, length)) == "airtime"


@pytest.mark.parametrize("to", [b"\x05\x00", b"\x00\x05", b"\x05\x05"])
def test_a_frame_to_one_robot_costs_what_a_frame_to_one_costs(to):
    nodes = keyed(now=KEYED_MS, **(AIR | {"airtime_ns_per_byte_unicast": NS_PER_BYTE // 10}))
    to_one = b"\x80\0\0" + to
    assert nodes.send(0, KEYED_MS, to_one.ljust(2000, b"\0"))
    assert nodes.send(0, KEYED_MS, packet(b"\x80", 800))
    assert refusal(nodes.send, 0, KEYED_MS, packet(b"\x80", 6)) == "airtime"


def test_token_requests_are_none_at_a_new_key_however_long_the_node_was_up():
    nodes = keyed(now=KEYED_MS, bucket_capacity=2, bucket_period_ms=1000)
    assert refusal(nodes.token_request, 0, KEYED_MS, 2) == "bucket"
    assert refusal(nodes.token_request, 0, KEYED_MS + 999, 2) == "bucket"
    assert nodes.token_request(0, KEYED_MS + 1000, 2)
