"""The C as kernels see it: the same uncompiled, and never a byte outside its rows."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asked_nodes import Nodes
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Refused, seal_mission_key
from phalanx.config import BtiConfig
from phalanx.errors import PeerError, Unavailable
from phalanx.wire import table

ROOT = Path(__file__).parent.parent
MASTER, MISSION = bytes(range(20)), bytes(range(50, 70))
LIMITS = Limits.of(BtiConfig(), fixed_us=100, ns_per_byte_broadcast=1333, ns_per_byte_unicast=300)

STORY = """
import numpy as np
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Nodes, seal_mission_key
from phalanx.config import BtiConfig

def story(profile, anode, snode, entry, packet, out):
    total = 0
    for now in range(50):
        total += trusted.anode_send(profile, anode, 3000 + now, packet, packet.size, entry)
        total += trusted.snode_poll(profile, snode, 3000 + now, packet, packet.size, entry)
    total += trusted.anode_token_request(profile, anode, 5000, 2, out)
    return total + trusted.snode_make_auth(profile, snode, out[24:32], out[32:62])

for profile in (0, 1):
    nodes = Nodes(1, profile, Limits.of(BtiConfig(), 1, 1, 1))
    nodes.load_master(0, bytes(range(20)), 1)
    nodes.load_mission(0, 0, seal_mission_key(bytes(range(20)), bytes(range(50, 70)), bytes(20), 1))
    out = np.zeros(62, np.uint8)
    total = story(profile, nodes.anode[0], nodes.snode[0], np.zeros(99, np.uint8), np.ones(27, np.uint8), out)
    print("story", profile, total, out.tobytes().hex())
"""


def told(**env: str) -> list[str]:
    words = [sys.executable, "-c", STORY]
    done = subprocess.run(words, env=os.environ | env, capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if line.startswith("story")]


def test_nodes_answer_compiled_kernels_and_python_alike():
    compiled = told(PHALANX_PURE="0")
    assert len(compiled) == 2
    assert compiled == told(PHALANX_PURE="1")


def keyed(profile):
    nodes = Nodes(2, profile, LIMITS)
    for i in range(2):
        nodes.load_master(i, MASTER, i + 1)
        nodes.load_mission(i, 0, seal_mission_key(MASTER, MISSION, bytes(20), 1))
    return nodes


def test_buffers_that_are_too_small_never_reach_the_c():
    a, s = keyed(trusted.HARDENED).anode[0], keyed(trusted.HARDENED).snode[0]
    small = {n: np.zeros(n, np.uint8) for n in (7, 8, 19, 20, 29, 31, 33, 34)}
    tight, payload = small[33], np.ones(27, np.uint8)
    for call, node in (
        (trusted.anode_send, a),
        (trusted.anode_recv, a),
        (trusted.anode_actuate, a),
        (trusted.snode_poll, s),
    ):
        assert call(0, node, 1, payload, 27, tight) == trusted.E_ARG
        assert call(0, node, 1, payload, 28, np.zeros(99, np.uint8)) == trusted.E_ARG
        assert call(0, node, 1, payload, -1, np.zeros(99, np.uint8)) == trusted.E_ARG
        assert call(0, node, 1, payload, 27, small[34]) == 34
    assert trusted.snode_make_auth(0, s, small[7], np.zeros(30, np.uint8)) == trusted.E_ARG
    assert trusted.snode_make_auth(0, s, small[8], small[29]) == trusted.E_ARG
    assert trusted.snode_check_auth(0, s, small[19], 1, small[8], small[8]) == trusted.E_ARG
    assert trusted.snode_check_auth(0, s, small[20], 1, small[8], small[7]) == trusted.E_ARG
    assert trusted.anode_token_request(0, a, 5000, 2, small[31]) == trusted.E_ARG
    assert trusted.anode_issue_token(0, a, 2, 5, small[20], small[8], small[20], small[7]) == trusted.E_ARG
    assert trusted.anode_check_token(0, a, 2, 1, 5, small[19], small[8]) == trusted.E_ARG
    assert trusted.anode_install_token(0, a, 6, 2, 5, small[20], small[7]) == trusted.E_ARG
    assert trusted.sha1(small[20], 21, small[20]) == trusted.E_ARG
    assert trusted.chain_extend(small[19], small[20], 20) == trusted.E_ARG
    assert trusted.lightmac(small[19], small[20], 20, small[8]) == trusted.E_ARG


def functions():
    """Return the kernels that call C, by name, with their uncompiled functions."""
    found = {name: getattr(kernel, "py_func", kernel) for name, kernel in vars(trusted).items()}
    return {name: f for name, f in found.items() if getattr(f, "__kernel_body__", None)}


def arguments_of(function, profile, shorter=""):
    """Return arguments that the C takes; the row `shorter` lacks a byte."""
    nodes = keyed(profile)
    sizes = {"data": 27, "entry": 27 + table.ENTRY_HEADER_BYTES, "nonce": 8, "auth": 30, "treq": 32, "signer": 32}
    sizes |= dict.fromkeys(("top", "hckpt", "digest", "key"), 20) | dict.fromkeys(("mac", "treq_mac"), 8)
    made = {name: np.zeros(size, np.uint8) for name, size in sizes.items()}
    which = function.__name__.partition("_")[0]
    if which in ("snode", "anode"):
        made["node"] = getattr(nodes, which)[0, : getattr(nodes._lib, f"phx_{which}_size")()]
    if shorter:
        made[shorter] = made[shorter][:-1]
    return [made.get(name, {"profile": profile, "length": 27}.get(name, 2)) for name in signature(function).parameters]


ROWS = [
    (name, row)
    for name, function in functions().items()
    for row in signature(function).parameters
    if function.__annotations__[row] == "Row"
]


@pytest.mark.parametrize("profile", [trusted.HARDENED, trusted.PAPER])
@pytest.mark.parametrize(("name", "row"), ROWS)
def test_a_row_that_lacks_a_byte_never_reaches_the_c(profile, name, row, monkeypatch):
    plain, asked = functions()[name], []
    for called in ("in_0", "in_1"):
        if called in plain.__globals__:
            monkeypatch.setitem(plain.__globals__, called, lambda *given: asked.append(given) or 0)
    plain(*arguments_of(plain, profile))
    only_elsewhere = (name in ("anode_make_auth", "snode_check_auth_a")) and profile == trusted.HARDENED
    assert len(asked) == (0 if only_elsewhere else 1)
    asked.clear()
    for function in {plain, getattr(trusted, name)}:
        assert function(*arguments_of(plain, profile, shorter=row)) == trusted.E_ARG
    assert asked == []


@pytest.mark.parametrize(("name", "row"), ROWS)
def test_a_read_only_row_is_refused_where_the_c_writes_to_it_and_only_there(name, row):
    """The prototypes in C have `const` where it does not."""
    headers = " ".join(path.read_text() for path in (ROOT / "firmware").rglob("*.h"))
    prototype = re.findall(rf"^int phx_{name}\(([^)]*)\);", headers, re.MULTILINE)[0]
    place = [each for each in signature(functions()[name]).parameters if each != "profile"].index(row)
    is_written = "const" not in prototype.split(",")[place]
    for function in (functions()[name], getattr(trusted, name)):
        arguments = arguments_of(functions()[name], trusted.PAPER)
        arguments[list(signature(functions()[name]).parameters).index(row)].flags.writeable = False
        if is_written:
            with pytest.raises(ValueError, match="read-only"):
                function(*arguments)
        else:
            assert isinstance(function(*arguments), int)


def test_a_node_of_another_sort_never_reaches_the_c():
    nodes, out = keyed(trusted.HARDENED), np.zeros(32, np.uint8)
    for rows in (np.zeros(0, np.uint8), np.zeros(5, np.uint8), nodes.snode[0]):
        before = rows.copy()
        assert trusted.anode_token_request(trusted.HARDENED, rows, 5000, 2, out) == trusted.E_ARG
        assert (rows == before).all()


@pytest.mark.parametrize("profile", [trusted.HARDENED, trusted.PAPER])
@pytest.mark.parametrize("bit", range(64))
def test_a_mac_with_one_wrong_bit_is_refused_everywhere(profile, bit):
    def wrong(mac):
        return (int.from_bytes(mac, "little") ^ 1 << bit).to_bytes(8, "little")

    def refused(action, *arguments):
        with pytest.raises(Refused) as refusal:
            action(*arguments)
        return refusal.value.reason == "bad_mac"

    nodes, hckpt = keyed(profile), bytes(20)
    request = nodes.token_request(0, 5000, 2)
    auth = nodes.make_auth(0, request[24:])
    mac = nodes.issue_token(1, 1, 5000, request[4:24], request[24:], hckpt)
    assert refused(nodes.issue_token, 1, 1, 5000, request[4:24], wrong(request[24:]), hckpt)
    assert refused(nodes.check_auth, 1, auth[:20], 1, request[24:], wrong(auth[22:]))
    assert refused(nodes.check_token, 1, 2, 1, 5000, hckpt, wrong(mac))
    assert refused(nodes.install_token, 0, 5000, 2, 5000, hckpt, wrong(mac))
    nodes.power_up(0)
    sealed = seal_mission_key(MASTER, MISSION, bytes(20), 2)
    assert refused(nodes.load_mission, 0, 0, sealed._replace(mac=wrong(sealed.mac)))


def test_authenticators_of_a_nodes_are_in_paper_only():
    hardened, paper = keyed(trusted.HARDENED), keyed(trusted.PAPER)
    with pytest.raises(Refused):
        hardened.make_auth_a(0)
    made = paper.make_auth_a(0)
    paper.check_auth_a(1, made[:20], 1, made[22:])
    with pytest.raises(Refused):
        paper.check_auth(1, made[:20], 1, bytes(8), made[22:])


def test_refusals_are_a_peers_fault():
    assert issubclass(Refused, PeerError)


CALLS = {
    "poll": lambda nodes, now, number, raw: nodes.poll(0, now, raw),
    "recv": lambda nodes, now, number, raw: nodes.recv(0, now, raw),
    "send": lambda nodes, now, number, raw: nodes.send(0, now, raw),
    "actuate": lambda nodes, now, number, raw: nodes.actuate(0, now, raw),
    "make_auth": lambda nodes, now, number, raw: nodes.make_auth(0, raw[:8]),
    "check_auth": lambda nodes, now, number, raw: nodes.check_auth(0, raw[:20], number, raw[20:28], raw[28:36]),
    "request": lambda nodes, now, number, raw: nodes.token_request(0, now, number),
    "issue": lambda nodes, now, number, raw: nodes.issue_token(0, number, now, raw[:20], raw[20:28], raw[28:48]),
    "check_token": lambda nodes, now, number, raw: nodes.check_token(0, number, 1, now, raw[:20], raw[20:28]),
    "install": lambda nodes, now, number, raw: nodes.install_token(0, now, number, now, raw[:20], raw[20:28]),
    "load": lambda nodes, now, number, raw: nodes.load_master(0, raw[:20], number),
}


@settings(max_examples=60, deadline=None)
@given(
    profile=st.sampled_from([trusted.HARDENED, trusted.PAPER]),
    calls=st.lists(
        st.tuples(
            st.sampled_from(sorted(CALLS)),
            st.integers(0, 3000),
            st.integers(0, 65_535),
            st.binary(min_size=60, max_size=300),
        ),
        max_size=25,
    ),
)
def test_nothing_a_c_node_says_touches_other_nodes_shows_a_key_or_passes_for_a_mac(profile, calls):
    nodes = keyed(profile)
    others = nodes.anode[1].copy(), nodes.snode[1].copy()
    heard, now = b"", 0
    for what, ms, number, raw in calls:
        now += ms
        try:
            heard += CALLS[what](nodes, now, number, raw) or b""
        except Refused:
            continue
        # Made-up MACs are refused, and the master key stays what it is.
        assert what not in {"check_auth", "issue", "check_token", "install", "load"}
    assert (nodes.anode[1] == others[0]).all()
    assert (nodes.snode[1] == others[1]).all()
    for key in (MASTER, MISSION):
        assert not any(key[at : at + 6] in heard for at in range(15))


def test_compiled_nodes_that_are_older_than_their_callers_are_told_and_refuse_nothing_in_silence():
    def of_tomorrow(node: trusted.Row) -> int:
        raise NotImplementedError

    with pytest.raises(Unavailable, match="no phx_of_tomorrow"):
        trusted._in_c(of_tomorrow)
