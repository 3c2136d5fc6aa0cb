"""Scenarios: what they may say, how options change them, and attacks in words."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.config import BtiConfig
from phalanx.config.flock import Box, Disc, FlockConfig
from phalanx.errors import UsageError
from phalanx.scenarios.attack_spec import AttackSpec, parse_attack
from phalanx.scenarios.scenario import Scenario

SPOOF = AttackSpec(name="spoof")


class TestScenario:
    def test_robots_stand_on_a_square_grid_row_by_row(self):
        starts = Scenario().starts_m
        assert len(starts) == 25
        assert starts[0] == (0, 0)
        assert starts[1] == (25, 0)
        assert starts[5] == (0, 25)
        assert starts[-1] == (100, 100)

    @pytest.mark.parametrize("robots, edge", [(1, 1), (2, 2), (4, 2), (5, 3), (324, 18), (325, 19)])
    def test_the_last_row_may_be_short_but_nobody_shares_a_place(self, robots, edge):
        scenario = Scenario(robots=robots)
        assert scenario.robots_per_edge == edge
        assert len(set(scenario.starts_m)) == robots
        assert max(map(max, scenario.starts_m)) <= (edge - 1) * scenario.grid_step_m

    def test_or_in_a_line_in_a_ring_or_on_two_islands(self):
        line = Scenario(formation="line", robots=4, grid_step_m=7.0).starts_m
        assert line == [(0, 0), (7, 0), (14, 0), (21, 0)]
        ring = np.array(Scenario(formation="ring", robots=9, grid_step_m=7.0).starts_m)
        assert np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) == pytest.approx(np.full(9, 7.0), abs=0.002)
        assert ring.min() >= 0
        apart = Scenario(formation="islands", robots=9, grid_step_m=7.0)
        here, there = np.array(apart.starts_m[:5]), np.array(apart.starts_m[5:])
        assert here[:, 0].max() == 14
        assert there[:, 0].min() - 14 == 7 + math.ceil(apart.radio.range_m)
        with pytest.raises(UsageError, match="no formation 'circle'"):
            Scenario(formation="circle")

    @pytest.mark.parametrize("formation", ["line", "ring", "islands"])
    @pytest.mark.parametrize("robots", [1, 2, 24, 25])
    def test_nobody_shares_a_place_in_any_of_them(self, formation, robots):
        starts_m = Scenario(formation=formation, robots=robots).starts_m
        assert len(set(starts_m)) == len(starts_m) == robots

    def test_neighbours_provided_for_are_those_in_range_and_half_as_many_again(self):
        assert Scenario().bti.n_max == 24, "all others are in range"
        sparse = Scenario(robots=324, grid_step_m=64.0, bti=BtiConfig(f_max=2))
        assert sparse.bti.n_max == math.ceil(1.5 * math.pi * (116.33 / 64) ** 2) + 4
        assert Scenario(robots=1000, grid_step_m=2.0).bti.n_max == 340
        assert Scenario(robots=2).bti.n_max == BtiConfig().quorum == 5
        assert Scenario(n_max=9).bti.n_max == 9

    def test_the_flock_agrees_with_its_scenario(self):
        scenario = Scenario(
            goal_m=(1.0, 2.0),
            d_m=7.0,
            obstacles=(Disc(x_m=1, y_m=2, radius_m=3), Box(left_m=0, bottom_m=0, right_m=1, top_m=1)),
            flock=FlockConfig(c1_beta=1.0),
            bti=BtiConfig(steps_per_state=3),
        )
        flock = scenario.flock
        assert (flock.goal_m, flock.d_m, flock.n_max, flock.state_every) == ((1.0, 2.0), 7.0, 24, 3)
        assert (len(flock.discs), len(flock.boxes), flock.c1_beta) == (1, 1, 1.0)

    @pytest.mark.parametrize(
        "wrong, complaint",
        [
            ({"robots": 0}, "0 robots"),
            ({"robots": 65_536}, "65536 robots"),
            ({"robots": "x"}, "robots is 'x'"),
            ({"robots": 2.5}, "robots is 2.5"),
            ({"seed": "1"}, "seed is '1'"),
            ({"duration_s": "long"}, "duration_s is 'long'"),
            ({"attacks": ("spoof",)}, "attacks are ('spoof',)"),
            ({"grid_step_m": 0.0}, "grid_step_m is 0"),
            ({"grid_step_m": math.nan}, "grid_step_m is nan"),
            ({"robots": 65_535, "grid_step_m": 1e4}, "the grid's edge"),
            ({"d_m": -1.0}, "d_m is -1"),
            ({"goal_m": (math.inf, 0.0)}, "goal_m is inf"),
            ({"duration_s": 0.0}, "duration_s is 0"),
            ({"defence": "prayer"}, "no defence 'prayer'"),
            ({"controller": "ants"}, "no controller 'ants'"),
            ({"seed": -1}, "seed is -1"),
            ({"seed": 1 << 32}, "seed is 4294967296"),
            ({"contact_m": -1.0}, "contact_m is -1"),
            ({"n_max": 4}, "n_max is 4, less than the quorum of 5 neighbours for f_max 3"),
            ({"attacks": (AttackSpec(name="spoof", robot=26),)}, "spoof in robot 26"),
            ({"attacks": (AttackSpec(name="spoof", robot=3),) * 2}, "two attacks in robot 3"),
            ({"attacks": (SPOOF,) * 3, "robots": 2}, "3 attacks for 2 robots"),
            ({"attacks": (AttackSpec(name="spoff"),)}, "no attack 'spoff'"),
            ({"obstacles": (Disc(x_m=0, y_m=0, radius_m=1),)}, "obstacles have no effect"),
        ],
    )
    def test_what_is_out_of_range_is_refused(self, wrong, complaint):
        with pytest.raises(UsageError, match=re.escape(complaint)) as error:
            Scenario(**wrong)
        assert error.value.hint

    def test_robots_to_compromise_are_drawn_by_the_seed_and_never_twice(self):
        attacks = (AttackSpec(name="spoof", robot=4), *(SPOOF,) * 24)
        drawn = [attack.robot for attack in Scenario(attacks=attacks).drawn_attacks()]
        assert drawn[0] == 4
        assert sorted(drawn) == list(range(1, 26))
        one = [Scenario(attacks=(SPOOF,), seed=seed).drawn_attacks()[0].robot for seed in range(300)]
        assert one == [Scenario(attacks=(SPOOF,), seed=seed).drawn_attacks()[0].robot for seed in range(300)]
        # A fair draw leaves one of 25 out in 300 tries with a chance of 25 * 0.96^300 = 0.0001.
        assert set(one) == set(range(1, 26))
        assert max(np.bincount(one)) < 30

    def test_the_draw_is_the_same_in_every_version(self):
        # From the shell: sha256sum of `compromised 1 ROBOT`, the three smallest.
        drawn = Scenario(attacks=(SPOOF,) * 3, seed=1).drawn_attacks()
        assert [attack.robot for attack in drawn] == [13, 14, 8]


class TestOptions:
    def test_options_change_what_they_say_and_nothing_else(self):
        before = Scenario(seed=3, goal_m=(9.0, 9.0))
        after = before.with_options(robots=324, spacing_m=64.0, duration_s=5.0, f_max=2, t_audit_s=2.5, t_val_s=8.0)
        assert (after.robots, after.grid_step_m, after.d_m, after.duration_s) == (324, 64, 64, 5)
        assert (after.bti.f_max, after.bti.t_audit_ms, after.bti.t_val_ms, after.bti.n_max) == (2, 2500, 8000, 20)
        assert (after.seed, after.goal_m, after.flock.d_m) == (3, (9.0, 9.0), 64)
        assert before.with_options() == before

    def test_neighbours_are_worked_out_again(self):
        few = Scenario(robots=2)
        assert few.with_options(f_max=8).bti.n_max == 10
        assert few.with_options(robots=200).bti.n_max == 107, "68.02 in range"

    def test_audits_too_rare_for_their_tokens_are_refused(self):
        with pytest.raises(UsageError, match="t_val is 10 s"):
            Scenario().with_options(t_audit_s=8)

    @pytest.mark.parametrize("wrong", [math.inf, -math.inf, math.nan, 1e300])
    def test_no_time_is_too_odd_to_be_refused(self, wrong):
        with pytest.raises(UsageError, match="t_audit_s is"):
            Scenario().with_options(t_audit_s=wrong)
        with pytest.raises(UsageError, match="t_val_s is"):
            Scenario().with_options(t_val_s=wrong)

    def test_robots_in_range_are_those_of_the_grid(self):
        assert Scenario(robots=4).robots_in_range == 4
        assert Scenario(robots=1000, grid_step_m=20.0).robots_in_range == pytest.approx(
            math.pi * (116.33 / 20) ** 2, rel=1e-3
        )


class TestAttackWords:
    def test_a_name_alone(self):
        assert parse_attack("spoof") == AttackSpec(name="spoof", robot=None, at_s=15.0, until_s=None, options={})

    def test_robot_times_and_the_attack_s_own_options(self):
        assert parse_attack("spoof:robot=7,at=1.5,until=20,strong=1") == AttackSpec(
            name="spoof", robot=7, at_s=1.5, until_s=20.0, options={"strong": 1.0}
        )

    @pytest.mark.parametrize(
        "words",
        """:
        :at=3
        spoof:
        spoof:at
        spoof:at=
        spoof:=3
        spoof:at=3,
        spoof:at=1,at=2
        spoof:at=x
        spoof:robot=x
        spoof:robot=1.5
        spoof:at=-1
        spoof:at=5,until=5
        spoof:until=nan
        spoof:at=inf""".split(),
    )
    def test_what_is_not_of_the_form_is_refused_with_the_form(self, words):
        with pytest.raises(UsageError) as error:
            parse_attack(words)
        assert error.value.hint

    @given(st.text(max_size=40))
    def test_no_words_raise_anything_else(self, words):
        try:
            attack = parse_attack(words)
        except UsageError:
            return
        assert words.startswith(attack.name)
