"""The vectors of sessions that TypeScript runs too, and that they are what their script writes."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from phalanx.config.session import SessionConfig
from phalanx.errors import PhalanxError
from phalanx.link.session import Invitation, Kind, Secret, SessionClient, parse_invitation
from phalanx.link.session.events import Replied, SetTopics, Transmit
from phalanx.link.session.messages import Epoch, decode_from_client, decode_from_server, encode
from phalanx.link.session.noise import Cipher
from phalanx.link.session.padding import pad, unpad
from phalanx.link.session.secret import hello_topic, prologue, record_topic
from phalanx.link.session.updates import UpdateReader
from phalanx.link.session.window import Window
from scripts import loaded
from session_world import STATIC

ROOT = Path(__file__).parent.parent
VECTORS = json.loads((ROOT / "vectors" / "session.json").read_text())


def cases(group: str):
    return pytest.mark.parametrize("case", VECTORS[group], ids=lambda case: case["name"])


def outcome(action) -> tuple[str, Any]:
    try:
        return "ok", action()
    except PhalanxError as error:
        return type(error).__name__, None


def plain(value: Any) -> Any:
    return value.hex() if isinstance(value, bytes) else value.name.lower() if hasattr(value, "name") else value


def test_the_typescript_records_are_made_from_the_byte_table():
    for path, make in loaded(ROOT / "docs" / "generate.py").MODULES.items():
        assert path.read_text() == make(), "run docs/generate.py"


@cases("secrets")
def test_secrets_are_derived(case):
    secret, hello = Secret(Kind[case["kind"].upper()], bytes.fromhex(case["raw"])), bytes.fromhex(case["hello"])
    made = [secret.psk.hex(), secret.id.hex(), secret.mac1(hello).hex(), secret.accept_topic(hello)]
    assert made == [case["psk"], case["id"], case["mac1"], case["accept_topic"]]


@cases("invitations")
def test_invitations_are_read_and_written(case):
    name, read = outcome(lambda: parse_invitation(case["fragment"]))
    assert name == case["expect"]
    if read:
        assert read.fragment() == case["fragment"]
        assert (read.static.hex(), read.secret.raw.hex()) == (case["static"], case["secret"])
        assert (read.secret.kind.name.lower(), read.broker, read.root, read.mqtt) == (
            case["kind"], case["broker"], case["root"], case["mqtt"]
        )  # fmt: skip


@cases("padding")
def test_padding(case):
    name, content = outcome(lambda: unpad(bytes.fromhex(case["plaintext"])))
    assert name == case["expect"]
    if content is not None:
        assert content.hex() == case["content"]
        assert pad(content, 1 << 20).hex() == case["plaintext"]


@cases("window")
def test_windows(case):
    window = Window()
    for step in case["steps"]:
        assert outcome(lambda step=step: window.check(step["counter"]))[0] == step["expect"], step
        if step["expect"] == "ok":
            window.enter(step["counter"])


@cases("handshakes")
def test_a_client_sends_and_reads_these_bytes(case):
    kind = Kind[case["kind"].upper()]
    invitation = Invitation(
        bytes.fromhex(case["static"]),
        Secret(kind, bytes.fromhex(case["secret"])),
        case["broker"],
        case["root"],
        case["mqtt"],
    )
    assert prologue(kind, invitation.secret.id, case["root"], case["broker"]).hex() == case["prologue"]
    client = SessionClient(
        SessionConfig(), invitation, lambda n: bytes.fromhex(case["client_ephemeral"]), case["nickname"]
    )
    started = client.start(0)
    assert started[-1].data.hex() == case["hello"]
    events = client.receive(bytes.fromhex(case["accept"]), 1)
    (record,) = (event for event in events if isinstance(event, Transmit))
    assert record.data.hex() == case["first_record"]
    topics = [record_topic(Cipher(bytes.fromhex(case[key]))) for key in ("to_server", "to_client")]
    assert topics == [case["topic_to_server"], case["topic_to_client"]]
    assert hello_topic(STATIC.public_key()) == case["hello_topic"]
    if case["broker"]:
        assert (started[-1].topic, record.topic) == (case["hello_topic"], case["topic_to_server"])
        assert SetTopics((case["topic_to_client"],)) in events
    reply = Replied(case["reply_number"], bytes.fromhex(case["reply"]))
    assert client.receive(bytes.fromhex(case["reply_record"]), 2) == [reply]
    assert client.receive(bytes.fromhex(case["reply_record"]), 2) == []
    assert client.rejected == {"replayed": 1}


@cases("messages")
def test_messages_are_read_and_written(case):
    content = bytes.fromhex(case["content"])
    decode = decode_from_server if case["from"] == "server" else decode_from_client
    name, message = outcome(lambda: decode(content))
    assert name == case["expect"]
    if message is not None:
        assert {key: plain(value) for key, value in asdict(message).items()} == case["fields"]
        assert encode(message) == content


@cases("updates")
def test_updates_open_or_are_refused(case):
    reader = UpdateReader(SessionConfig(), bytes.fromhex(VECTORS["signer"]))
    for step in case["steps"]:
        if step["do"] == "learn":
            chain, topic = bytes.fromhex(step["chain"]), bytes.fromhex(step["topic"])
            reader.learn(Epoch(step["epoch"], step["counter"], chain, topic))
            continue
        name, state = outcome(lambda step=step: reader.open(bytes.fromhex(step["update"])))
        assert name == step["expect"], step
        if state is not None:
            assert (state.hex(), reader.digest.hex()) == (step["state"], step["digest"])
