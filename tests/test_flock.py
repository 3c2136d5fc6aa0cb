"""The flocking controller's bytes, and that nobody can tell a replay from the run; the law is in test_flock_law.py."""

from __future__ import annotations

import hashlib
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commands import uncompiled
from flocking import CONFIG, PERIOD_MS, acceleration, reading, robot, state
from phalanx.config.flock import Box, FlockConfig
from phalanx.errors import PeerError
from phalanx.robot.controllers.python_controller import Act, Send
from phalanx.wire.fields import get_f32, put_f32
from replays import is_taken_whole_or_refused, play

# Of `run_digest`. Another value on another machine means that honest robots would be convicted there.
RUN_SHA256 = "6f7c4293dac2a6e4aaed071b6446748d44a29ec738f7345b0a7c00f4e42b7ba8"


def command(rob, t, ax, ay):
    return struct.pack("<BHQ2f", 0x03, rob, t, ax, ay)


def neighbours(encoding):
    (count,) = struct.unpack_from("<H", encoding, 16)
    return [struct.unpack_from("<HQ4f", encoding, 18 + 26 * k) for k in range(count)]


# --- the bytes --------------------------------------------------------------------------------------------------------


class TestBytes:
    @settings(deadline=None)
    @given(st.floats(-3e38, 3e38) | st.floats(-1e-37, 1e-37), st.integers(0, 3))
    def test_numbers_are_rounded_to_f32_as_ieee_says_even_the_smallest(self, number, at):
        row = np.zeros(8, np.uint8)
        put_f32(row, at, number)
        assert row[at : at + 4].tobytes() == struct.pack("<f", number)
        assert get_f32(row, at) == struct.unpack_from("<f", row, at)[0]

    def test_the_command_comes_first_and_then_the_broadcast_when_it_is_due(self):
        this = robot(4, FlockConfig())
        for step in range(13):
            outputs = this.on_input(step, 7000 + step, reading(4, 500, 480, 1, 2, t=3))
            assert outputs[0] == Act(command(4, 7000 + step, -0.06, np.float32(0.02 - 0.12)))
            due = [Send(state(4, 500, 480, 1, 2, 7000 + step))] if (step + 4) % 6 == 0 else []
            assert outputs[1:] == due

    def test_the_state_is_the_papers_checkpoint(self):
        this = robot(9, FlockConfig())
        assert this.encode() == bytes(18)
        for rob in range(40, 16, -1):
            this.on_recv(77, state(rob, rob, 1, 2, 3))
        this.on_input(0, 100, reading(9, 5, 6, 7, 8))
        encoding = this.encode()
        assert len(encoding) == 690 - 48  # less time and two tops
        assert struct.unpack_from("<4f", encoding) == (5, 6, 7, 8)
        assert neighbours(encoding) == [(rob, 77, rob, 1, 2, 3) for rob in range(17, 41)]

    def test_a_full_table_loses_the_oldest_and_of_these_the_lowest_id(self):
        this = robot()
        for t, rob in ((30, 20), (10, 40), (10, 30), (20, 50), (20, 60)):
            this.on_recv(t, state(rob, 0, 0))
        for rob, left in ((35, [20, 35, 40, 50, 60]), (70, [20, 35, 50, 60, 70]), (2, [2, 20, 35, 60, 70])):
            this.on_recv(40, state(rob, 0, 0))
            assert [one[0] for one in neighbours(this.encode())] == left

    def test_a_robot_heard_again_is_where_it_says_now(self):
        this = robot()
        this.on_recv(1, state(2, 0, 0))
        this.on_recv(5, state(2, 1, 2, 3, 4))
        assert neighbours(this.encode()) == [(2, 5, 1, 2, 3, 4)]

    def test_who_is_silent_for_three_broadcasts_is_forgotten(self):
        this = robot()
        for t, rob in ((0, 2), (600, 3), (0, 4), (700, 5)):
            this.on_recv(t, state(rob, 3, 3))
        this.on_input(0, 4500, reading(1, 0, 0))
        assert len(neighbours(this.encode())) == 4
        this.on_input(1, 4501, reading(1, 0, 0))
        assert [one[0] for one in neighbours(this.encode())] == [3, 5]

    @pytest.mark.parametrize(
        "packet",
        [
            state(1, 2, 3),
            state(0, 2, 3),
            state(2, 2, 3)[:-1],
            state(2, 2, 3) + b"\0",
            b"",
            b"\x01",
            state(2, math.nan, 3),
            state(2, 2, math.inf),
            state(2, 2, 3, 1.1e6),
            reading(2, 2, 3),
            state(2, 2, 3, 0, -math.nan),
        ],
    )
    def test_a_frame_that_makes_no_sense_is_ignored(self, packet):
        this = robot()
        this.on_recv(3, packet)
        assert this.encode() == robot().encode()

    @pytest.mark.parametrize(
        "wrong", [reading(2, 1, 1), reading(1, math.nan, 1), reading(1, 1, 1)[:-1], state(1, 1, 1), b""]
    )
    def test_a_reading_that_makes_no_sense_lets_the_robot_coast_in_silence(self, wrong):
        this = robot()
        this.on_recv(0, state(2, 3, 3))
        before = this.encode()
        assert this.on_input(5, 9, wrong) == [Act(command(1, 9, 0, 0))]
        assert this.encode() == before


# --- replay -----------------------------------------------------------------------------------------------------------

NUMBERS = st.floats(-40, 40, width=32)
FRAMES = st.one_of(
    st.builds(state, st.integers(0, 9), NUMBERS, NUMBERS, NUMBERS, NUMBERS),
    st.binary(max_size=30),
    st.binary(min_size=26, max_size=26).map(lambda rest: b"\x01" + rest),
)
READINGS = st.one_of(st.builds(reading, st.just(1), NUMBERS, NUMBERS, NUMBERS, NUMBERS), st.binary(max_size=30))
ENTRIES = st.lists(st.tuples(st.booleans(), st.integers(0, 2000), FRAMES, READINGS), max_size=30)


def run_digest():
    """A whole random run in one hash: six robots that hear each other, liars and noise, between obstacles."""
    rng = np.random.default_rng(20)
    config = FlockConfig(
        goal_m=(20, 15),
        d_m=7,
        n_max=4,
        c1_alpha=0.5,
        c1_beta=1,
        c2_beta=0.5,
        discs=CONFIG.discs,
        boxes=(Box(left_m=12, bottom_m=-5, right_m=14, top_m=8),),
    )
    fleet = [robot(i + 1, config) for i in range(6)]
    place = rng.uniform(0, 12, (6, 4))
    digest = hashlib.sha256()
    for step in range(60):
        t = step * PERIOD_MS
        packets = [rng.bytes(27), b"\x01" + rng.bytes(26), state(9, *rng.uniform(0, 20, 2), *rng.uniform(-2, 2, 2))]
        for i, this in enumerate(fleet):
            outputs = this.on_input(step, t, reading(i + 1, *place[i]))
            packets += [output.payload for output in outputs if isinstance(output, Send)]
            # Commands are exact in f64, and so are these sums and products up to one rounding each.
            place[i, 2:] += np.multiply(acceleration(outputs), 0.25)
            place[i, :2] += place[i, 2:] * 0.25
            digest.update(b"".join(output.payload for output in outputs) + this.encode())
        for this in fleet:
            for packet in packets:
                this.on_recv(t, packet)
    return digest.hexdigest()


class TestReplay:
    def test_a_run_has_the_same_bytes_compiled_interpreted_and_everywhere(self):
        script = "from phalanx import kernel; import test_flock; print(int(kernel.PURE), test_flock.run_digest())"
        assert uncompiled(script) == ["1", run_digest()]
        assert run_digest() == RUN_SHA256

    @settings(deadline=None)
    @given(ENTRIES, st.data())
    def test_from_any_checkpoint_it_goes_on_the_same(self, entries, data):
        seen = play(robot(), entries)
        cut = data.draw(st.integers(0, len(seen)))
        other = robot()
        # Whatever lies behind the state in its row is not part of it.
        for rob in range(20, 25):
            other.on_recv(3, state(rob, 1, 1))
        if cut:
            _, encoding, t, step = seen[cut - 1]
            other.decode(encoding)
            assert play(other, entries[cut:], t, step) == seen[cut:]

    @settings(deadline=None)
    @given(ENTRIES, st.binary(max_size=40))
    def test_garbage_changes_nothing(self, entries, noise):
        this, other = robot(), robot()
        if len(noise) == 27:
            noise += b"\0"
        for entry in entries:
            other.on_recv(1, noise)
            assert play(this, [entry]) == play(other, [entry])

    @settings(deadline=None)
    @given(ENTRIES)
    def test_commands_are_finite_and_states_are_ones_that_it_accepts(self, entries):
        for outputs, encoding, _, _ in play(robot(), entries):
            robot().decode(encoding)
            assert all(abs(number) <= 5 for number in (acceleration(outputs) if outputs else ()))
            assert len(encoding) <= 18 + 26 * CONFIG.n_max

    @settings(deadline=None)
    @given(st.binary(max_size=200))
    def test_a_foreign_checkpoint_is_taken_whole_or_refused(self, encoding):
        assert is_taken_whole_or_refused(robot(), encoding)

    @pytest.mark.parametrize(
        "ids, count",
        [((3, 2), 2), ((2, 2), 2), ((1,), 1), ((0,), 1), ((2,), 2), ((2, 3), 1), ((2, 3, 4, 5, 6, 7), 6), ((), 60000)],
    )
    def test_a_checkpoint_that_no_run_leads_to_is_refused(self, ids, count):
        encoding = struct.pack("<4fH", 0, 0, 0, 0, count) + b"".join(
            struct.pack("<HQ4f", rob, 5, 0, 0, 0, 0) for rob in ids
        )
        with pytest.raises(PeerError):
            robot().decode(encoding)
