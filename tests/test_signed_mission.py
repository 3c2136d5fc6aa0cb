"""Evidence does not choose by what it is judged: the owner signs which mission a mission's key is for."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from phalanx.bti.nodes import seal_mission_key
from phalanx.cli.main import run_command
from phalanx.daemon import run as daemon_run
from phalanx.daemon.evidence import record_log
from phalanx.daemon.sealed_air import with_room_for_seals
from phalanx.daemon.settings import read_robot
from phalanx.daemon.signed_mission import digest_of, sign_mission
from phalanx.errors import UsageError
from phalanx.net.keyring import create, open_keyring
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import parse_scenario, written_scenario

TEXT = "robots: 4\ngrid_step_m: 10\nbti: {f_max: 1}\n"
MISSION = parse_scenario(TEXT.encode(), "mission.yaml")
OWNER, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes((k,)) * 32) for k in (1, 2))
WIDER = replace(MISSION, bti=replace(MISSION.bti, t_val_ms=20_000))
WORDS = "some words that nobody guesses"


def public(key):
    return key.public_key().public_bytes_raw().hex()


def test_what_is_signed_is_all_that_robots_have_in_common():
    other = replace(MISSION, name="x", attacks=(AttackSpec(name="hijack"),))
    assert digest_of(MISSION) == digest_of(other) == digest_of(with_room_for_seals(MISSION))
    changed = [
        WIDER,
        replace(MISSION, robots=5),
        replace(MISSION, goal_m=(1.0, 2.0)),
        replace(MISSION, guard=replace(MISSION.guard, turn_radps=1.0)),
        replace(MISSION, gateway_key="11" * 32),
    ]
    assert len({digest_of(each) for each in (MISSION, *changed)}) == 1 + len(changed)


def verified(tmp_path, capsys, *trust, signed=None, scenario=MISSION, mission=7):
    """What `phalanx robot verify` says of an honest log with that in its head, and its code."""
    head = {"robot": 2, "mission": mission, "t_key_ms": 5, "scenario": written_scenario(scenario)}
    head |= {"signed": signed.as_json} if signed else {}
    path = tmp_path / "robot-2.log"
    path.write_bytes(json.dumps(head).encode() + b"\n")
    words = [word for each in trust for word in ("--trust", each)]
    log, recording = ["robot", "verify", str(path), *words], tmp_path / "x.mcap"
    code, said = run_command(log), capsys.readouterr().out
    record_log(path, recording)  # and a recording says the same
    assert run_command(["robot", "verify", str(recording), *words]) == code
    assert capsys.readouterr().out == said
    return code, said


def test_a_log_whose_mission_the_owner_signed_is_judged_by_it(tmp_path, capsys):
    signed = sign_mission(MISSION, 7, OWNER)
    code, said = verified(tmp_path, capsys, signed=signed)
    assert (code, f"its mission was signed by {public(OWNER)}" in said) == (0, True)
    assert verified(tmp_path, capsys, public(OTHER), public(OWNER), signed=signed)[0] == 0
    assert verified(tmp_path, capsys, signed=signed, scenario=replace(MISSION, name="as it was called there"))[0] == 0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"scenario": WIDER}, "NOT THE SIGNED ONE"),
        ({"mission": 8}, "NOT THE SIGNED ONE"),
        ({"signed": replace(sign_mission(WIDER, 7, OWNER), digest=digest_of(MISSION))}, "NOT THE SIGNED ONE"),
        ({"signed": replace(sign_mission(MISSION, 7, OTHER), signer=public(OWNER))}, "NOT THE SIGNED ONE"),
        ({"signed": sign_mission(MISSION, 7, OTHER)}, "WHICH IS NOT TRUSTED"),
        ({"signed": None}, "ITS MISSION IS NOT SIGNED"),
    ],
)
def test_another_mission_than_the_owners_is_told(tmp_path, capsys, wrong, says):
    code, said = verified(tmp_path, capsys, public(OWNER), **({"signed": sign_mission(MISSION, 7, OWNER)} | wrong))
    assert code == 1
    assert says in said


def test_without_a_signature_and_without_trust_it_is_the_logs_own_word(tmp_path, capsys):
    code, said = verified(tmp_path, capsys)
    assert (code, "the robot's claim" in said) == (0, True)


def test_a_robot_begins_no_other_mission_than_was_signed(tmp_path, monkeypatch):
    monkeypatch.setattr(daemon_run, "connect_nodes", lambda _: pytest.fail("opened"))
    sealed = {2: seal_mission_key(bytes(20), bytes(20), bytes(20), 7)}
    (tmp_path / "key.json").write_bytes(encode_mission_key_file(7, sealed, {}, sign_mission(MISSION, 7, OWNER).as_json))
    radio = {"here": "127.0.0.1:4410", "peers": ["127.0.0.1:4411"]}
    said = {"robot": 2, "mission": "mission.yaml", "key": "key.json", "driver": "python:x.py", "radio": radio}
    (tmp_path / "robot.yaml").write_text(json.dumps(said))
    (tmp_path / "mission.yaml").write_text(TEXT.replace("f_max: 1", "f_max: 2"))
    with pytest.raises(UsageError, match=r"issued for another mission than mission\.yaml"):
        asyncio.run(daemon_run.run_robot(read_robot(tmp_path / "robot.yaml")))
    (tmp_path / "mission.yaml").write_text(TEXT)
    with pytest.raises(pytest.fail.Exception, match="opened"):
        asyncio.run(daemon_run.run_robot(read_robot(tmp_path / "robot.yaml")))
    for rubbish in (b'{"mission": 7, "signed": 1}', b'{"mission": 7, "signed": {"number": 7}}', b"[]", b"\0"):
        (tmp_path / "key.json").write_bytes(rubbish)
        with pytest.raises(UsageError, match="not a mission key"):
            asyncio.run(daemon_run.run_robot(read_robot(tmp_path / "robot.yaml")))


def test_who_signed_is_told_whatever_controller_the_log_is_tried_with(tmp_path, capsys):
    signed = sign_mission(MISSION, 7, OWNER)
    verified(tmp_path, capsys, signed=signed)
    for more in ([], ["--controller", "wheels"]):
        run_command(["robot", "verify", str(tmp_path / "robot-2.log"), "--json", *more])
        assert json.loads(capsys.readouterr().out)["mission_signer"] == public(OWNER)


def test_keys_issue_signs_it_and_export_gives_what_checks_it(tmp_path, capsys):
    ring, words, out, checks = (tmp_path / name for name in ("lab.keys", "words", "mission.json", "missions.pem"))
    words.write_text(WORDS)
    create(ring, "lab", WORDS)
    with open_keyring(ring, WORDS) as keys:
        keys.provision(2, "2026-01-01")
    (tmp_path / "mission.yaml").write_text(TEXT)
    said = ["--passphrase-file", str(words)]
    issue = ["keys", "issue", str(ring), "--out", str(out), *said]
    assert run_command([*issue, "--mission", str(tmp_path / "nothing.yaml")]) == 2
    empty = tmp_path / "empty.yaml"
    empty.write_text(
        f'controller: wheels\nrobots: 3\ngrid_step_m: 0.6\narea_m: [2, 2]\ngateway_key: "{"ab" * 32}"\noperator_key: ""\n'
    )
    assert run_command([*issue, "--mission", str(empty)]) == 2
    assert "has no gateway_key and operator_key" in capsys.readouterr().err
    assert not out.exists()
    assert run_command([*issue, "--mission", str(tmp_path / "mission.yaml")]) == 0
    assert run_command(["keys", "export", str(ring), "missions", "--public", "--out", str(checks), *said]) == 0
    told = json.loads(out.read_text())
    assert told["mission"] == 1, "a mistake used up a number"
    signed = sign_mission(MISSION, 1, OWNER)
    signed = replace(signed, **{name: told["signed"][name] for name in ("number", "digest", "signer", "signature")})
    capsys.readouterr()
    assert verified(tmp_path, capsys, str(checks), signed=signed, mission=1)[0] == 0
