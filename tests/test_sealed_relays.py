"""Relayed HELLOs on sealed radios: real a-nodes accept them within 2 s, and robots ask the distant robots not for long."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from dataclasses import astuple

import pytest

from phalanx.bti import elsewhere, request, trusted
from phalanx.bti.fleet import HARDENED, make_fleet
from phalanx.bti.nodes import limits_of, seal_mission_key
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.daemon.sealed_air import SealedAir, with_room_for_seals
from phalanx.robot.actions import EVERYBODY, Transmit
from phalanx.robot.robot import Robot
from phalanx.robot.runtime import NEVER_MS, Runtime
from phalanx.scenarios.behaviour import number_of, params_of
from phalanx.scenarios.scenario import Scenario
from phalanx.wire import lines
from phalanx.wire.fields import get_u16, row
from phalanx.wire.table import AUDIT_HELLO, AUDIT_HERE, ENTRY_HEADER_BYTES, PACKET_MAX, SEAL, SENSOR

FFI, LIB = trusted.FIRMWARE[HARDENED]
MASTER, MISSION = bytes(range(20)), bytes(range(7, 27))
KERNELS = {call: kernel.__name__ for kernel, call in elsewhere.FUNCTIONS.items()}
SEALED = {lines.SEND: LIB.phx_sealed_send, lines.RECV: LIB.phx_sealed_recv}
AIR_MS = 1


def is_hello(sealed):
    packet = sealed[: -SEAL.size]
    return len(packet) == AUDIT_HELLO.size and request.is_audit(row(packet), len(packet))


class SealedNodes:
    """The two trusted nodes of a robot, in C, its radio sealed: an `RemoteNodes` in this process."""

    def __init__(self, rob_id, limits, now_ms):
        self.snode, self.anode, self.seals = (FFI.new(f"phx_{each} *") for each in ("snode", "anode", "seals"))
        made, key = FFI.new("phx_limits *", astuple(limits)), seal_mission_key(MASTER, MISSION, bytes(20), 1)
        assert LIB.phx_snode_make(self.snode, made) == LIB.phx_anode_make(self.anode, made) == 0
        assert LIB.phx_sealed_make(self.anode) == 0
        for name in ("snode", "anode"):
            node = getattr(self, name)
            assert getattr(LIB, f"phx_{name}_load_master")(node, MASTER, rob_id) == 0
            assert getattr(LIB, f"phx_{name}_load_mission")(node, now_ms, key.k, key.r, key.seq, key.mac) == 0

    def ask(self, call, now_ms=None, **arguments):
        values = [*([] if now_ms is None else [now_ms]), *arguments.values()]
        out = FFI.new("uint8_t[]", PACKET_MAX + 64)
        if call in elsewhere.FORWARDED:
            values += [len(values[-1]), out]
        elif call in elsewhere.MADE:
            values.append(out)
        node = getattr(self, KERNELS[call].partition("_")[0])
        if call in SEALED:
            code = SEALED[call](self.seals, node, *values)
        else:
            code = getattr(LIB, f"phx_{KERNELS[call]}")(node, *values)
        size = 0 if code < 0 else code if call in elsewhere.FORWARDED else elsewhere.MADE.get(call, 0)
        return code, bytes(FFI.buffer(out, size))


class Member:
    """A robot that stands still, with everything that a daemon gives it but the driver."""

    def __init__(self, scenario, rob_id, now_ms):
        self.id, self.scenario, self.clock_ms = rob_id, scenario, now_ms
        self.sent, self.waiting, self.refused = [], deque(), {}
        self.nodes = SealedNodes(rob_id, limits_of(scenario.bti, scenario.radio), now_ms)
        self.air = SealedAir(self.nodes, self)
        self.rows = elsewhere.register_remote([self.air])
        self.fleet = make_fleet(
            1,
            scenario.bti,
            params_of(scenario),
            profile=HARDENED,
            controller=number_of(scenario, None),
            mission_seed=scenario.seed,
            snode=self.rows,
            anode=self.rows,
        )
        self.fleet.robot["id"] = rob_id
        self.runtime = Runtime(Robot(self.fleet, 0, make_work(scenario.bti)), scenario.bti, now_ms)
        self.asked = []

    # A Radio, of sealed packets.

    def send(self, sealed):
        self.sent.append(sealed)

    def take(self):
        return self.waiting.popleft() if self.waiting else b""

    # What happens to it; times are of the world.

    @property
    def due_ms(self):
        return NEVER_MS if self.runtime.in_safe_mode else self.runtime.due_ms - self.clock_ms

    def lives(self, world_ms):
        """Handle one due event; return packets that go out, each with its receiver."""
        now_ms, runtime = world_ms + self.clock_ms, self.runtime
        if runtime.input_ms <= now_ms:
            reading = SENSOR.encode(id=self.id, t=now_ms, x_m=3.0 * self.id, y_m=0.0, vx_mps=0.0, vy_mps=0.0)
            return self.performs(now_ms, runtime.on_reading(now_ms, reading))
        if runtime.check_ms <= now_ms:
            runtime.on_check(now_ms)
            return []
        return self.performs(now_ms, runtime.on_audit(now_ms))

    def hears(self, world_ms, sealed):
        """Receive a packet, through its a-node if the seal is good."""
        self.waiting.append(sealed)
        now_ms, packet = world_ms + self.clock_ms, self.air.take()
        return self.performs(now_ms, self.runtime.on_packet(now_ms, packet))

    def performs(self, now_ms, actions):
        out, waiting = [], deque(actions)
        while waiting:
            done = waiting.popleft()
            if not isinstance(done, Transmit):
                continue
            self.air.send(done.packet)
            out.append((self.sent.pop(), done.to))
            if request.is_fragment(row(done.packet), len(done.packet)):
                self.asked.append((now_ms - self.clock_ms, get_u16(row(done.packet), request.AT_DST)))
                waiting.extend(self.runtime.on_sent(now_ms, arrived=True))  # as in a daemon: nothing acknowledges
        return out

    def close(self):
        elsewhere.unregister_remote(self.rows)


class Swarm:
    """Robots at two places out of each other's range; liars relay HELLOs to the first of them, byte for byte.

    A liar is the last robot at each place. Otherwise it follows the protocol: its own radio is all that it has altered.
    """

    def __init__(self, f_max, far, n_max, relay_ms):
        near = f_max + 3 + 1
        made = Scenario(robots=near + far + 1, seed=3, bti=BtiConfig(f_max=f_max), n_max=n_max)
        self.scenario = with_room_for_seals(made)
        self.members = [Member(self.scenario, k, 1000 + 377 * k) for k in range(1, near + far + 2)]
        self.near, self.far = self.members[:near], self.members[near:]
        self.relay_ms = relay_ms
        self.events, self.order = [], itertools.count()

    def runs(self, seconds):
        """Advance; robots next to each other hear each other a millisecond later."""
        for member in self.members:
            self._at(member.due_ms, member, b"")
        end_ms = round(1000 * seconds)
        while self.events and self.events[0][0] <= end_ms:
            now_ms, _, member, sealed = heapq.heappop(self.events)
            if member.runtime.in_safe_mode:
                continue
            if sealed:
                out = member.hears(now_ms, sealed)
            elif member.due_ms > now_ms:
                continue
            else:
                out = member.lives(now_ms)
            for packet, to in out:
                self._goes_out(now_ms, member, packet, to)
            self._at(member.due_ms, member, b"")
        elsewhere.raise_failed()

    def _at(self, at_ms, member, sealed):
        if at_ms < NEVER_MS:
            heapq.heappush(self.events, (at_ms, next(self.order), member, sealed))

    def _goes_out(self, now_ms, sender, sealed, to):
        place = self.near if sender in self.near else self.far
        for member in place:
            if member is not sender and to in (EVERYBODY, member.id):
                self._at(now_ms + AIR_MS, member, sealed)
        if place is self.far and is_hello(sealed):
            for member in self.near:
                self._at(now_ms + self.relay_ms, member, sealed)


@pytest.fixture
def made():
    """What tests make, for `close`."""
    members = []
    yield members
    for member in members:
        member.close()


def a_sealed(nodes, now_ms, packet):
    """Return a packet as its sender's a-node seals it."""
    code, entry = nodes.ask(lines.SEND, now_ms, packet=packet)
    assert code == len(entry)
    return entry[ENTRY_HEADER_BYTES:]


def test_a_hello_in_anothers_name_is_heard_unless_the_radio_is_sealed():
    """Why P2 needs sealed radios wherever a radio hangs on the main computer."""
    limits = limits_of(BtiConfig(f_max=1), Scenario().radio)
    near, liar = SealedNodes(2, limits, 0), SealedNodes(3, limits, 0)
    forged = AUDIT_HELLO.encode(src=1, dst=0)
    out = FFI.new("uint8_t[]", 64)
    assert LIB.phx_anode_recv(near.anode, 5, forged, len(forged), out) == ENTRY_HEADER_BYTES + len(forged)
    sealed = a_sealed(liar, 5, forged)
    assert sealed[: -SEAL.size] == AUDIT_HELLO.encode(src=3, dst=0), "an a-node names its own robot"
    assert trusted.REASONS[near.ask(lines.RECV, 5, packet=forged + sealed[-SEAL.size :])[0]] == "bad_mac"


@pytest.mark.parametrize("late_ms, reason", [(0, ""), (2002, ""), (2003, "late")])
def test_a_seal_accepts_a_hello_that_was_relayed_within_two_seconds(late_ms, reason):
    """The two milliseconds are what clocks may have drifted since the first HELLO."""
    limits = limits_of(BtiConfig(f_max=1), Scenario().radio)
    far, near = SealedNodes(1, limits, 0), SealedNodes(2, limits, 0)
    hello = AUDIT_HELLO.encode(src=1, dst=0)
    assert near.ask(lines.RECV, 100, packet=a_sealed(far, 100, hello))[0] > 0, "heard itself, so no slow clock"
    code, entry = near.ask(lines.RECV, 4100 + late_ms, packet=a_sealed(far, 4100, hello))
    assert (trusted.REASONS.get(code, ""), entry[ENTRY_HEADER_BYTES:]) == (reason, b"" if reason else hello)


def test_a_robot_that_seeks_asks_distant_robots_only_after_a_here_with_its_own_nonce(made):
    scenario = with_room_for_seals(Scenario(robots=24, n_max=24, bti=BtiConfig(f_max=1)))
    made.append(victim := Member(scenario, 1, 0))
    limits = limits_of(scenario.bti, scenario.radio)
    far = [SealedNodes(rob_id, limits, 0) for rob_id in range(2, 24)]
    robot, now_ms = victim.fleet.robot, 100

    def hears(k, packet):
        """Receive a packet 1.9 s after its sender sealed it; return how many requests the victim has begun then."""
        nonlocal now_ms
        now_ms, before = now_ms + 20, len(victim.asked)
        victim.hears(now_ms, a_sealed(far[k], now_ms - 1900 if now_ms > 1900 else 0, packet))
        for ms in range(now_ms, now_ms + 20):
            while victim.due_ms <= ms:
                victim.lives(ms)
        return len(victim.asked) - before

    for k in range(22):
        hears(k, AUDIT_HELLO.encode(src=k + 2, dst=0))
    while not robot[0].seeks:
        hears(0, AUDIT_HELLO.encode(src=2, dst=0))
    assert victim.asked, "before it seeks, it believes what it hears"
    victim.asked.clear()
    nonce, round_no = int(robot[0].nonce), int(robot[0].round_no)
    for k in range(22):
        assert hears(k, AUDIT_HELLO.encode(src=k + 2, dst=0)) == 0
        assert hears(k, AUDIT_HERE.encode(src=k + 2, dst=1, nonce=nonce ^ 1 << k)) == 0
    assert (int(robot[0].round_no), int(robot[0].peers)) == (round_no, 22)
    assert victim.air.refused == {}, "its a-node accepted every packet"
    # It asks nobody for 50 ms after each SEEK.
    assert (
        hears(7, AUDIT_HERE.encode(src=9, dst=1, nonce=nonce))
        + sum(hears(0, AUDIT_HELLO.encode(src=2, dst=0)) for _ in range(3))
        == 1
    )
    assert victim.asked[-1][1] == 9


@pytest.mark.parametrize("f_max, far, n_max", [(1, 20, 40), (2, 24, 8)])
def test_real_nodes_next_to_a_relay_of_distant_hellos_live_on(f_max, far, n_max, made):
    """Lists of neighbours with room for all, and with room for real neighbours only."""
    swarm = Swarm(f_max, far, n_max, relay_ms=1900)
    made += swarm.members
    swarm.runs(3.2 * swarm.scenario.bti.t_val_ms / 1000)
    names = {member.id for member in swarm.far}
    for member in swarm.near:
        assert not member.runtime.in_safe_mode
        assert not member.air.refused
    vain = sum(to in names for member in swarm.near for _, to in member.asked)
    assert vain > len(swarm.near), "they were asked at first"
    assert int(swarm.near[0].fleet.robot[0].peers) == min(n_max, len(swarm.near) - 1 + far + 1)
