"""A stopped robot of the simulation begins anew with its honest controller, and the others vouch for it."""

from __future__ import annotations

import subprocess

import pytest

from commands import a_gateway, called
from operator_api import asked, state_of
from phalanx.errors import Unknown
from phalanx.world.swarms.protected import ProtectedSwarm
from waiting import wait_until

STEP_S = 0.1


def live(swarm: ProtectedSwarm, seconds: float) -> list:
    """What audits were refused meanwhile."""
    refused = []
    for _ in range(round(seconds / STEP_S)):
        swarm.step(STEP_S)
        refused += [audit for audit in swarm.new_audits() if audit.refusal]
    return refused


def stopped(swarm: ProtectedSwarm, address: str, attack: str = "hijack") -> None:
    live(swarm, 5.0)
    swarm.compromise(address, attack)
    for _ in range(15):
        live(swarm, 1.0)
        if swarm.shields()[0].safe_mode:
            return
    pytest.fail("it was not stopped")


@pytest.mark.parametrize("protocol, defence", [("", "hardened"), ("patrol", "hardened"), ("", "paper")])
def test_it_is_vouched_for_driven_and_stopped_again(protocol, defence):
    swarm = ProtectedSwarm(9, 0, lambda: 0.0, protocol=protocol, keeps_apart=bool(protocol), defence=defence)
    address = swarm.robots()[0].address
    for _ in range(2):
        stopped(swarm, address)
        swarm.revive(address)
        assert swarm.shields()[0].safe_mode, "its last round has to be over"
        live(swarm, 6.0)
        shield = swarm.shields()[0]
        assert not shield.safe_mode
        assert shield.attack == ""
        assert live(swarm, 25.0) == [], "nobody refuses it, nor does it refuse anybody"
        shield = swarm.shields()[0]
        assert len(shield.vouchers) >= shield.needed
        assert not swarm.world.safe.any()
        swarm.drive(address, 30, -30)
        live(swarm, 0.2)
        assert swarm.world.acc[0].tolist() == [0.3, -0.3], "it obeys visitors"


def test_only_one_that_is_stopped_is_revived():
    swarm = ProtectedSwarm(9, 0, lambda: 0.0)
    address = swarm.robots()[0].address
    with pytest.raises(Unknown, match="is not stopped"):
        swarm.revive(address)
    with pytest.raises(Unknown):
        swarm.revive("0" * 16)


def revive(robot: str, state) -> subprocess.CompletedProcess:
    return called("link", "revive", robot, "--state", str(state))


@pytest.mark.waits
def test_by_hand_and_by_itself_at_a_gateway(tmp_path):
    state = tmp_path / "state"
    with a_gateway("--defence", "hardened", "--robots", "6", "--state", str(state)) as (up, ready):
        robot = state_of(ready)["robots"][0]
        hijack = {"address": robot["address"], "attack": "hijack"}
        refused = revive(robot["name"], state)
        assert (refused.returncode, "is not stopped" in refused.stderr) == (1, True), refused.stderr
        assert asked(ready, "compromise", hijack)[0] == 200
        assert up.wait_for("safe_mode")["address"] == robot["address"]
        done = revive(robot["name"], state)
        assert (done.returncode, "restarts" in done.stdout) == (0, True), done.stderr
        assert up.wait_for("revived")["address"] == robot["address"]
        wait_until(lambda: not state_of(ready)["shields"]["robots"][robot["address"]]["safe_mode"], 60)
        assert state_of(ready)["shields"]["robots"][robot["address"]]["lie"] is None
    assert '"event":"revived"' in (state / "trail.jsonl").read_text().replace(" ", "")
    with a_gateway("--defence", "hardened", "--robots", "6", "--revive", "1") as (up, ready):
        assert asked(ready, "compromise", hijack)[0] == 200
        assert up.wait_for("revived")["address"] == robot["address"]


def test_only_a_simulation_revives():
    done = called("up", "--port", "0", "--events", "--revive", "5", "--defence", "none")
    assert (done.returncode, "new mission key" in done.stderr) == (2, True), done.stderr
    assert "Traceback" not in done.stderr
