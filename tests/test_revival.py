"""A stopped robot of the simulation begins anew with its honest controller, and the others vouch for it."""

from __future__ import annotations

import json
import subprocess
import time
import urllib.error
import urllib.request

import pytest

from commands import a_gateway, called
from phalanx.errors import Unknown
from phalanx.world.swarms.protected import ProtectedSwarm

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


def asked(ready: dict, what: str, **words: str) -> tuple[int, dict]:
    """Return the answer to an operator's request, asked on this machine."""
    page, token = ready["operator_url"].split("#token=")
    body = json.dumps(words).encode()
    request = urllib.request.Request(f"{page}api/link/{what}", body, {"Authorization": f"Bearer {token}"})
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def until(holds, timeout_s=60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def revive(robot: str, state) -> subprocess.CompletedProcess:
    return called("link", "revive", robot, "--state", str(state))


@pytest.mark.waits
def test_by_hand_and_by_itself_at_a_gateway(tmp_path):
    state = tmp_path / "state"
    with a_gateway("--defence", "hardened", "--robots", "6", "--state", str(state)) as (up, ready):
        robot = asked(ready, "state")[1]["robots"][0]
        refused = revive(robot["name"], state)
        assert (refused.returncode, "is not stopped" in refused.stderr) == (2, True), refused.stderr
        assert asked(ready, "compromise", address=robot["address"], attack="hijack")[0] == 200
        assert up.wait_for("safe_mode")["address"] == robot["address"]
        done = revive(robot["name"], state)
        assert (done.returncode, "begins anew" in done.stdout) == (0, True), done.stderr
        assert up.wait_for("revived")["address"] == robot["address"]
        until(lambda: not asked(ready, "state")[1]["shields"]["robots"][robot["address"]]["safe_mode"])
        assert asked(ready, "state")[1]["shields"]["robots"][robot["address"]]["lie"] is None
    assert '"event":"revived"' in (state / "trail.jsonl").read_text().replace(" ", "")
    with a_gateway("--defence", "hardened", "--robots", "6", "--revive", "1") as (up, ready):
        assert asked(ready, "compromise", address=robot["address"], attack="hijack")[0] == 200
        assert up.wait_for("revived")["address"] == robot["address"]


def test_only_a_simulation_revives():
    done = called("up", "--port", "0", "--events", "--revive", "5", "--defence", "none")
    assert (done.returncode, "new mission key" in done.stderr) == (2, True), done.stderr
    assert "Traceback" not in done.stderr
