"""The guard, one call at a time: what it does with advice, whom it keeps clear of, its bytes, and its replay."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given, settings
from hypothesis import strategies as st

from commands import uncompiled
from guarded_world import MOTION, acceleration, guard, reading, sharpness, state, wish
from phalanx.config.flock import Box, Disc
from phalanx.config.guard import GuardConfig
from phalanx.errors import PeerError, UsageError
from phalanx.robot.controllers.bundled.guard import HEAD_BYTES, ROUNDED_M
from phalanx.robot.controllers.guard_law import guard_params
from phalanx.robot.controllers.python_controller import Send, pack_outputs
from phalanx.robot.planner import Planner, advice_of
from phalanx.robot.signer import AdviceSigner
from phalanx.wire import guarded

# Of `run_digest`. Another value on another machine means that honest robots would be convicted there.
RUN_SHA256 = "21257da07f19ce54f04eef23390d0418a461145ab5aa493212a258e564bd54ca"
CONFIG = GuardConfig()
LISTENED_MS = 1000 + CONFIG.forget_ms
# A velocity that promises nothing, as who is alone says it.
FREE = (CONFIG.speed_mps, 0.0)
FIELD = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
FENCED = {"fences": (FIELD,)}


def listened(config=CONFIG):
    """A guard that has listened for as long as it must."""
    this = guard(config)
    this.on_input(0, 1000, reading(1, (0, 0), (0, 0)))
    return this


def driven(this, t_ms=LISTENED_MS, place=(0.0, 0.0), velocity=(0.0, 0.0), wished=(1.0, 0.0)):
    """What it commands when that is wished."""
    if wished is not None:
        this.on_advice(wish(*wished))
    return acceleration(this.on_input(1, t_ms, reading(1, place, velocity)))


class TestAdvice:
    def test_it_listens_first_and_then_does_what_is_wished(self):
        this = listened()
        assert driven(this, LISTENED_MS - 1) == (0.0, 0.0)
        ax, ay = driven(this)
        assert ax > 0.0
        assert ay == 0.0

    def test_advice_is_good_for_a_second_and_then_it_brakes(self):
        this = listened()
        driven(this, wished=(1.0, 0.0))
        moving = {"velocity": (0.9, 0.0), "wished": None}
        assert driven(this, LISTENED_MS + CONFIG.advice_ms, **moving)[0] > 0.0
        assert driven(this, LISTENED_MS + CONFIG.advice_ms + 1, **moving)[0] < -0.9

    def test_without_advice_it_stands(self):
        assert driven(listened(), wished=None) == (0.0, 0.0)

    @pytest.mark.parametrize(
        "advice",
        [
            wish(math.nan, 0),
            wish(0, math.inf),
            wish(1, 0)[:-1],
            wish(1, 0) + b"\0",
            b"\x0d" + bytes(8),
            b"",
        ],
    )
    def test_what_is_no_wish_is_no_advice(self, advice):
        this = listened()
        before = this.encode()
        this.on_advice(advice)
        assert this.encode() == before

    def test_a_wish_of_any_speed_is_shortened_and_keeps_its_direction(self):
        for size in (10.0, 1e6, 1e7, 8e37):
            ax, ay = driven(listened(), wished=(3 * size, 4 * size))
            assert ax > 0.0
            assert ay / ax == pytest.approx(4 / 3, rel=1e-5)

    @pytest.mark.parametrize("wished", [(3e300, 4e300), (-3e39, 4e39), (1e39, 1.0)])
    def test_what_an_f32_does_not_hold_is_a_wish_in_its_direction(self, wished):
        class Fast(Planner):
            def advise(self, _t_s, _position_m, _velocity_mps):
                return wished

        _, x, y = guarded.WISH.form.unpack(advice_of(Fast(1, (0.0, 0.0)), 0, reading(1, (0, 0), (0, 0))))
        assert x / wished[0] == pytest.approx(y / wished[1], rel=1e-6)
        assert max(abs(x), abs(y)) > 1e38

    @given(st.tuples(*[st.floats(-1e6, 1e6, width=32)] * 2), st.tuples(*[st.floats(-2, 2, width=32)] * 2))
    def test_no_wish_is_harder_or_faster_than_the_envelope(self, wished, velocity):
        ax, ay = driven(listened(), velocity=velocity, wished=wished)
        assert math.hypot(ax, ay) <= CONFIG.accel_mps2 * (1 + 1e-6)
        held_s = (CONFIG.period_ms + 3 * CONFIG.delta_ms) / 1000
        later = math.hypot(velocity[0] + held_s * ax, velocity[1] + held_s * ay)
        assert later <= max(CONFIG.speed_mps, math.hypot(*velocity)) + 1e-6


class TestTurns:
    """A turn rate in the envelope: nobody who is under way turns faster than that, and brakes are as they were."""

    SLOW = replace(CONFIG, turn_radps=0.8)

    @given(st.tuples(*[st.floats(-9, 9, width=32)] * 2), st.tuples(*[st.floats(-2, 2, width=32)] * 2))
    def test_no_command_turns_the_velocity_faster_nor_makes_it_faster_than_without(self, wished, velocity):
        command = np.array(driven(listened(self.SLOW), velocity=velocity, wished=wished))
        assert sharpness(self.SLOW, np.array(velocity), command) <= 1 + 1e-4
        held_s = (CONFIG.period_ms + 3 * CONFIG.delta_ms) / 1000
        assert np.hypot(*(velocity + held_s * command)) <= max(CONFIG.speed_mps, math.hypot(*velocity)) + 1e-6

    def test_without_one_it_turns_as_fast_as_it_can(self):
        sharp = driven(listened(), velocity=(1.5, 0.0), wished=(1.0, 1.0))
        assert sharpness(self.SLOW, np.array((1.5, 0.0)), np.array(sharp)) > 1.0

    def test_it_curves_at_the_rate_that_it_may(self):
        ax, ay = driven(listened(self.SLOW), velocity=(1.0, 0.0), wished=(1.5, 0.8))
        assert ax > 0.0
        assert ay == pytest.approx(0.8, rel=1e-6)

    @pytest.mark.parametrize("wished", [None, (0.0, 0.0)])
    def test_brakes_are_as_hard_as_without(self, wished):
        for velocity in ((1.5, 0.0), (0.3, -1.1)):
            plain, slow = (driven(listened(each), velocity=velocity, wished=wished) for each in (CONFIG, self.SLOW))
            assert plain == slow

    def test_who_stands_starts_in_any_direction_and_who_is_to_go_back_comes_to_rest_first(self):
        assert driven(listened(self.SLOW), wished=(0.0, -1.0))[1] < 0.0
        creeps = {"velocity": (0.049 * CONFIG.speed_mps, 0.0), "wished": (0.0, -1.0)}
        assert driven(listened(self.SLOW), **creeps) == driven(listened(), **creeps)
        this, velocity, step = listened(self.SLOW), np.array((1.5, 0.0)), 0
        seen = [velocity]
        while velocity[0] > -1.0 and step < 60:
            command = driven(this, LISTENED_MS + 250 * step, velocity=tuple(velocity), wished=(-1.5, 0.4))
            velocity, step = velocity + 0.25 * np.array(command), step + 1
            seen.append(velocity)
        assert velocity[0] <= -1.0, "it never got round"
        assert min(np.hypot(*each) for each in seen) <= 0.05 * CONFIG.speed_mps


class TestSignedAdvice:
    """A mission that names an adviser: nobody else's advice counts, nor his to another, for another time, or again."""

    KEY, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes((k,)) * 32) for k in (1, 2))
    NAMED = replace(CONFIG, adviser_key=KEY.public_key().public_bytes_raw().hex(), mission=7)

    @classmethod
    def signed(cls, t_ms=LISTENED_MS - 250, wished=(1.0, 0.0), *, robot=1, mission=7, key=None):
        return AdviceSigner(key or cls.KEY, mission).sign(robot, t_ms, wish(*wished))

    def driven(self, advice, t_ms=LISTENED_MS):
        this = listened(self.NAMED)
        this.on_advice(advice)
        return driven(this, t_ms, wished=None)

    def test_what_he_signs_is_done_until_it_is_old(self):
        assert self.driven(self.signed())[0] > 0.0
        assert self.driven(self.signed(LISTENED_MS - CONFIG.advice_ms))[0] > 0.0
        assert self.driven(self.signed(LISTENED_MS - CONFIG.advice_ms - 1)) == (0.0, 0.0)

    @pytest.mark.parametrize(
        "wrong",
        [
            {"key": OTHER},
            {"robot": 2},
            {"mission": 8},
            {"t_ms": LISTENED_MS + 1},  # it would be kept for later
            {"t_ms": 0},
            {"t_ms": 1 << 63},
            {"wished": (math.nan, 0.0)},
        ],
    )
    def test_what_is_not_for_this_robot_and_now_is_no_advice(self, wrong):
        assert self.driven(self.signed(**wrong)) == (0.0, 0.0)

    @given(st.integers(0, 8 * guarded.SIGNED_BYTES - 1))
    def test_advice_of_which_a_bit_is_flipped_is_none(self, at):
        flipped = bytearray(self.signed())
        flipped[at // 8] ^= 1 << at % 8
        assert self.driven(bytes(flipped)) == (0.0, 0.0)

    @pytest.mark.parametrize("advice", [wish(1, 0), b"", b"\x0f"])
    def test_what_nobody_signed_is_none(self, advice):
        assert self.driven(advice) == (0.0, 0.0)
        for longer in (self.signed()[:-1], self.signed() + b"\0"):
            assert self.driven(longer) == (0.0, 0.0)

    def test_a_mission_that_names_nobody_takes_nothing_signed(self):
        this = listened()
        this.on_advice(self.signed(mission=1))
        assert driven(this, wished=None) == (0.0, 0.0)

    def test_none_is_taken_twice_nor_an_older_one_after_it(self):
        this = listened(self.NAMED)
        this.on_advice(self.signed(LISTENED_MS - 100, (0.0, 0.0)))
        assert driven(this, wished=None) == (0.0, 0.0)
        for t_ms in (LISTENED_MS - 100, LISTENED_MS - 101):
            this.on_advice(self.signed(t_ms))
            assert driven(this, LISTENED_MS + 250, wished=None) == (0.0, 0.0)
        this.on_advice(self.signed(LISTENED_MS - 99))
        assert driven(this, LISTENED_MS + 250, wished=None)[0] > 0.0

    def test_one_signature_is_looked_at_between_two_readings_and_what_needs_no_look_costs_none(self):
        this = listened(self.NAMED)
        this.on_advice(self.signed(key=self.OTHER))
        this.on_advice(self.signed())
        assert driven(this, wished=None) == (0.0, 0.0)
        for wrong in (wish(1, 0), self.signed(robot=2), self.signed(mission=8), self.signed(0)):
            this.on_advice(wrong)
        this.on_advice(self.signed())
        assert driven(this, wished=None)[0] > 0.0

    def test_its_state_is_as_long_as_without_an_adviser_and_knows_which_one(self):
        states = []
        for config in (CONFIG, self.NAMED, replace(self.NAMED, mission=8), replace(self.NAMED, adviser_key="00" * 32)):
            this = listened(config)
            this.on_advice(self.signed())
            states.append(this.encode())
        assert {len(each) for each in states} == {HEAD_BYTES}
        assert len({each[:20] for each in states}) == 4
        for config, other in ((self.NAMED, CONFIG), (CONFIG, self.NAMED)):
            with pytest.raises(PeerError):
                guard(config).decode(listened(other).encode())

    def test_a_key_of_zeros_is_nobody_s(self):
        this = listened(replace(self.NAMED, adviser_key="00" * 32))
        this.on_advice(guarded.SIGNED_WISH.encode(mission=7, id=1, t=LISTENED_MS, vx_mps=1, vy_mps=0) + bytes(64))
        assert driven(this, wished=None) == (0.0, 0.0)

    @pytest.mark.parametrize("key", ["00", "x" * 64, "00" * 33])
    def test_what_is_no_key_is_said(self, key):
        with pytest.raises(UsageError, match="adviser_key is"):
            replace(CONFIG, adviser_key=key)


class TestNeighbours:
    def test_it_slows_down_as_a_neighbour_falls_silent_and_goes_on_when_it_has_forgotten(self):
        this = listened()
        this.on_recv(LISTENED_MS, state(2, (12, 0), FREE))
        pushes = []
        for later_ms in range(0, CONFIG.forget_ms + 1000, 500):
            pushes.append(driven(this, LISTENED_MS + later_ms)[0])
        slower = [b <= a for a, b in zip(pushes, pushes[1:-1], strict=False)]
        assert pushes[0] > 0.0
        assert all(slower)
        assert pushes[-2] == 0.0
        assert pushes[-1] == pushes[0]

    def test_it_does_not_approach_who_may_come_towards_it(self):
        this = listened()
        this.on_recv(LISTENED_MS, state(2, (5, 0), FREE))
        assert driven(this) == (0.0, 0.0)

    def test_who_is_heard_where_nobody_can_have_got_to_makes_it_stand(self):
        # In a second, and what a broadcast may be late; and what is left to rounding.
        most_m = CONFIG.speed_mps * (1.0 + CONFIG.radio_ms / 1000) + ROUNDED_M
        for there, stands in (((60, most_m - 0.02), False), ((60, most_m + 0.02), True)):
            this = listened()
            this.on_recv(LISTENED_MS - 1000, state(2, (60, 0)))
            this.on_recv(LISTENED_MS, state(2, there))
            assert (driven(this) == (0.0, 0.0)) is stands
            assert driven(this, LISTENED_MS + CONFIG.forget_ms)[0] > 0.0

    def test_more_robots_than_it_remembers_make_it_stand(self):
        for others, stands in ((3, False), (4, True)):
            this = listened(replace(CONFIG, n_max=3))
            for rob in range(2, 2 + others):
                this.on_recv(LISTENED_MS, state(rob, (60, rob)))
            assert (driven(this) == (0.0, 0.0)) is stands

    def test_its_own_word_from_the_air_and_rubbish_are_not_heard(self):
        this = listened()
        before = this.encode()
        for packet in (
            state(1, (1, 1)),
            state(0, (1, 1)),
            state(2, (math.nan, 0)),
            state(2, (0, 0))[:-1],
            b"\x01",
            b"",
        ):
            this.on_recv(7, packet)
        assert this.encode() == before


def said_by(this, step, **now):
    """The velocity that it says at that step."""
    place, velocity = now.get("place", (0, 0)), now.get("velocity", (0, 0))
    this.on_advice(wish(*now.get("wished", (2.0, 0.0))))
    outputs = this.on_input(step, now.get("t_ms", LISTENED_MS), reading(1, place, velocity))
    (said,) = (output.payload for output in outputs if isinstance(output, Send))
    return MOTION.unpack(said)[5:]


def near_a_robot(gap_m=6.0, config=CONFIG):
    """A guard that has listened, with a standing robot to its right."""
    this = listened(config)
    this.on_recv(LISTENED_MS, state(2, (gap_m, 0)))
    return this


class TestPromises:
    SAYS = CONFIG.state_every - 1  # a step at which robot 1 broadcasts

    def test_who_promises_to_stand_may_be_approached_until_that_is_over(self):
        assert driven(near_a_robot(5.0))[0] > 0.0
        assert driven(near_a_robot(5.0), LISTENED_MS + CONFIG.promise_ms) == (0.0, 0.0)

    def test_it_counts_on_where_a_neighbour_goes(self):
        pushes = []
        for said in ((-0.9, 0), (0, 0.9), (0.9, 0)):
            this = listened()
            this.on_recv(LISTENED_MS, state(2, (6, 0), said))
            pushes.append(driven(this)[0])
        assert pushes == sorted(set(pushes))

    def test_who_is_alone_promises_nothing(self):
        assert said_by(listened(), self.SAYS) == FREE
        assert said_by(near_a_robot(90.0), self.SAYS) == FREE

    def test_it_promises_less_the_nearer_somebody_is_and_less_towards_than_away(self):
        towards = [said_by(near_a_robot(gap_m), self.SAYS)[0] for gap_m in (12, 6, 3, 1.4)]
        assert towards == sorted(towards, reverse=True)
        assert towards[0] > 3 * towards[2] > 0.0 == towards[3]
        away = said_by(near_a_robot(3.0), self.SAYS, wished=(-2.0, 0.0))
        assert -away[0] > 4 * towards[2]

    def test_two_that_are_near_each_other_do_not_promise_away_the_same_room(self):
        # In a promise's time each comes nearer by at most its share of what is between them and `apart_m`.
        for gap_m in (2.0, 4.0, 8.0):
            said = said_by(near_a_robot(gap_m), self.SAYS)[0]
            assert 1.3 * said * CONFIG.promise_ms / 1000 <= 0.6 * (gap_m - CONFIG.apart_m) + 1e-6

    def test_what_it_does_already_is_in_what_it_says(self):
        said = np.array(said_by(near_a_robot(3.0), self.SAYS, velocity=(0, 0.9)))
        assert np.hypot(*(np.array((0, 0.9)) - said / 2)) <= 0.8 * np.hypot(*said) + 0.01 * CONFIG.speed_mps

    def test_it_keeps_its_word_when_nobody_is_near_any_more_and_until_it_is_over(self):
        config = replace(CONFIG, forget_ms=1000)
        this, begin = near_a_robot(4.0, config), 1000 + config.forget_ms
        this.on_recv(begin, state(2, (4.0, 0)))
        said = said_by(this, self.SAYS, t_ms=begin)
        assert 0.0 < said[0] < 0.4
        later = {"velocity": (said[0], 0.0), "wished": (2.0, 0.0)}
        assert driven(this, begin + config.promise_ms, **later)[0] < 0.1
        assert driven(this, begin + config.promise_ms + 11, **later)[0] == 2.0

    def test_who_wants_another_way_each_time_says_again_what_it_keeps(self):
        this, said = near_a_robot(4.0), []
        for k in range(7):
            wished = (math.cos(k), math.sin(k))
            said.append(said_by(this, CONFIG.state_every * (k + 1) - 1, t_ms=LISTENED_MS + 300 * k, wished=wished))
        assert len(set(said)) == 4
        assert said[4:] == [said[3]] * 3


class TestWalls:
    @pytest.mark.parametrize(
        "what", [{"fences": (FIELD,)}, {"boxes": (Box(left_m=50, bottom_m=-9, right_m=60, top_m=9),)}]
    )
    def test_it_goes_no_nearer_but_away_and_along(self, what):
        config = GuardConfig(**what)
        for place, wished, goes in (((49.2, 0), (1, 0), False), ((49.2, 0), (-1, 0), True), ((48, 0), (0, 0.2), True)):
            ax, ay = driven(listened(config), place=place, wished=wished)
            assert (abs(ax) + abs(ay) > 0.0) is goes, (place, wished)

    @pytest.mark.parametrize(
        ("place", "wished", "goes"),
        [
            # Half a metre from a slanted side, nearer than `clear_m`: away and along, both ways, and not against it.
            ((1.646, 6.354), (-1, 1), True),
            ((1.646, 6.354), (1, 1), True),
            ((1.646, 6.354), (-1, -1), True),
            ((1.646, 6.354), (1, -1), False),
            ((1.646, 6.354), (1, 0.9), False),
            # A disc behind walls in the list: a metre from its edge, and half a one.
            ((-2.0, -9.0), (2, 0), False),
            ((-2.0, -9.0), (0, 0.5), True),
            ((-1.5, -9.0), (-1, 0), True),
            ((-1.5, -9.0), (-1, 1), True),
            ((-1.5, -9.0), (0.1, 1), False),
        ],
    )
    def test_who_is_too_near_already_goes_away_and_along(self, place, wished, goes):
        config = GuardConfig(
            fences=(FIELD,), keep_out=(((0, 4), (4, 4), (4, 8)),), discs=(Disc(x_m=0, y_m=-9, radius_m=1),)
        )
        assert (driven(listened(config), place=place, wished=wished) != (0.0, 0.0)) is goes

    def test_who_is_near_a_wall_and_still_goes_towards_it_does_not_turn_along_it(self):
        config = GuardConfig(fences=(FIELD,))
        for vx, goes in ((0.3, False), (0.0, True)):
            ay = driven(listened(config), place=(49.5, 0), velocity=(vx, 0.0), wished=(0.0, 1.0))[1]
            assert (ay > 0.0) is goes

    def test_a_disc_is_a_wall(self):
        config = GuardConfig(discs=(Disc(x_m=3, y_m=0, radius_m=2),))
        assert driven(listened(config), wished=(1, 0)) == (0.0, 0.0)
        assert driven(listened(config), wished=(-1, 0))[0] < 0.0


def test_a_reading_that_is_not_its_own_or_makes_no_sense_leaves_it_coasting_and_silent():
    this = listened()
    driven(this)
    for read in (reading(2, (0, 0), (0, 0)), reading(1, (math.nan, 0), (0, 0)), reading(1, (0, 0), (0, 0))[:-1]):
        this.on_advice(wish(1.0, 0.0))
        outputs = this.on_input(CONFIG.state_every - 1, LISTENED_MS + 250, read)
        assert acceleration(outputs) == (0.0, 0.0)
        assert len(outputs) == 1
    assert driven(this)[0] > 0.0


class TestEnvelope:
    def test_the_boot_state_has_its_hash(self):
        def envelope(config):
            return guard(config).encode()[:20]

        params = guard_params(CONFIG)
        assert envelope(CONFIG) == hashlib.sha1(np.delete(params, range(17, 37)).tobytes()).digest()
        assert (
            len({envelope(replace(CONFIG, **other)) for other in ({}, {"speed_mps": 2.1}, {"turn_radps": 1.0}, FENCED)})
            == 4
        )

    @pytest.mark.parametrize("at", [20, 24, 28, 32, 61, 65])
    def test_a_state_with_what_is_no_number_is_refused(self, at):
        state = bytearray(listened().encode())
        state[at : at + 4] = struct.pack("<f", math.nan)
        with pytest.raises(PeerError):
            guard(CONFIG).decode(bytes(state))

    def test_a_state_of_another_envelope_is_refused(self):
        wider = listened(replace(CONFIG, speed_mps=2.5)).encode()
        with pytest.raises(PeerError):
            guard(CONFIG).decode(wider)

    @pytest.mark.parametrize(
        ("wrong", "says"),
        [
            ({"speed_mps": 0.3}, "accel_mps2 is 2"),
            ({"fences": (((0.0, 0.0), (1.0, 1.0)),)}, "fences has a polygon of 2 corners"),
            ({"keep_out": (((0.0, 0.0), (1.0, 1.0), (math.nan, 0.0)),)}, "a corner of keep_out is nan"),
            ({"advice_ms": 1}, "advice_ms is 1"),
        ],
    )
    def test_one_that_makes_no_sense_is_refused(self, wrong, says):
        with pytest.raises(UsageError, match=says):
            GuardConfig(**wrong)

    def test_robots_start_inside_with_room(self):
        config = GuardConfig(
            fences=(FIELD,), keep_out=(((5, 5), (9, 5), (9, 9)),), discs=(Disc(x_m=-9, y_m=0, radius_m=2),)
        )
        config.check_start((0, 0))
        for place, says in (
            ((60, 0), "outside its fences"),
            ((8, 6), "in a keep-out area"),
            ((49.5, 0), "0.5 m from an edge"),
            ((-6.5, 0), "0.5 m from an edge"),
        ):
            with pytest.raises(UsageError, match=says):
                config.check_start(place)


# --- replay -----------------------------------------------------------------------------------------------------------

NUMBERS = st.floats(-40, 40, width=32)
PAIRS = st.tuples(NUMBERS, NUMBERS)
FRAMES = st.builds(state, st.integers(0, 9), PAIRS, PAIRS) | st.binary(max_size=30)
ADVICE = st.builds(wish, NUMBERS, NUMBERS) | st.binary(max_size=12)
READINGS = st.builds(reading, st.just(1), PAIRS, PAIRS) | st.binary(max_size=30)
ENTRIES = st.lists(st.tuples(st.integers(0, 2), st.integers(0, 4000), FRAMES, ADVICE, READINGS), max_size=30)
BUSY = GuardConfig(n_max=4, forget_ms=3000, fences=(FIELD,), discs=(Disc(x_m=8, y_m=9, radius_m=3),))


def lived(this, entries, t=0, step=0):
    """Outputs and state after each entry."""
    seen = []
    for kind, gap, packet, advice, read in entries:
        t += gap
        outputs = []
        if kind == 0:
            this.on_recv(t, packet)
        elif kind == 1:
            this.on_advice(advice)
        else:
            outputs = this.on_input(step, t, read)
            step += 1
        seen.append((outputs, this.encode(), t, step))
    return seen


@settings(deadline=None)
@given(ENTRIES, st.data())
def test_a_checkpoint_is_all_that_it_remembers(entries, data):
    seen = lived(guard(BUSY), entries)
    k = data.draw(st.integers(0, len(entries)))
    again = guard(BUSY)
    t, step = (seen[k - 1][2:]) if k else (0, 0)
    again.decode(seen[k - 1][1] if k else again.encode())
    assert lived(again, entries[k:], t, step) == seen[k:]


@settings(deadline=None)
@given(st.binary(max_size=200), st.integers(0, 80), st.binary(max_size=4))
def test_any_bytes_are_a_state_or_refused(garbage, at, change):
    true = lived(guard(BUSY), [(0, 5, state(3, (1, 2)), b"", b""), (2, 9, b"", b"", reading(1, (3, 3), (0, 0)))])[-1][1]
    for encoding in (garbage, true[:at] + change + true[at + len(change) :], true[:HEAD_BYTES] + garbage):
        this = guard(BUSY)
        try:
            this.decode(encoding)
        except PeerError:
            continue
        this.on_recv(10, state(4, (2, 2)))
        assert this.on_input(2, 20, reading(1, (3, 3), (1, 0)))


CROWDED = replace(
    BUSY, turn_radps=1.0, discs=(Disc(x_m=3, y_m=9, radius_m=1),), fences=(), keep_out=(((0, 4), (4, 4), (4, 8)),)
)


def run_digest() -> str:
    """Of three robots that change places, then press against a disc and a triangle, then go away from them."""
    chance, digest = np.random.Generator(np.random.PCG64(11)), hashlib.sha256()
    robots = [guard(CROWDED, i + 1) for i in range(3)]
    at, velocity = np.array([(-9.0, 2.0), (9.0, 3.0), (1.0, -9.0)]), np.zeros((3, 2))
    goals = [
        ((9.0, 3.0), (1.0, -9.0), (-9.0, 2.0)),
        ((3.0, 9.0), (4.0, 6.0), (1.0, 6.0)),
        ((-9.0, 2.0), (9.0, 3.0), (9.0, 9.0)),
    ]
    for step in range(320):
        t, command = 1000 + 250 * step, np.zeros((3, 2))
        for i, this in enumerate(robots):
            this.on_advice(wish(*(np.array(goals[step // 110][i]) - at[i]) * 0.5 + chance.uniform(-0.3, 0.3, 2)))
            outputs = this.on_input(step, t, reading(i + 1, at[i], velocity[i]))
            command[i] = acceleration(outputs)
            for output in outputs:
                for j, other in enumerate(robots):
                    if isinstance(output, Send) and j != i and chance.random() < 0.7:
                        other.on_recv(t + int(chance.integers(250)), output.payload)
            digest.update(pack_outputs(outputs) + this.encode())
        at += 0.25 * (velocity + 0.125 * command)
        velocity += 0.25 * command
    return digest.hexdigest()


def test_the_same_bytes_everywhere_compiled_or_not():
    assert run_digest() == RUN_SHA256
    assert uncompiled("from test_guarded import run_digest; print(run_digest())") == [RUN_SHA256]


def test_it_broadcasts_as_a_flock_does():
    this = guard(CONFIG, 4)
    for step in range(13):
        said = [output for output in this.on_input(step, 7000, reading(4, (1, 2), (1, 1))) if isinstance(output, Send)]
        assert said == ([Send(state(4, (1, 2), FREE, 7000))] if (step + 4) % 6 == 0 else [])
