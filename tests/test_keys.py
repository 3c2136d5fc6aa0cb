"""The owner's keys: what real trusted nodes make of them, kills, two at once, and files that are not as they should be."""

from __future__ import annotations

import itertools
import json
import os
import random
import signal
import stat
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asked_nodes import Nodes
from phalanx.bti import trusted
from phalanx.bti.nodes import Limits, MissionKey
from phalanx.cli.main import run_command
from phalanx.config import BtiConfig
from phalanx.crypto import keys as sealing
from phalanx.errors import UsageError
from phalanx.net.keyring import Keys, create, open_keyring
from phalanx.net.private_file import write_private
from phalanx.wire.table import BOARD
from waiting import wait_until

WORDS = "correct horse battery staple"
LIMITS = Limits.of(BtiConfig(), fixed_us=100, ns_per_byte_broadcast=1333, ns_per_byte_unicast=300)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(sealing, "LOG2_N", 4)


@pytest.fixture
def ring(tmp_path):
    create(tmp_path / "lab.keys", "lab", WORDS)
    return tmp_path / "lab.keys"


@pytest.fixture
def said(tmp_path):
    """What a passphrase is said with."""
    path = tmp_path / "words"
    path.write_text(WORDS + "\n")
    return "--passphrase-file", str(path)


def phalanx(capsys, *words: object) -> tuple[int, str, str]:
    code = run_command(["keys", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


class TestRealNodes:
    def test_robots_of_one_mission_believe_each_other_and_a_retired_one_is_left_out(self, ring):
        with open_keyring(ring, WORDS) as keys:
            masters = {robot: keys.provision(robot, "2026-01-01") for robot in (1, 2, 3)}
        assert len(set(masters.values())) == 3, "who is lost must not read the others' mission keys"
        nodes = Nodes(3, trusted.HARDENED, replace(LIMITS, f_max=1))
        for robot, master in masters.items():
            nodes.load_master(robot - 1, master, robot)
        with open_keyring(ring, WORDS) as keys:
            keys.retire(3, "2026-01-02")
            number, sealed = keys.issue()
        assert (number, set(sealed)) == (1, {1, 2})
        for robot in (1, 2):
            nodes.load_mission(robot - 1, 0, sealed[robot])
        with pytest.raises(Exception, match="refused"):
            nodes.load_mission(2, 0, sealed[1])
        nonce = b"question"
        said = nodes.make_auth(0, nonce)
        nodes.check_auth(1, said[:20], 1, nonce, said[22:])

    def test_numbers_only_rise(self, ring):
        with open_keyring(ring, WORDS) as keys:
            keys.provision(1, "2026-01-01")
        numbers = []
        for _ in range(3):
            with open_keyring(ring, WORDS) as keys:
                numbers.append(keys.issue()[0])
        assert numbers == [1, 2, 3]


class TestKilled:
    def test_no_number_is_given_out_twice_whenever_the_process_dies(self, ring, tmp_path):
        with open_keyring(ring, WORDS) as keys:
            keys.provision(1, "2026-01-01")
        chance = random.Random(1)
        given_out = tmp_path / "given"
        given_out.touch()
        for _ in range(30):
            child = os.fork()
            if child == 0:
                with given_out.open("ab", buffering=0) as out:
                    for _ in itertools.count():
                        with open_keyring(ring, WORDS) as keys:
                            number, _ = keys.issue()
                        out.write(b"%d\n" % number)
            wanted = len(given_out.read_bytes().split()) + chance.randrange(3)
            wait_until(lambda wanted=wanted: len(given_out.read_bytes().split()) >= wanted, 60)
            time.sleep(chance.uniform(0, 0.01))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        numbers = [int(line) for line in given_out.read_text().split()]
        assert len(numbers) >= 10, "or little was tried"
        assert numbers == sorted(set(numbers))
        with open_keyring(ring, WORDS) as keys:
            assert keys.missions >= numbers[-1]

    def test_two_at_once_wait_for_each_other(self, ring, tmp_path):
        with open_keyring(ring, WORDS) as keys:
            keys.provision(1, "2026-01-01")
        children = []
        for who in range(2):
            child = os.fork()
            if child == 0:
                numbers = []
                for _ in range(25):
                    with open_keyring(ring, WORDS) as keys:
                        numbers.append(keys.issue()[0])
                (tmp_path / f"of-{who}").write_text(json.dumps(numbers))
                os._exit(0)
            children.append(child)
        assert [os.waitpid(child, 0)[1] for child in children] == [0, 0]
        numbers = [n for who in range(2) for n in json.loads((tmp_path / f"of-{who}").read_text())]
        assert sorted(numbers) == list(range(1, 51))


class TestFiles:
    @given(data=st.data())
    @settings(max_examples=60, deadline=None)
    def test_a_byte_that_changed_is_one_line_and_never_another_key(self, tmp_path_factory, data):
        ring = tmp_path_factory.mktemp("keys") / "lab.keys"
        create(ring, "lab", WORDS)
        text = bytearray(ring.read_bytes())
        at = data.draw(st.integers(0, len(text) - 1))
        text[at] ^= data.draw(st.integers(1, 255))
        ring.write_bytes(text)
        try:
            with open_keyring(ring, WORDS) as keys:
                assert keys.name == "lab"  # a space that became a tab
        except UsageError as error:
            assert str(ring) in str(error)
            assert "\n" not in str(error)

    @pytest.mark.parametrize(
        "text", [b"", b"{}", b"[" * 100_000, b"\xff" * 40, b'{"form": 1, "sealed": "", "sha256": ""}']
    )
    def test_what_is_no_file_of_keys_is_said_before_the_passphrase_costs_anything(self, ring, text, monkeypatch):
        ring.write_bytes(text)
        monkeypatch.setattr(sealing, "scrypt", None)
        with pytest.raises(UsageError, match="is damaged"), open_keyring(ring, WORDS):
            pass

    def test_another_passphrase_and_others_who_may_read(self, ring):
        with pytest.raises(UsageError, match="wrong passphrase"), open_keyring(ring, "another one altogether"):
            pass
        ring.chmod(0o640)
        with pytest.raises(UsageError, match="other users may read"), open_keyring(ring, WORDS):
            pass

    def test_it_is_for_its_owner_alone_and_says_no_secret(self, ring):
        assert stat.S_IMODE(ring.stat().st_mode) == 0o600
        with open_keyring(ring, WORDS) as keys:
            assert repr(keys) == "<Keys of lab>"
            assert keys.root.hex() not in ring.read_text()

    def test_nothing_that_is_there_is_overwritten(self, ring, tmp_path):
        with pytest.raises(UsageError, match="exists already"):
            create(ring, "lab", WORDS)
        with pytest.raises(UsageError, match="exists already"):
            write_private(ring, b"")
        link = tmp_path / "link.keys"
        link.symlink_to(tmp_path / "elsewhere")
        with pytest.raises(UsageError):
            create(link, "lab", WORDS)
        assert not [
            path for path in tmp_path.iterdir() if path.name.startswith(".link.keys.") and path.suffix != ".lock"
        ]

    def test_what_is_sealed_is_what_is_read(self):
        keys = Keys.new("lab")
        keys.provision(65535, "2026-01-01")
        assert Keys.parse(keys.plain()) == keys


class TestCommands:
    def test_from_creation_to_a_key_for_each_robot(self, tmp_path, said, capsys):
        ring, board, out = (tmp_path / name for name in ("lab.keys", "7.bin", "mission.json"))
        assert phalanx(capsys, "create", ring, *said)[0] == 0
        assert phalanx(capsys, "issue", ring, "--out", out, *said)[0] == 2, "nobody has a key yet"
        assert phalanx(capsys, "provision", ring, 7, "--out", board, *said)[0] == 0
        code, _, err = phalanx(capsys, "provision", ring, 7, "--out", tmp_path / "again.bin", *said)
        assert (code, "got its master key" in err) == (2, True)
        assert not (tmp_path / "again.bin").exists()
        assert phalanx(capsys, "rotate", ring, "--out", out, *said)[0] == 0
        told = json.loads(out.read_text())
        sealed = {name: bytes.fromhex(value) for name, value in told["robots"]["7"].items()}
        nodes = Nodes(1, trusted.HARDENED, LIMITS)
        raw = board.read_bytes()
        made = BOARD.decode(raw)
        nodes.load_master(0, made["master"], made["id"])
        nodes.load_mission(0, 0, MissionKey(seq=told["mission"], **sealed))
        code, listed, _ = phalanx(capsys, "list", ring, "--json", *said)
        assert json.loads(listed)["missions"] == 1
        assert raw[2:].hex() not in listed + out.read_text()

    @pytest.mark.parametrize("who", ["orders", "stops", "advice"])
    def test_a_mission_that_names_keys_which_are_replaced_is_not_signed(self, ring, tmp_path, said, capsys, who):
        mission, out = tmp_path / "mission.yaml", tmp_path / "mission.json"
        words = ("--rotate", "--mission", mission, "--out", out, *said)
        assert phalanx(capsys, "provision", ring, 7, "--out", tmp_path / "7.bin", *said)[0] == 0
        listed = json.loads(phalanx(capsys, "list", ring, "--json", *said)[1])
        public = listed["signers"][who]
        names = {"orders": f"gateway_key: {public}", "stops": f"operator_key: {public}"}
        names["advice"] = f"guard: {{adviser_key: {public}}}"
        mission.write_text(f"robots: 2\nbti: {{f_max: 1}}\n{names[who]}\n")
        code, _, err = phalanx(capsys, "issue", ring, *words)
        assert (code, f"names the key that signs {who}, which --rotate replaces" in err) == (2, True)
        assert not out.exists()
        after = json.loads(phalanx(capsys, "list", ring, "--json", *said)[1])
        assert (after["signers"], after["missions"]) == (listed["signers"], listed["missions"])
        assert phalanx(capsys, "issue", ring, *words[1:])[0] == 0

    def test_a_signing_key_signs_a_mission_and_the_public_one_checks_it(self, ring, tmp_path, said, capsys):
        pem, public, made = (tmp_path / name for name in ("sign.pem", "sign.pub", "office.phxm"))
        assert phalanx(capsys, "export", ring, "missions", "--out", pem, *said)[0] == 0
        assert phalanx(capsys, "export", ring, "missions", "--public", "--out", public, *said)[0] == 0
        assert stat.S_IMODE(pem.stat().st_mode) == 0o600
        build = ["mission", "build", "office", "--profile", "paper", "--out", str(made), "--sign-key", str(pem)]
        assert run_command(build) == 0
        assert run_command(["mission", "verify", str(made), "--trust", str(public)]) == 0

    def test_a_new_passphrase_opens_it_and_the_old_one_does_not(self, ring, tmp_path, said, capsys):
        new = tmp_path / "new"
        new.write_text("another one altogether")
        assert phalanx(capsys, "passphrase", ring, "--new-passphrase-file", new, *said)[0] == 0
        assert phalanx(capsys, "list", ring, *said)[0] == 2
        assert phalanx(capsys, "list", ring, "--passphrase-file", new)[0] == 0

    @pytest.mark.parametrize("words", ["", "short"])
    def test_a_passphrase_that_is_none_is_refused(self, tmp_path, words, capsys):
        (tmp_path / "words").write_text(words)
        code, _, err = phalanx(capsys, "create", tmp_path / "x.keys", "--passphrase-file", tmp_path / "words")
        assert (code, err.count("\n")) == (2, 2)
        assert not Path(tmp_path / "x.keys").exists()
        assert not words or words not in err.replace("passphrase", "")
