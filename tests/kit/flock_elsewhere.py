"""A flock whose trusted nodes are elsewhere: the run, and whether two are the same."""

from __future__ import annotations

from phalanx.bti.nodes import Nodes
from phalanx.config import BtiConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

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
