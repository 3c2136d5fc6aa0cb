"""The controller of robots that visitors drive: what orders do, its bytes, and its replay."""

from __future__ import annotations

import hashlib
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commands import uncompiled
from ordered import (
    LONG_MS,
    MISSION,
    PUBLIC,
    command,
    led_order,
    order,
    reading,
    robot,
    route_order,
    signed,
    signer,
    wheels,
    wheels_order,
)
from phalanx.config.flock import WheelsConfig
from phalanx.errors import PeerError, UsageError
from phalanx.robot.controllers.orders import NEVER
from phalanx.robot.controllers.python_controller import Act, Send, pack_outputs, unpack_outputs
from phalanx.robot.follow import wheels_towards
from phalanx.wire.driven import GATEWAY, OPERATOR, TELL_NOTHING, TELL_ROUTE, TELL_WHEELS, WHEELS_MEMORY
from replays import is_taken_whole_or_refused, play

# Of `run_digest`. Another value on another machine means that honest robots would be convicted there.
RUN_SHA256 = "661c3c3c34e3c56a84c63e17a0f0962c794bf3f8812a05ebf8e683443b0335ef"
STANDS_BYTES = WHEELS_MEMORY.size
AT = WHEELS_MEMORY.at


class TestOrders:
    def test_a_joysticks_word_is_good_for_300_ms(self):
        this = robot()
        assert wheels(this, 900) == (0, 0)
        this.on_recv(1000, wheels_order(1, 1, 60, -40))
        assert [wheels(this, t) for t in (990, 1000, 1300, 1301)] == [(60, -40), (60, -40), (60, -40), (0, 0)]

    def test_more_than_all_is_all(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 1, 127, -128))
        assert wheels(this, 0) == (100, -100)

    def test_each_obeys_only_what_is_for_it_and_newer_than_the_last(self):
        this = robot(7)
        for frame in (
            wheels_order(8, 5, 1, 1),
            wheels_order(7, 5, 50, 50),
            wheels_order(7, 5, 2, 2),
            wheels_order(7, 4, 3, 3),
        ):
            this.on_recv(0, frame)
        assert wheels(this, 0) == (50, 50)
        this.on_recv(0, wheels_order(7, 2**63 - 1, 4, 4, said=9 * LONG_MS))
        assert wheels(this, 0) == (4, 4)

    def test_the_led_shows_what_was_ordered_and_the_wheels_go_on(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 1, 9, 9))
        this.on_recv(0, led_order(1, 2, 1, 128, 255))
        assert command(this.on_input(0, 5, reading(1, 0, 0, 0))) == (9, 9, (1, 128, 255))

    def test_a_route_is_followed_point_by_point_past_300_ms_and_then_the_robot_stands(self):
        this = robot()
        this.on_recv(0, wheels_order(1, 1, -50, -50))
        this.on_recv(0, route_order(1, 2, 60, [(500, 900), (900, 900)]))
        assert wheels(this, 9000, 500, 500, 0) == (100, 100)
        assert wheels(this, 9001, 500, 900, -90) == (100, 100)
        assert wheels(this, 9002, 841, 900, -90) == (0, 0)
        assert wheels(this, 9003, 500, 500, 0) == (0, 0)

    def test_points_that_are_reached_at_once_are_passed_over(self):
        this = robot()
        this.on_recv(0, route_order(1, 1, 60, [(500, 500), (510, 500), (500, 900)]))
        assert wheels(this, 0, 500, 500, 0) == (100, 100)
        assert struct.unpack_from("<HB2H", this.encode(), AT("threshold_mm")) == (60, 1, 500, 900)

    @pytest.mark.parametrize("stop", [route_order(1, 9, 60, []), wheels_order(1, 9, 0, 0)])
    def test_an_empty_route_or_a_joystick_ends_a_route(self, stop):
        this = robot()
        this.on_recv(0, route_order(1, 1, 60, [(500, 900)]))
        this.on_recv(0, stop)
        assert wheels(this, 0) == (0, 0)
        assert len(this.encode()) == STANDS_BYTES

    @pytest.mark.parametrize(
        "order",
        [
            wheels_order(1, 1, 5, 5)[:-1],
            wheels_order(1, 1, 5, 5) + b"\0",
            signed(wheels_order(1, 1, 5, 5)[:-65]),
            signed(wheels_order(1, 1, 5, 5)[:-64] + b"\0"),
            signed(led_order(1, 1, 1, 1, 1)[:-65]),
            signed(b"\x07" + wheels_order(1, 1, 5, 5)[1:-64]),
            order(1, 1, 6, b"\5\5"),
            order(1, 0, TELL_WHEELS, b"\5\5", said=5),
            order(1, 1, TELL_WHEELS, b"\5\5", who=2, key=GATEWAY),
            order(1, 1, TELL_NOTHING, b"\0"),
            *(
                order(1, 1, TELL_ROUTE, body)
                for body in (
                    struct.pack("<HB", 0, 0),
                    struct.pack("<HB", 1001, 0),
                    struct.pack("<HB", 60, 1),
                    struct.pack("<H", 60),
                    struct.pack("<HB", 60, 33) + bytes(33 * 4),
                )
            ),
            order(1, 1, TELL_WHEELS),
            b"",
        ],
    )
    def test_an_order_that_makes_no_sense_is_ignored(self, order):
        this = robot()
        this.on_recv(3, order)
        assert this.encode() == robot().encode()

    @pytest.mark.parametrize(
        "make",
        [
            lambda: signer().wheels(-1, 0, 0, 0),
            lambda: signer().wheels(65536, 0, 0, 0),
            lambda: signer().wheels(1, 2**64, 0, 0),
            lambda: signer().wheels(1, 0, 128, 0),
            lambda: signer().led(1, 0, 256, 0, 0),
            lambda: signer().route(1, 0, 60, [(0, 0)] * 33),
            lambda: signer().route(1, 0, 0, []),
            lambda: signer().route(1, 0, 60, [(-1, 0)]),
            lambda: signer(mission=2**32).beacon(0),
            lambda: WheelsConfig(good_ms=0),
            lambda: WheelsConfig(mission=0),
            lambda: WheelsConfig(operator_key=bytes(31)),
            lambda: robot(0),
        ],
    )
    def test_what_no_robot_would_obey_is_not_said(self, make):
        with pytest.raises(UsageError):
            make()

    @given(
        st.floats(0, 2000, width=32),
        st.floats(0, 2000, width=32),
        st.floats(-1000, 1000, width=32),
        st.integers(0, 2000),
        st.integers(0, 2000),
    )
    @settings(deadline=None)
    def test_a_route_is_steered_like_the_simulated_swarms(self, x, y, direction, goal_x, goal_y):
        this = robot()
        this.on_recv(0, route_order(1, 1, 1, [(goal_x, goal_y)]))
        left, right = wheels(this, 0, x, y, direction)
        dx, dy = goal_x - x, goal_y - y
        if math.hypot(dx, dy) <= 1:
            assert (left, right) == (0, 0)
            return
        sin, cos = math.sin(math.radians(direction)), math.cos(math.radians(direction))
        ahead, aside = dy * cos - dx * sin, -dx * cos - dy * sin
        expected = [int(side[0]) for side in wheels_towards(np.array([ahead]), np.array([aside]))]
        # Dead astern, and at just a right angle, the last bit of a cosine decides which way to turn.
        if abs(aside) > 1e-6 or ahead > 1e-6:
            assert (left, right) == pytest.approx(expected, abs=1)

    def test_a_driven_robot_arrives_at_every_point(self):
        this, x, y, angle, step = robot(), 300.0, 300.0, 1.0, 0
        points = [(1500, 400), (1500, 1500), (300, 300)]
        this.on_recv(0, route_order(1, 1, 60, points))
        nearest = [math.inf] * len(points)
        while len(this.encode()) > STANDS_BYTES and step < 1000:
            left, right = (3.0 * side for side in wheels(this, step * 50, x, y, math.degrees(angle), step))
            x -= (left + right) / 2 * 0.05 * math.sin(angle)
            y += (left + right) / 2 * 0.05 * math.cos(angle)
            angle += (left - right) / 75 * 0.05
            nearest = [min(near, math.dist((x, y), point)) for near, point in zip(nearest, points)]
            step += 1
        assert step < 600
        assert max(nearest) <= 61


class TestBytes:
    def test_the_state_is_the_documented_bytes(self):
        this = robot(3)
        never = struct.pack("<QQqQ", 0, 0, NEVER, 0)
        assert this.encode() == bytes(27) + PUBLIC[GATEWAY] + never + PUBLIC[OPERATOR] + never + bytes(3)
        this.on_recv(5000, wheels_order(3, 6, -1, 2, said=3000))
        this.on_recv(5001, led_order(3, 7, 8, 9, 10, said=3010))
        assert this.encode()[: AT("signers")] == struct.pack("<3f2bQ3B2B", 0, 0, 0, -1, 2, 5000, 8, 9, 10, 0, 2)
        this.on_input(0, 5002, reading(3, 1, 2, -3))
        assert this.encode()[: AT("signers")] == struct.pack("<3f2bQ3B2B", 1, 2, -3, -1, 2, 5000, 8, 9, 10, 0, 0)
        heard = PUBLIC[GATEWAY] + struct.pack("<QQqQ", 7, 3010, 1991, 5001)
        assert this.encode()[AT("signers") :] == heard + PUBLIC[OPERATOR] + never + bytes(3)
        this.on_recv(5003, route_order(3, 8, 70, [(11, 12), (13, 14)], said=3020))
        assert this.encode()[AT("threshold_mm") :] == struct.pack("<HB4H", 70, 2, 11, 12, 13, 14)

    def test_the_command_comes_first_and_then_the_broadcast_when_it_is_due(self):
        this = robot(4)
        this.on_recv(0, led_order(4, 1, 1, 2, 3))
        for step in range(13):
            outputs = this.on_input(step, 900 + step, reading(4, 10, 20, 30))
            assert outputs[0] == Act(struct.pack("<BHQ2b3B", 5, 4, 900 + step, 0, 0, 1, 2, 3))
            due = [Send(struct.pack("<BHQ3f3B", 7, 4, 900 + step, 10, 20, 30, 1, 2, 3))] if (step + 4) % 6 == 0 else []
            assert outputs[1:] == due

    @pytest.mark.parametrize(
        "wrong",
        [reading(2, 1, 1, 0), reading(1, 1, math.nan, 0), reading(1, 1, 1, 1.1e6), reading(1, 1, 1, 1)[1:], b""],
    )
    def test_a_reading_that_makes_no_sense_stops_the_robot_in_silence(self, wrong):
        this = robot()
        this.on_recv(0, wheels_order(1, 1, 50, 50))
        this.on_input(5, 8, wrong)  # from then on signatures are looked at again
        before = this.encode()
        assert this.on_input(5, 9, wrong) == [Act(struct.pack("<BHQ2b3B", 5, 1, 9, 0, 0, 0, 0, 0))]
        assert this.encode() == before

    def test_outputs_pack_and_unpack(self):
        outputs = [Act(b"a" * 300), Send(b""), Send(b"b")]
        assert unpack_outputs(pack_outputs(outputs)) == outputs


COLOUR = st.integers(0, 255)
# How each order of the mission begins: who signed it is looked at.
OURS = b"\x04" + MISSION.to_bytes(4, "little")
ORDERS = st.one_of(
    st.builds(wheels_order, st.integers(1, 2), st.integers(1, 50), st.integers(-128, 127), st.integers(-128, 127)),
    st.builds(led_order, st.integers(1, 2), st.integers(1, 50), COLOUR, COLOUR, COLOUR),
    st.builds(
        route_order,
        st.just(1),
        st.integers(1, 50),
        st.integers(1, 1000),
        st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 2000)), max_size=32),
    ),
    st.binary(max_size=150),
    st.binary(max_size=140).map(lambda rest: OURS + rest),
)
NUMBERS = st.floats(-3000, 3000, width=32)
READINGS = st.one_of(st.builds(reading, st.just(1), NUMBERS, NUMBERS, NUMBERS), st.binary(max_size=24))
ENTRIES = st.lists(st.tuples(st.booleans(), st.integers(0, 400), ORDERS, READINGS), max_size=30)


def run_digest():
    """A random visit in one hash: a robot that is driven, coloured and sent round, amid noise."""
    rng = np.random.default_rng(21)
    this = robot(3)
    x, y, direction = 500.0, 600.0, 10.0
    digest = hashlib.sha256()
    for step in range(400):
        t = step * 100
        number = int(rng.integers(1, step + 2))
        left, right, a, b = (int(n) for n in rng.integers(-128, 128, 4))
        points = [(int(px), int(py)) for px, py in rng.integers(0, 2000, (int(rng.integers(0, 33)), 2))]
        said = [
            wheels_order(3, number, left, right),
            led_order(3, number, a + 128, b + 128, 5),
            rng.bytes(10),
            route_order(3, number, 300, points),
            OURS + rng.bytes(90),
        ][int(rng.integers(0, 5))]
        if rng.integers(0, 3) == 0:
            this.on_recv(t, said)
        outputs = this.on_input(step, t, reading(3, x, y, direction))
        left, right, _ = command(outputs)
        # Not a real robot's motion, but one that every machine agrees on.
        x, y = (x + left) % 2000.0, (y + right) % 2000.0
        direction += (left - right) * 0.25
        digest.update(b"".join(output.payload for output in outputs) + this.encode())
    return digest.hexdigest()


class TestReplay:
    def test_a_run_has_the_same_bytes_compiled_interpreted_and_everywhere(self):
        script = "from phalanx import kernel; import test_wheels; print(int(kernel.PURE), test_wheels.run_digest())"
        assert uncompiled(script) == ["1", run_digest()]
        assert run_digest() == RUN_SHA256

    @settings(deadline=None)
    @given(ENTRIES, st.data())
    def test_from_any_checkpoint_it_goes_on_the_same(self, entries, data):
        seen = play(robot(), entries)
        cut = data.draw(st.integers(0, len(seen)))
        if cut:
            other = robot()
            # Whatever lies behind the state in its row is not part of it.
            other.on_recv(0, route_order(1, 1, 1, [(9, 9)] * 32))
            _, encoding, t, step = seen[cut - 1]
            other.decode(encoding)
            assert play(other, entries[cut:], t, step) == seen[cut:]

    @settings(deadline=None)
    @given(ENTRIES)
    def test_commands_are_percent_and_states_are_ones_that_it_accepts(self, entries):
        for outputs, encoding, _, _ in play(robot(), entries):
            robot().decode(encoding)
            assert all(abs(side) <= 100 for side in (command(outputs)[:2] if outputs else ()))

    @settings(deadline=None)
    @given(ENTRIES, st.binary(max_size=150).filter(lambda noise: noise[:5] != OURS))
    def test_noise_changes_nothing(self, entries, noise):
        this, other = robot(), robot()
        for entry in entries:
            other.on_recv(1, noise)
            assert play(this, [entry]) == play(other, [entry])

    @settings(deadline=None)
    @given(st.one_of(st.binary(max_size=300), st.tuples(st.integers(0, STANDS_BYTES - 1), st.integers(0, 255))))
    def test_a_foreign_checkpoint_is_taken_whole_or_refused(self, encoding):
        this = robot()
        if isinstance(encoding, tuple):  # its own, but for a byte
            at, byte = encoding
            own = this.encode()
            encoding = own[:at] + bytes([byte]) + own[at + 1 :]
        assert is_taken_whole_or_refused(this, encoding)

    @pytest.mark.parametrize(
        "at, wrong",
        [
            (0, struct.pack("<f", math.nan)),
            (8, struct.pack("<f", 1.1e6)),
            (12, b"\x65"),  # 101 %
            (12, b"\x05"),  # driven, and on a route
            (13, b"\x80"),
            (21, b"\x80"),  # heard before the clock began
            (AT("held"), b"\4"),  # by nobody
            (AT("held"), b"\1"),  # and on a route
            (AT("checks"), b"\x11"),
            (AT("signers"), b"\0"),  # whom it obeys
            (AT("signers") + 64, b"\0"),
            *((AT("signers") + at, b"\x80") for at in (39, 47, 63)),
            (AT("signers") + 55, b"\x7f"),  # heard later than any clock shows
            (AT("threshold_mm"), b"\0\0"),  # a point that is never near enough
            (AT("threshold_mm"), b"\xff\xff"),
            (AT("count"), b"\0"),
            (AT("count"), b"\2"),
            (AT("count"), b"\x21"),
        ],
    )
    def test_a_checkpoint_that_no_run_leads_to_is_refused(self, at, wrong):
        this = robot()
        this.on_recv(0, route_order(1, 1, 60, [(5, 6)]))
        encoding = this.encode()
        this.decode(encoding)
        with pytest.raises(PeerError):
            this.decode(encoding[:at] + wrong + encoding[at + len(wrong) :])
