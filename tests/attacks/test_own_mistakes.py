"""What a researcher's controller gets wrong is told in one line, not found out from robots that stand still."""

from __future__ import annotations

import random

import pytest
from trials import scenario

from phalanx.bti.refusal import Refusal
from phalanx.errors import UsageError
from phalanx.robot.controllers.python_controller import Act, Controller, Send
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import ACCELERATION, STATE
from phalanx.world.scenarios.run import Run

STAND = ACCELERATION.encode(id=1, t=0, ax_mps2=0.0, ay_mps2=0.0)


def controller(outputs, state=b""):
    class Own(Controller):
        """Puts out the same at each reading."""

        def encode(self):
            return state

        def decode(self, encoding):
            assert encoding == state

        def on_recv(self, t_ms, packet):
            pass

        def on_input(self, step, t_ms, reading):
            return outputs

    return Own


def advanced(made, defence="hardened"):
    run = Run(scenario(defence, robots=6, end_s=12), made)
    run.advance(12.0)
    return run


@pytest.mark.parametrize(
    "outputs, complaint",
    [
        (None, "on_input returned None"),
        ("act", "on_input returned str"),
        (STAND, "on_input returned bytes"),
        (Act(STAND), "on_input returned Act"),
        ([STAND], "on_input put out bytes"),
        (["act"], "on_input put out str"),
        ([Act("stand")], "on_input put out Act of str"),
        ([Send(None)], "on_input put out Send of None"),
        ([Act(b"")], "Act of bytes, 0 long"),
        ([Send(b"")], "Send of bytes, 0 long"),
        ([Send(bytes(2049))], "Send of bytes, 2049 long"),
        ([Send(b"\x80 hello")], "like one of the audits"),
        ([Act(STAND[:-1])], "not a command of its body: 18 bytes, the first 3"),
        ([Act(STATE.encode(id=1, t=0, x_m=0, y_m=0, vx_mps=0, vy_mps=0))], "not a command of its body: 27 bytes"),
        ([Act(bytes(19))], "not a command of its body: 19 bytes, the first 0"),
    ],
)
@pytest.mark.parametrize("defence", ["none", "hardened"])
def test_what_cannot_be_put_out_is_refused_at_the_first_reading(outputs, complaint, defence):
    with pytest.raises(UsageError) as refused:
        advanced(controller(outputs), defence)
    assert complaint in str(refused.value)
    assert refused.value.hint


@pytest.mark.parametrize(("state", "complaint"), [("text", "encode returned str"), (bytes(5000), "5000 bytes")])
def test_a_checkpoint_that_is_none_or_too_long_is_refused(state, complaint):
    with pytest.raises(UsageError, match=complaint):
        advanced(controller([Act(STAND)], state))


@pytest.mark.parametrize("packet", [bytes([1]) * 1000, bytes([1]) * 27], ids=["too long", "too often"])
def test_a_frame_for_which_the_a_node_has_no_airtime_is_told(packet):
    with pytest.raises(UsageError, match=f"no airtime left for a packet of {len(packet)} bytes"):
        advanced(controller([Act(STAND), Send(packet)]))


def test_a_liar_s_controller_is_looked_at_like_the_others():
    liars = tuple(AttackSpec(name="hijack", robot=k, at_s=5.0) for k in (1, 2))
    with pytest.raises(UsageError, match="on_input returned None"):
        Run(scenario("none", *liars, robots=2, end_s=12), controller(None)).advance(1.0)


def test_what_is_well_formed_is_neither_refused_nor_stopped():
    ended = advanced(controller(iter([Act(STAND)])), "none")
    assert not ended.in_safe_mode.any()
    ended = advanced(controller((Act(STAND),), bytes(500)))
    assert not ended.in_safe_mode.any()
    assert {why for *_, why in ended.new_verdicts()} == {0}


class Counting(controller([])):
    """Remembers what `encode` leaves out: how often it was called."""

    calls = 0

    def on_input(self, step, t_ms, reading):
        self.calls += 1
        return [Act(ACCELERATION.encode(id=self.rob_id, t=t_ms, ax_mps2=self.calls / 1000, ay_mps2=0.0))]


class Drawing(controller([])):
    """Never gives the same checkpoint twice."""

    def encode(self):
        return random.randbytes(4)

    def decode(self, encoding):
        pass


class Forgetful(controller([], b"state")):
    """Does not know its own checkpoints."""

    def decode(self, encoding):
        raise ValueError(encoding)


class Suspicious(controller([], b"state")):
    """Refuses its own checkpoints."""

    def decode(self, encoding):
        raise MalformedRecord(encoding)


@pytest.mark.parametrize(
    "made, reason",
    [
        (Counting, Refusal.OUTPUT_WRONG),
        (Drawing, Refusal.CHECKPOINT_WRONG),
        (Forgetful, Refusal.CONTROLLER_FAILED),
        (Suspicious, Refusal.STATE_MALFORMED),
    ],
)
def test_what_only_shows_under_audit_has_its_reason(made, reason):
    """As docs/guides/own-controller.md says; the first segment, from boot on, may pass."""
    ended = Run(scenario("hardened", robots=6, end_s=20), made)
    ended.advance(20.0)
    assert {why for *_, why in ended.new_verdicts()} - {Refusal.NONE} == {reason}
    assert ended.in_safe_mode.all()


def test_a_long_memory_says_how_long_and_is_audited():
    long = controller([], bytes(1500))
    with pytest.raises(UsageError, match="encode returned 1500 bytes") as caught:
        advanced(long)
    assert caught.value.hint.endswith("or set state_bytes = 1500 in its class")
    long.state_bytes = 1500
    ended = advanced(long)
    assert {why for *_, why in ended.new_verdicts()} == {Refusal.NONE}
    assert not ended.in_safe_mode.any()
