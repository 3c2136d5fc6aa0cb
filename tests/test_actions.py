"""The buffer of a robot's actions: what is put in comes out, and whoever carries it out says when it has no room."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.bti import request, rounds
from phalanx.bti.audit import ACMD, SEND
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig
from phalanx.pool import NO_ROW
from phalanx.robot import actions, handlers
from phalanx.robot.actions import EVERYBODY, Action, Actuate, RetryAt, RoundAt, Transmit, Verdict
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import row
from phalanx.wire.table import OUTPUT, PACKET_MAX
from phalanx.world.audited import loop, pybot
from phalanx.world.audited.world import World, clock_ms
from phalanx.world.radio.channel import BROADCAST
from phalanx.world.scenarios.run import Run

ME = 2
ids, moments = st.integers(1, 0xFFFF), st.integers(0, 1 << 40)
packets = st.binary(min_size=1, max_size=PACKET_MAX)
each_action = st.one_of(
    st.builds(Transmit, packets, ids | st.just(EVERYBODY)),
    st.builds(Actuate, packets),
    st.builds(RetryAt, moments),
    st.builds(RoundAt, moments, st.booleans()),
    st.builds(Verdict, ids, st.sampled_from(Refusal)),
)
WORK = make_work(BtiConfig())


def append(action: Action) -> None:
    match action:
        case Transmit(packet, to):
            actions.carry(WORK, actions.TRANSMIT, to, row(b"xy" + packet + b"z"), 2, len(packet))
        case Actuate(command):
            actions.carry(WORK, actions.ACTUATE, 0, row(b"x" + command + b"yz"), 1, len(command))
        case RetryAt(at_ms):
            actions.append(WORK, actions.RETRY_AT, at_ms, 0)
        case RoundAt(at_ms, listened):
            actions.append(WORK, actions.ROUND_AT, at_ms, int(listened))
        case Verdict(auditee, refusal):
            actions.append(WORK, actions.VERDICT, auditee, int(refusal))


@given(each_action, each_action)
def test_an_encoded_action_decodes_to_itself_whatever_was_in_the_buffer(before, action):
    actions.encode(WORK, before)
    actions.encode(WORK, action)
    assert actions.decode(WORK) == [action]


@given(st.lists(each_action, max_size=4))
def test_actions_come_out_as_and_in_the_order_they_went_in(asked):
    actions.clear(WORK)
    assert actions.decode(WORK) == []
    for action in asked:
        append(action)
    assert actions.decode(WORK) == asked


@pytest.fixture
def swarm() -> World:
    run = Run(Scenario(robots=6, grid_step_m=16.0, duration_s=16.0, bti=BtiConfig(f_max=1), defence="none"))
    return run.world


@pytest.mark.parametrize(("kind", "of"), [(ACMD, Actuate), (SEND, Transmit)])
@pytest.mark.parametrize("size", [1, 20, PACKET_MAX])
def test_whatever_a_controller_puts_out_in_one_step_fits_into_the_buffer(swarm, kind, of, size):
    w = swarm.work
    one = OUTPUT.encode(type=kind, payload=bytes([1]) * size)
    count = len(w.out) // len(one)
    assert len(one) == OUTPUT.size + size
    w.out[: count * len(one)] = row(one * count)
    actions.clear(w)
    handlers.send_output(swarm.fleet, ME, w, 5000, count * len(one))
    decoded = actions.decode(w)
    assert len(decoded) == count > 0
    assert set(map(type, decoded)) == {of}


class Asking:
    """A robot with a fragment of a request in `work.packet`, of which nothing has gone out."""

    def __init__(self) -> None:
        self.run = Run(Scenario(robots=6, grid_step_m=16.0, duration_s=16.0, bti=BtiConfig(f_max=1)))
        self.run.advance(7.5)  # the a-node makes a token request again
        self.world = self.run.world
        self.fleet, self.work, self.robot = self.world.fleet, self.world.work, self.world.fleet.robot[ME]
        rounds.withdraw(self.fleet, ME)
        self.now_ms = int(clock_ms(self.world, ME))
        rounds.begin_round(self.fleet, ME, self.now_ms)
        self.length = int(handlers.next_fragment(self.fleet, ME, self.work, self.now_ms))
        self.fragment = self.work.packet[: self.length].tobytes()
        assert request.is_fragment(row(self.fragment), self.length)
        assert self.is_under_way

    @property
    def is_under_way(self) -> bool:
        return self.robot.request_len > 0 and self.robot.request_row != NO_ROW

    def fill_radio(self) -> None:
        hello = row(bytes(request.AUDIT_HEAD_BYTES))
        request.audit_head(hello, ME + 1, 0, request.HELLO)
        while loop.transmit(self.world, ME, hello, len(hello), BROADCAST) == 0:
            pass

    def retry(self, after_ms: int) -> None:
        handlers.on_retry(self.fleet, ME, self.work, self.now_ms + after_ms, 0)

    def sent(self) -> list[bytes]:
        return [action.packet for action in actions.decode(self.work) if isinstance(action, Transmit)]

    def carry_out(self, *asked: Action) -> None:
        pybot.perform(self.world, ME, self.now_ms, list(asked))


@pytest.fixture
def asking():
    return Asking()


def test_a_request_stays_while_its_fragments_have_room_in_the_radio(asking):
    asking.carry_out(Transmit(asking.fragment, int(asking.robot.request_to)))
    assert asking.is_under_way


def test_a_fragment_for_which_the_radio_has_no_room_is_sent_after_a_32nd_of_a_round(asking):
    free = int(asking.fleet.request.left[0])
    asking.fill_radio()
    asking.world.retry_us[ME] = -1
    asking.carry_out(Transmit(asking.fragment, int(asking.robot.request_to)))
    assert asking.is_under_way
    assert asking.fleet.request.left[0] == free
    assert asking.world.retry_us[ME] == asking.world.clock[0].now_us + 125_000
    asking.retry(124)
    assert asking.sent() == []
    asking.retry(125)
    assert asking.sent() == [asking.fragment]


def test_no_room_for_anything_else_withdraws_nothing(asking):
    asking.fill_radio()
    hello = row(bytes(request.AUDIT_HEAD_BYTES))
    request.audit_head(hello, ME + 1, 0, request.HELLO)
    asking.carry_out(Transmit(hello.tobytes(), EVERYBODY), Transmit(b"\x01" * 30, EVERYBODY))
    assert asking.is_under_way


def test_a_fragment_that_the_a_node_does_not_let_out_is_sent_after_a_32nd_of_a_round(asking):
    again = row(asking.fragment)
    while handlers.take(asking.fleet, ME, asking.work, SEND, asking.now_ms, again, len(again)) > 0:
        pass
    actions.clear(asking.work)
    handlers.ask_with(asking.fleet, ME, asking.work, asking.now_ms, asking.length)
    assert actions.decode(asking.work) == [RetryAt(asking.now_ms + 125)]
    assert asking.is_under_way
    asking.retry(125)
    assert asking.sent() == [asking.fragment], "its bucket has filled a little"
