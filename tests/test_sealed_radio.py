"""The sealed radio: what its C answers, beside the oracle, and what stays between a c-node and a sealed board."""

from __future__ import annotations

import asyncio
import json
import random
from collections import deque
from dataclasses import replace
from types import SimpleNamespace

import pytest

import boards
from commands import ROOT
from oracle import nodes as oracle
from oracle.sealed import SealedANode
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, Refused, seal_mission_key
from phalanx.config import BtiConfig
from phalanx.daemon.life import Life
from phalanx.daemon.on_air import forgeries, parse_on_air
from phalanx.daemon.sealed_air import SENDERS, SealedAir, with_room_for_seals
from phalanx.daemon.trusted import NodeClock
from phalanx.errors import UsageError
from phalanx.robot.planner import ToGoal
from phalanx.robot.runtime import NEVER_MS
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import lines
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX, SEAL, STATE
from small_limits import LIMITS

(STORY,) = json.loads((ROOT / "vectors" / "sealed.json").read_text())["cases"]
ROOMY = replace(LIMITS, send_capacity_us=10**9, audit_capacity_us=10**9, t_val_ms=10_000)
MASTER, MISSION = bytes(range(20)), bytes(range(7, 27))
FFI, LIB = trusted.FIRMWARE[trusted.HARDENED]


class Robot:
    """An a-node twice: in C, and the oracle's; both have the mission's key."""

    def __init__(self, rob_id, limits=ROOMY):
        self.c, self.seals = FFI.new("phx_anode *"), FFI.new("phx_seals *")
        assert LIB.phx_anode_make(self.c, FFI.new("phx_limits *", list(vars_of(limits)))) == 0
        self.oracle = SealedANode(hardened=True, limits=limits)
        self.do("anode_load_master", "load_master", (MASTER, rob_id))
        k, r, seq, mac = seal_mission_key(MASTER, MISSION, bytes(20), 1)
        self.do("anode_load_mission", "load_mission", (0, k, r, seq, mac))

    def do(self, name, method, values):
        code = getattr(LIB, f"phx_{name}")(self.c, *values)
        try:
            getattr(self.oracle, method)(*values)
        except oracle.No as no:
            assert trusted.REASONS[code] == no.args[0].lower()

    def told(self, name, now, packet):
        out = FFI.new(f"uint8_t[{len(packet) + 21}]")
        code = getattr(LIB, f"phx_sealed_{name}")(self.seals, self.c, now, packet, len(packet), out)
        said = bytes(out)[:code] if code >= 0 else trusted.REASONS[code]
        try:
            assert said == getattr(self.oracle, f"sealed_{name}")(now, packet)
        except oracle.No as no:
            assert said == no.args[0].lower()
        return said

    def send(self, now, packet=b"\x01hello"):
        said = self.told("send", now, packet)
        return said if isinstance(said, str) else said[7:]

    def recv(self, now, sealed):
        said = self.told("recv", now, sealed)
        return said if isinstance(said, str) else "taken"


def vars_of(limits):
    return [getattr(limits, name) for name in Limits.__dataclass_fields__]


@pytest.fixture
def pair():
    return Robot(1), Robot(2)


def test_the_vectors_are_answered_in_python_too():
    nodes, limits = {}, Limits(**STORY["limits"])
    for step, call in enumerate(STORY["calls"]):
        if call["call"].startswith("snode"):
            continue
        robot = call["robot"]
        if robot not in nodes:
            nodes[robot] = FFI.new("phx_anode *"), FFI.new("phx_seals *")
            LIB.phx_anode_make(nodes[robot][0], FFI.new("phx_limits *", vars_of(limits)))
        anode, seals = nodes[robot]
        texts = [bytes.fromhex(text) for text in call["bytes"]]
        out = FFI.new("uint8_t[2100]")
        if call["call"].startswith("sealed"):
            code = getattr(LIB, f"phx_{call['call']}")(seals, anode, *call["numbers"], texts[0], len(texts[0]), out)
        elif call["call"] == "anode_load_master":
            code = LIB.phx_anode_load_master(anode, texts[0], call["numbers"][0])
        else:
            now, seq = call["numbers"]
            code = LIB.phx_anode_load_mission(anode, now, texts[0], texts[1], seq, texts[2])
        said = trusted.REASONS[code].upper() if code < 0 else "ok"
        assert (said, bytes(out)[: max(code, 0)].hex()) == (call["expect"], call["out"]), step
    assert {"ok", "REPEATED", "LATE", "BAD_MAC", "SELF", "ARG"} <= {call["expect"] for call in STORY["calls"]}


def test_a_frame_counts_once_for_others_and_never_for_its_sender(pair):
    one, two = pair
    packet = one.send(5)
    assert [two.recv(9_000_000, packet), two.recv(9_000_000, packet)] == ["taken", "repeated"]
    assert one.recv(6, packet) == "self"


def test_what_is_said_past_an_a_node_is_not_taken(pair):
    one, two = pair
    packet = one.send(5, b"\x01" + bytes(26))
    assert {two.recv(6, each) for each in forgeries(packet)} == {"bad_mac"}
    assert two.recv(6, packet[-SEAL.size :]) == "arg"
    assert two.recv(6, packet) == "taken", "and none of it counts as heard"


def test_ten_thousand_mutations_are_refused_and_leave_no_trace(pair):
    one, two = pair
    packets = [one.send(1000 + k, bytes((1, *range(k, 26 + k)))) for k in range(100)]
    chance, refused = random.Random(7), set()
    two.recv(1100, packets[0])
    before = bytes(FFI.buffer(two.seals)), bytes(FFI.buffer(two.c))
    for k in range(10_000):
        packet = bytearray(packets[k % 100])
        for _ in range(chance.randint(1, 3)):
            packet[chance.randrange(len(packet))] ^= chance.randint(1, 255)
        packet = bytes(packet)[: chance.choice((None, -1, 9, 0))] + chance.choice((b"", b"", b"x"))
        if packet not in packets:
            out = FFI.new(f"uint8_t[{len(packet) + 21}]")
            refused.add(LIB.phx_sealed_recv(two.seals, two.c, 1101, packet, len(packet), out))
    assert {trusted.REASONS[code] for code in refused} == {"bad_mac", "arg"}
    assert (bytes(FFI.buffer(two.seals)), bytes(FFI.buffer(two.c))) == before
    assert two.recv(1101, packets[50]) == "taken"


def test_frames_of_one_millisecond_have_a_time_each_and_not_too_far_ahead(pair):
    one, two = pair
    packets = [one.send(1000) for _ in range(258)]
    assert packets.pop() == "airtime"
    times = [SEAL.decode(packet[-SEAL.size :])["t"] for packet in packets]
    assert times == list(range(1000, 1257))
    assert {two.recv(1000, packet) for packet in packets} == {"taken"}
    assert one.send(1001) != "airtime"


def test_frames_overtake_each_other_by_the_window_and_no_more(pair):
    one, two = pair
    packets = {now: one.send(now) for now in (100, 101, 132, 164, 400)}
    assert [two.recv(200, packets[100]), two.recv(200, packets[164])] == ["taken"] * 2
    assert two.recv(200, packets[132]) == "taken", "what is no newer than the window is not what was heard before it"
    assert two.recv(200, packets[100]) == "repeated", "64 ms behind"
    assert [two.recv(200, packets[101]), two.recv(200, packets[101])] == ["taken", "repeated"]
    assert two.recv(500, packets[400]) == "taken"
    assert two.recv(500, packets[164]) == "repeated"


def test_what_was_heard_before_is_not_taken_for_what_came_32_ms_later(pair):
    """A shift by 32 is none on some processors: the bit of 99 would stand for 131."""
    one, two = pair
    packets = {now: one.send(now) for now in (99, 100, 131, 132)}
    assert [two.recv(132, packets[now]) for now in (99, 100, 132, 131)] == ["taken"] * 4


def test_whatever_overtakes_what_each_frame_counts_once(pair):
    one, two = pair
    chance, now, packets = random.Random(1), 1000, []
    for _ in range(150):
        now += chance.choice([1, 2, 31, 32, 33])
        packets.append(one.send(now))
        for packet in chance.choices(packets[-6:], k=2):
            two.recv(now, packet)


def test_what_is_held_back_is_refused_and_what_was_always_late_is_another_clock(pair):
    one, two = pair
    three = Robot(3)
    packets = [one.send(now) for now in (1000, 2000, 3000, 4000)]
    assert [two.recv(1000, packets[0]), two.recv(4000, packets[1]), two.recv(5003, packets[2])] == [
        "taken",
        "taken",
        "late",
    ]
    assert two.recv(5000, packets[3]) == "taken"
    # Three seconds late from the first on; then one at once, and the truth is known.
    assert [three.recv(now, each) for now, each in zip((4000, 5000, 6000), packets, strict=False)] == ["taken"] * 3
    assert three.recv(4000, packets[3]) == "taken"
    assert three.recv(8003, one.send(5000)) == "late"


@pytest.mark.parametrize("ppm", [400, -400])
def test_honest_clocks_may_drift_for_a_day(pair, ppm):
    one, two = pair
    for now in range(1000, 86_400_000, 600_000):
        assert two.recv(now + now * ppm // 1_000_000, one.send(now)) == "taken"


def test_a_full_table_gives_a_place_to_a_new_sender_when_one_spoke_long_ago():
    us, *others = (Robot(n + 1) for n in range(SENDERS + 2))
    *first, last = others
    assert us.recv(1000, first[1].send(460)) == "taken"
    assert {us.recv(1000 + k, each.send(500)) for k, each in enumerate(first)} == {"taken"}
    assert us.recv(2000, last.send(500)) == "full"
    assert us.recv(2001, first[0].send(1500)) == "taken"
    assert us.recv(11_005, last.send(550)) == "full", "one of them was silent for just t_val"
    earlier = last.send(560)
    assert us.recv(11_010, last.send(600)) == "taken"
    assert us.recv(11_010, earlier) == "taken", "what another has said in its place is not repeated"
    assert us.recv(11_010, first[0].send(11_000)) == "taken"
    assert us.recv(11_011, first[2].send(700)) == "late", "it is remembered"
    assert us.recv(11_011, first[1].send(800)) == "taken", "forgotten, and another clock now"


def test_a_frame_leaves_room_for_its_seal(pair):
    one, two = pair
    assert one.send(1, b"\x01" * (PACKET_MAX - SEAL.size + 1)) == "too_long"
    longest = one.send(1, b"\x01" * (PACKET_MAX - SEAL.size))
    assert (len(longest), two.recv(1, longest)) == (PACKET_MAX, "taken")
    assert one.send(2**32 - 1) == "clock"
    assert one.send(2, longest) == "safe_mode", "before its length is looked at"


def test_a_seal_of_nobody_is_none_and_takes_no_place(pair):
    one, two = pair
    assert two.recv(1, b"\x01" + one.oracle.seal(1, 0, b"\x01")) == "arg"


def test_a_board_is_sealed_when_it_is_made_and_stays_so(tmp_path):
    said = []

    class Radio:
        def __init__(self):
            self.refused, self.came = {"foreign": 2}, deque()

        def send(self, packet):
            said.append(packet)

        def take(self):
            return self.came.popleft() if self.came else b""

    boards_ = [boards.process(tmp_path / str(n), "told") for n in (1, 2)]
    for n, board in enumerate(boards_, 1):
        board.make(ROOMY, sealed=True)
        board.load_master(MASTER, n)
        with pytest.raises(Refused, match="seq"):
            board.make(ROOMY)
        assert board.ask(lines.SEAL)[0] == boards.CODES["SEQ"]
        board.close()
    boards_ = [boards.process(tmp_path / str(n), "told") for n in (1, 2)]
    airs = []
    for board in boards_:
        assert board.about.sealed
        board.load_mission(0, seal_mission_key(MASTER, MISSION, bytes(20), 1))
        airs.append((SealedAir(board, radio := Radio()), radio))
    (one, _), (two, radio) = airs
    packets = [b"\x01" + bytes([k]) * 26 for k in range(3)]
    for k, packet in enumerate(packets):
        code, entry = one.ask(lines.SEND, 100 + k, packet=packet)
        assert (code, entry[7:]) == (len(entry), packet)
    one.send(packets[0])
    one.send(packets[2])  # what was never let out has no seal that another could take
    assert [len(each) for each in said] == [27 + SEAL.size] * 2
    for each in (*said, said[0], b"\x01bare", said[0][: -SEAL.size] + said[1][-SEAL.size :]):
        radio.came.append(each)
    codes = [two.ask(lines.RECV, 200, packet=packet)[0] for packet in iter(two.take, b"")]
    assert codes == [34, 34, boards.CODES["REPEATED"], boards.CODES["BAD_MAC"]]
    assert two.ask(lines.RECV, 200, packet=packets[1])[0] == boards.CODES["BAD_MAC"], "nobody said it"
    assert two.refused == {"foreign": 2, "short": 1, "repeated": 1, "bad_mac": 2}
    for board in boards_:
        board.close()


def test_a_mission_with_more_neighbours_than_are_remembered_is_refused_and_frames_are_shorter():
    scenario = Scenario()
    assert with_room_for_seals(scenario).bti.packet_max_bytes == PACKET_MAX - SEAL.size
    with pytest.raises(UsageError, match="n_max"):
        with_room_for_seals(replace(scenario, n_max=SENDERS + 1))
    driven = replace(scenario, controller="wheels", robots=4, grid_step_m=0.5)
    assert with_room_for_seals(replace(driven, n_max=SENDERS - 1)).n_max == SENDERS - 1
    with pytest.raises(UsageError, match="n_max is 64"):  # the gateway seals too
        with_room_for_seals(replace(driven, n_max=SENDERS))


@pytest.mark.parametrize(
    "words", ["", "nothing", "past:robot=0", "past:robot=x", "hold:robot=5", "hold:at=-1", "hold:for=3"]
)
def test_an_attack_on_the_air_that_is_none_is_said(words):
    with pytest.raises(UsageError, match="on-air"):
        parse_on_air(words, 4)


def test_a_planner_hears_no_frame_that_its_a_node_refused():
    heard, codes = [], {1: 34, 2: boards.CODES["BAD_MAC"]}

    class Listens(ToGoal):
        def hear(self, _t_s, rob_id, *_where):
            heard.append(rob_id)

    class Nodes:
        def ask(self, call, _now_ms=None, **arguments):
            if call is not lines.RECV:
                return len(arguments.get("packet", b"")), entry(arguments.get("packet", b""))
            code = codes[STATE.decode(arguments["packet"])["id"]]
            return code, entry(arguments["packet"]) if code > 0 else b""

    def entry(packet):
        return bytes(ENTRY_HEADER_BYTES) + packet

    mission = Scenario(robots=4, controller="guard", bti=BtiConfig(f_max=1))
    came = deque(STATE.encode(id=rob_id, t=1, x_m=0.0, y_m=0.0, vx_mps=0.0, vy_mps=0.0) for rob_id in (2, 1, 2))
    radio = SimpleNamespace(take=lambda: came.popleft() if came else b"")
    life = Life(mission, 3, NodeClock(Nodes()), None, radio, Listens)
    life.begin()
    life.runtime.check_ms = life.runtime.wake_ms = NEVER_MS
    life.runtime._audits = [(NEVER_MS, False, False)]
    life.runtime._step = 1 << 20  # no reading is due
    while came:
        asyncio.run(life._turn())
    assert heard == [1]
