"""A flock whose trusted nodes are elsewhere is the same flock: the same logs, audits and digest."""

from __future__ import annotations

import numpy as np
import pytest

import boards
from flock_elsewhere import FLOCK, played, same
from phalanx.bti import elsewhere, trusted
from phalanx.errors import Unavailable
from phalanx.world.scenarios.run import Run

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]


def test_nodes_in_processes_give_the_same_logs_audits_and_digest(tmp_path):
    with boards.benches(tmp_path, FLOCK.robots) as made:
        there = played(lambda n, _profile, limits: boards.SerialNodes(made, n, limits))
    here = played()
    same(there, here)
    summary = here.summary()
    assert summary["compromised"][0]["safe_mode_s"] is not None, "else nothing was audited that could be refused"
    assert summary["correct_in_safe_mode"] == []
    assert here.world.fleet.robot["audits_passed"].sum() > 0
    assert here.world.fleet.robot["audits_refused"].sum() > 0


def test_a_board_that_goes_in_the_middle_of_a_run_ends_it_with_one_clear_error(tmp_path):
    with boards.benches(tmp_path, FLOCK.robots) as made:
        run = Run(FLOCK, make_nodes=lambda n, _profile, limits: boards.SerialNodes(made, n, limits))
        run.advance(1.0)
        made[2]._line.process.kill()
        with pytest.raises(Unavailable, match="flash-2 is gone"):
            run.advance(2.0)
        assert elsewhere._failed == []


def test_every_function_of_a_node_that_is_here_has_one_that_is_elsewhere():
    assert set(trusted.ELSEWHERE) == {each.__name__ for each in elsewhere.FUNCTIONS}
    row = elsewhere.register_remote([None])
    assert row.shape == (1, trusted.ELSEWHERE_BYTES)
    elsewhere.unregister_remote(row)
    nobody = np.zeros(8, np.uint8)
    assert (
        trusted.anode_issue_token.py_func(
            0, row[0], 1, 2, np.zeros(20, np.uint8), nobody, np.zeros(20, np.uint8), nobody
        )
        < 0
    )
    with pytest.raises(KeyError):
        elsewhere.raise_failed()
