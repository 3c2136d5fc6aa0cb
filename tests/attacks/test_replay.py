"""Replay is exact: the same verdicts and the same bytes compiled and not, in another process, from every checkpoint."""

from __future__ import annotations

import numpy as np
import pytest
from caught import Caught, length_of
from trials import run, scenario

from phalanx.bti import request
from phalanx.bti.refusal import Refusal
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run


# All the way takes 150 s.
@pytest.fixture(scope="module", params=[60.0, pytest.param(150.0, marks=pytest.mark.long)])
def flight_s(request):
    return request.param


@pytest.fixture(scope="module")
def flight(flight_s):
    """25 robots from their grid towards the goal, without liars: all requests that were the last of their round."""
    return Caught(Run(Scenario(name="flight", seed=7)), flight_s)


def starts(flight, robot: int) -> set[bytes]:
    """The checkpoints at which a robot's logs began."""
    found = set()
    for auditee, _, q in flight.requests:
        if auditee == robot:
            row = np.frombuffer(q, np.uint8)
            segment = int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little")
            at = request.HEAD_BYTES + request.TOKEN_BYTES * q[request.AT_TOKENS]
            found.add(q[at : length_of(row) - segment])
    return found


def test_every_log_of_a_flight_replays(flight, flight_s):
    assert len(flight.requests) > 25 * flight_s / 4 * 0.9
    assert {flight.judge(*each)[0] for each in flight.requests} == {Refusal.NONE}


# Every seventh is from every robot, and each robot's from every seventh of its rounds.
@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.long)])
def test_from_every_checkpoint_of_every_robot_uncompiled_and_elsewhere_the_same_state_comes_out(
    flight, flight_s, tmp_path, step
):
    here = [flight.judge(*each) for each in flight.requests]
    for robot, row in enumerate(flight.judge.fleet.robot):
        begun = len(starts(flight, robot))
        assert begun == row.round_no > flight_s / 4 - 2.5  # as many as it had rounds: none is left out
        ended = {state for (auditee, *_), (_, state) in zip(flight.requests, here) if auditee == robot}
        assert len(ended) >= begun  # and every one leads elsewhere
    chosen = slice(0, None, step)
    assert {auditee for auditee, *_ in flight.requests[chosen]} == set(range(25))
    assert flight.judge.elsewhere(flight.requests[chosen], tmp_path) == [
        (no, state.hex()) for no, state in here[chosen]
    ]


def test_a_bit_of_a_command_is_found_compiled_and_not(flight, tmp_path):
    """With chains and authenticators as they are, so that the first check to fail may be another."""
    forged = []
    for auditee, auditor, q in flight.requests[200:208]:
        made = bytearray(q)
        made[-20] ^= 1
        forged.append((auditee, auditor, bytes(made)))
    here = [flight.judge(*each)[0] for each in forged]
    assert 0 not in here
    assert [refused for refused, _ in flight.judge.elsewhere(forged, tmp_path)] == here


@pytest.mark.parametrize("defence", ["none", "paper", "hardened"])
def test_the_same_seed_gives_the_same_bytes_and_another_others(defence):
    liar = AttackSpec(name="spoof", at_s=5.0)
    digests = [run(scenario(defence, liar, end_s=20, seed=seed)).summary()["digest"] for seed in (4, 4, 5)]
    assert digests[0] == digests[1] != digests[2]
