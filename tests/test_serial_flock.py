"""A flock whose trusted nodes are elsewhere is the same flock: the same logs, audits and digest."""

from __future__ import annotations

import numpy as np
import pytest

import boards
from phalanx.bti import elsewhere, trusted
from phalanx.bti.nodes import Nodes
from phalanx.config import BtiConfig
from phalanx.errors import Unavailable
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]
# One lies from its sixth second on: it is audited, refused and stopped by its own a-node.
FLOCK = Scenario(
    robots=4, duration_s=18.0, bti=BtiConfig(f_max=1), attacks=(AttackSpec(name="spoof", robot=2, at_s=6.0),)
)


def played(make_nodes=Nodes, scenario=FLOCK) -> Run:
    run = Run(scenario, make_nodes=make_nodes)
    run.advance(scenario.duration_s)
    return run


def same(run: Run, other: Run) -> None:
    """Two runs are the same to the byte, but for where the nodes are."""
    ours, theirs = run.summary(), other.summary()
    for said in (ours, theirs):
        said.pop("real_time_factor")
    assert ours == theirs
    fleet, others = run.world.fleet, other.world.fleet
    for name in ("robot", "log", "state", "checkpoint", "hckpt", "token", "peer", "peer_id", "taken"):
        assert getattr(fleet, name).tobytes() == getattr(others, name).tobytes(), name
    assert fleet.request.rows.tobytes() == others.request.rows.tobytes()


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
    row = elsewhere.place([None])
    assert row.shape == (1, trusted.ELSEWHERE_BYTES)
    elsewhere.forget(row)
    nobody = np.zeros(8, np.uint8)
    assert (
        trusted.anode_issue_token.py_func(
            0, row[0], 1, 2, np.zeros(20, np.uint8), nobody, np.zeros(20, np.uint8), nobody
        )
        < 0
    )
    with pytest.raises(KeyError):
        elsewhere.raise_failed()
