"""A second processor does what robots do alone, in the order in which it was given; results are those of one."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from phalanx.bti.memo import COUNT_WORDS, foretold, make_memo
from phalanx.config import BtiConfig
from phalanx.sim.audited import loop
from phalanx.sim.audited.errands import DONE, FORETOLD, GIVEN, MESSAGE, ROOM, give, make_errands, wait_for_all
from phalanx.sim.audited.second import Second
from phalanx.sim.radio.channel import BROADCAST
from phalanx.sim.scenarios.attack_spec import AttackSpec
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import Scenario

SWARM = Scenario(robots=9, duration_s=9.0, bti=BtiConfig(f_max=1))


def ended(scenario, cores):
    run = Run(scenario, cores=cores)
    run.advance(scenario.duration_s / 2)
    run.advance(scenario.duration_s)
    return run


@pytest.mark.parametrize("defence", ["none", "paper", "bound"])
def test_results_are_those_of_one_processor(defence):
    scenario = replace(SWARM, defence=defence, attacks=(AttackSpec(name="spoof", robot=5, at_s=2.0),))
    one, two = (ended(scenario, cores) for cores in (1, 2))
    said = [{name: value for name, value in run.summary().items() if name != "real_time_factor"} for run in (one, two)]
    assert said[0] == said[1]
    assert one.world.errands.counts[GIVEN] == 0
    # Eight robots decide four times a second, and most of them hear the others.
    assert two.world.errands.counts[GIVEN] == two.world.errands.counts[DONE] > 8 * 9 * 4
    assert (two.world.errands.counts[FORETOLD] > 8) == (defence != "none")


def test_errands_are_done_in_their_order_however_slowly_and_each_keeps_its_frame():
    errands = make_errands(7, np.zeros(COUNT_WORDS, np.int64))
    total, seen = 2 * ROOM + 5, []

    def do() -> None:
        while len(seen) < total:
            while errands.counts[GIVEN] == len(seen):
                time.sleep(0)
            errand = errands.errand[len(seen) % ROOM]
            seen.append((int(errand.robot), int(errand.now_us), errand.frame[: errand.length].tolist()))
            errands.counts[DONE] = len(seen)

    thread = threading.Thread(target=do)
    thread.start()
    for k in range(total):
        give(errands, MESSAGE, k % 7, k, np.full(3, k % 251, np.uint8), 3)
    wait_for_all(errands)
    assert len(seen) == total
    thread.join()
    assert seen == [(k % 7, k, [k % 251] * 3) for k in range(total)]
    assert errands.last.tolist() == [max(k for k in range(total) if k % 7 == i) + 1 for i in range(7)]


def test_a_verdict_is_that_of_the_very_bytes():
    memo, q = make_memo(4, 100, 50, 60), np.arange(100, dtype=np.uint8)
    known = memo.foretold
    known.shown[2, :10] = q[:10]
    known.told[2].number, known.told[2].tee, known.told[2].length, known.told[2].refused = 1, 3, 10, 7
    known.place[:] = 2
    known.counts[DONE] = 1
    for look in (foretold, foretold.py_func):
        assert look(memo, q, 10, 3) == 7
        assert look(memo, q, 11, 3) == -1
        assert look(memo, q, 10, 2) == -1
        assert look(memo, q, 10, 5) == -1
        assert look(memo, q[::-1].copy(), 10, 3) == -1


def test_who_said_that_it_would_be_silent_and_is_not_ends_the_run():
    run = Run(SWARM)
    second = Second(run.world, run.scenario.bti)
    with second.working():
        pass
    frame = np.ones(20, np.uint8)
    assert loop.transmit(second._world, 0, frame, 20, BROADCAST) == -1
    with pytest.raises(AssertionError, match="said something"), second.working():
        pass
