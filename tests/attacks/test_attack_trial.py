"""What a trial of an attack promises, and when it says that a promise was not kept."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from trials import AT_S, F_MAX, scenario

from phalanx.attacks import IN_FLOCKS
from phalanx.errors import UsageError
from phalanx.lab.scorecard.flock_trial import Airtime, FlockTrial, Stop, airtime_since, sent, trial_fields, try_attack
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.world.scenarios.run import Run

TOLD = {"duration_s": 60.0}
SAME = {"harm": 0.0, "attacked": TOLD, "honest": TOLD, "honest_distance_m": 0.0, "stops": ()}
STOPPED = FlockTrial(**trial_fields(IN_FLOCKS["crash"], "hardened"), **SAME, bound_s=10.101, missing_s=0.15)
LIMITED = FlockTrial(**trial_fields(IN_FLOCKS["frame-flood"], "hardened"), **SAME, bound_s=None)


@pytest.mark.parametrize(
    "after_s, output_missing, kept",
    [(10.101, False, True), (10.102, False, False), (10.102, True, True), (10.251, True, True), (10.252, True, False)],
)
def test_only_who_left_something_out_has_the_time_until_it_is_missed(after_s, output_missing, kept):
    trial = replace(STOPPED, stops=(Stop(1, 0.0, after_s, output_missing),))
    assert trial.stopped_in_time is kept
    assert trial.broken is not kept


@pytest.mark.parametrize("used_s, kept", [(0.2, True), (0.2001, False)])
def test_more_airtime_than_a_bucket_has_is_a_broken_promise(used_s, kept):
    trial = replace(LIMITED, airtime=(Airtime(1, 24.0, 0.1, 0.2, 0.1), Airtime(2, 24.0, used_s, 0.2, 0.1)))
    assert trial.within_buckets is kept
    assert trial.broken is not kept
    assert trial.stopped_in_time is None


@pytest.mark.parametrize("wronged, broken", [(None, False), ((), False), ((3,), True)])
def test_a_correct_robot_that_is_stopped_is_a_broken_promise(wronged, broken):
    assert replace(STOPPED, wronged=wronged).broken is broken


def test_with_more_than_f_max_liars_nothing_is_promised():
    crowd = [AttackSpec(name="crash", at_s=1.0)] * (F_MAX + 1)
    told = [try_attack(scenario("hardened", *liars, end_s=2)) for liars in (crowd, crowd[1:])]
    assert [(trial.bound_s, trial.wronged) for trial in told] == [(None, None), (10.101, ())]


def test_a_robot_is_on_the_air_for_as_long_as_its_frames_take():
    """A HELLO each round and requests: an a-node and the radio agree within the radio's rounding, if nothing is lost."""
    run = Run(scenario("hardened"))
    run.advance(AT_S)
    before = [sent(run, i) for i in range(12)]
    run.advance(AT_S + 8)
    for i in range(12):
        airtime = airtime_since(run, i, before[i])
        assert (airtime.robot, airtime.seconds) == (i + 1, 8.0)
        assert 0 < airtime.used_s < airtime.bucket_s / 3, "an honest robot needs less than half of it"
        states_s = 8 / 1.5 * 148e-6
        assert airtime.on_air_s == pytest.approx(airtime.used_s + states_s, rel=0.15)


def test_every_option_of_every_attack_is_taken_with_each_of_its_values_and_no_other():
    assert {name for name, kind in IN_FLOCKS.items() if kind.options} == {"spoof", "relay-hello"}
    for kind in IN_FLOCKS.values():
        for name, option in kind.options.items():
            for value in option.values:
                kind.check({name: value})
            for value in (7.5,) if option.values else (option.least - 0.01, math.nan, math.inf, "often"):
                with pytest.raises(UsageError, match=f"option {name} of attack {kind.name} is "):
                    kind.check({name: value})
            if not option.values:
                kind.check({name: 7.5})
        with pytest.raises(UsageError, match="no option 'nothing'"):
            kind.check({"nothing": 1.0})
