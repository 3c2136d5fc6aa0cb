"""`phalanx up --keys`: a simulated swarm whose trusted nodes and station have its owner's keys, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commands import called
from phalanx.bti import trusted
from phalanx.bti.fleet import START
from phalanx.cli import up as command
from phalanx.crypto import keys as sealing
from phalanx.daemon.proofs import unsealed
from phalanx.errors import UsageError
from phalanx.gateway.demo import plan_swarm
from phalanx.net.keyring import Keys, create, open_keyring
from phalanx.wire.fields import row
from phalanx.wire.table import MAC_BYTES, TOKEN
from phalanx.world.swarms.protected import ProtectedSwarm, SwarmKeys

ROBOTS = 4
WORDS = "correct horse battery staple"


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(sealing, "LOG2_N", 4)


@pytest.fixture
def owned(tmp_path):
    """A file of keys with robots 1 to 4 in it, and the words that open it."""
    create(tmp_path / "lab.keys", "lab", WORDS)
    with open_keyring(tmp_path / "lab.keys", WORDS) as keys:
        for robot in range(1, ROBOTS + 1):
            keys.provision(robot, "2026-11-27")
    (tmp_path / "words").write_text(WORDS + "\n")
    return tmp_path / "lab.keys", ("--passphrase-file", str(tmp_path / "words"))


def missions(path) -> int:
    with open_keyring(path, WORDS) as keys:
        return keys.missions


def mac_of(key: bytes, message: bytes) -> bytes:
    mac = np.zeros(MAC_BYTES, np.uint8)
    trusted.lightmac(row(key), row(message), len(message), mac)
    return mac.tobytes()


class TestSwarm:
    def test_its_tokens_are_made_with_its_owners_mission_key_and_it_obeys_its_owners_orders(self, owned):
        path, _ = owned
        with open_keyring(path, WORDS) as keys:
            keys.missions = 6
        given = command.keys_for_next_mission(path, path.with_name("words"), plan_swarm(ROBOTS, None, None))
        assert missions(path) == given.mission == 7
        swarm = ProtectedSwarm(ROBOTS, 0, lambda: 1.7e9, f_max=1, keys=given)
        address, before = swarm.robots()[0].address, swarm.robots()[0].at
        for _ in range(60):
            swarm.drive(address, 60, 60)
            swarm.step(0.2)
        after = swarm.robots()[0].at
        assert math.dist((before.x_mm, before.y_mm), (after.x_mm, after.y_mm)) > 100
        assert not any(shield.safe_mode for shield in swarm.shields())
        fleet = swarm.world.fleet
        for i, (master, sealed) in enumerate(given.boards):
            key, token = unsealed(master, sealed), fleet.token[i, START, 0]
            told = TOKEN.encode(
                auditor=int(token.auditor), auditee=i + 1, t=int(token.t), hckpt=fleet.hckpt[i, START].tobytes()
            )
            assert token.mac.tobytes() == mac_of(key, told)

    def test_it_hears_nobody_who_signs_with_other_keys_or_for_another_mission(self, owned):
        path, _ = owned
        given = command.keys_for_next_mission(path, path.with_name("words"), plan_swarm(ROBOTS, None, None))
        other = Keys.new("other")
        for station in (
            SwarmKeys(given.mission, given.boards, other.signer("orders"), other.signer("stops")),
            SwarmKeys(given.mission + 1, given.boards, given.gateway, given.operator),
        ):
            swarm = ProtectedSwarm(ROBOTS, 0, lambda: 1.7e9, f_max=1, keys=given)
            swarm._station = ProtectedSwarm(ROBOTS, 0, lambda: 1.7e9, f_max=1, keys=station)._station
            robot = swarm.robots()[0]
            for _ in range(20):
                swarm.drive(robot.address, 60, 60)
                swarm.step(0.1)
            assert swarm.robots()[0].at == robot.at

    def test_no_key_is_printed(self, owned):
        path, _ = owned
        given = command.keys_for_next_mission(path, path.with_name("words"), plan_swarm(ROBOTS, None, None))
        shown = repr(given) + str(given)
        assert all(master.hex() not in shown and repr(master) not in shown for master, _ in given.boards)


class TestMistakes:
    @pytest.mark.parametrize(
        ("words", "told"),
        [
            (("--robots", "5"), "robot 5 has no master key"),
            (("--robots", "3"), "--keys without audits"),
            (("--robots", "4", "--defence", "none"), "--keys without audits"),
            (("--mission", "office"), "--keys with --mission"),
            (("--swarm", "robots.yaml"), "--swarm with --keys"),
            (("--robots", "4", "--scenario", "patroll"), "wheeled robots cannot do 'patroll'"),
        ],
    )
    def test_each_is_a_line_and_no_mission_is_used_up(self, owned, words, told):
        path, said = owned
        done = called("up", "--keys", str(path), *said, *words)
        assert done.returncode == 2
        assert done.stderr.splitlines()[0] == f"phalanx: error: {told}"
        assert missions(path) == 0

    def test_a_passphrase_for_no_keys(self, owned):
        assert "--passphrase-file without --keys" in called("up", *owned[1]).stderr

    def test_a_wrong_passphrase(self, owned, tmp_path):
        (tmp_path / "wrong").write_text("another horse\n")
        done = called("up", "--keys", str(owned[0]), "--passphrase-file", str(tmp_path / "wrong"), "--robots", "4")
        assert "wrong passphrase for" in done.stderr.splitlines()[0]

    def test_a_robot_that_was_retired(self, owned):
        path, _ = owned
        with open_keyring(path, WORDS) as keys:
            keys.retire(3, "2026-11-27")
        with pytest.raises(UsageError, match="robot 3 was retired on 2026-11-27"):
            command.keys_for_next_mission(path, path.with_name("words"), plan_swarm(ROBOTS, None, None))
        assert missions(path) == 0
