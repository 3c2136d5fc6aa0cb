"""The vectors that TypeScript runs too, and that they are what the oracle writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from joserfc import jwe as oracle
from joserfc.jwk import OctKey

from phalanx.config import LinkConfig
from phalanx.crypto import Key, seal_jwe
from phalanx.errors import OpenError, PeerError, PhalanxError
from phalanx.link.envelope import Envelope, open_envelope, seal
from phalanx.link.pin import Epoch, Pin, derive_epoch
from phalanx.link.qrurl import Login, parse_qr_url
from phalanx.link.replay import ReplayCache
from phalanx.link.topics import CommandTopic, ReplyTopic, full_topic, split_topic
from scripts import loaded

VECTORS = Path(__file__).parent.parent / "vectors"


def cases(name: str):
    rows = json.loads((VECTORS / f"{name}.json").read_text())["cases"]
    return pytest.mark.parametrize("case", rows, ids=[row["name"] for row in rows])


def outcome(action) -> str:
    """'ok', or the name of the error's cause."""
    try:
        action()
    except OpenError as error:
        return type(error.cause).__name__
    except PhalanxError as error:
        return type(error).__name__
    return "ok"


def epoch_with(key: Key, topic: str = "t") -> Epoch:
    return Epoch(Pin("0000"), topic, key)


# Of each script, what its files hold: their text, or what JSON makes of it.
WRITTEN = {
    "make": lambda make: {f"{name}.json": {"cases": write()} for name, write in make.VECTORS.items()},
    "make_edges": lambda make: {"edges.json": make.text(make.edges())},
    "make_firmware": lambda make: {f"{name}.json": make.text(write()) for name, write in make.VECTORS.items()},
    "make_mission": lambda make: {"mission.json": json.loads(json.dumps(make.mission()))},
    "make_orders": lambda make: {"orders.json": make.document()},
    "make_places": lambda make: make.texts(),
    "make_serial": lambda make: {"serial.json": make.text()},
    "make_session": lambda make: {"session.json": make.made()},
}


def test_the_committed_vectors_are_what_their_scripts_write():
    written = {}
    for script, contents in WRITTEN.items():
        written |= contents(loaded(VECTORS / f"{script}.py"))
    committed = {path.name: path.read_text() for path in VECTORS.glob("*.json")}
    assert set(committed) == {*written, "noise.json"}, "which others have published"
    for name, content in written.items():
        assert (committed[name] if isinstance(content, str) else json.loads(committed[name])) == content, name


@cases("keys")
def test_pins_give_the_published_topics_and_keys(case):
    assert outcome(lambda: Pin(case["pin"])) == case["expect"]
    if case["expect"] == "ok":
        epoch = derive_epoch(Pin(case["pin"]))
        assert (epoch.topic, epoch.key.raw.hex()) == (case["topic"], case["key_hex"])


@cases("envelope")
def test_envelopes_open_or_are_refused_for_the_right_reason(case):
    config = LinkConfig()
    epoch = epoch_with(Key(bytes.fromhex(case["key_hex"])))
    cache = ReplayCache(config.replay_capacity, config.tolerance_s)
    token = case["jwe"].encode()

    def open_it() -> Envelope:
        return open_envelope(token, epoch, case["now"], cache, case["max_bytes"])

    assert outcome(open_it) == case["expect"]
    if case["expect"] == "ok":
        opened = open_envelope(token, epoch, case["now"], ReplayCache(9, 30), case["max_bytes"])
        assert (opened.timestamp_s, opened.payload) == (case["timestamp"], case["payload"])
        assert seal(case["plaintext"].encode(), epoch, bytes.fromhex(case["iv_hex"])) == token
        assert oracle.decrypt_compact(token, OctKey.import_key(epoch.key.raw)).plaintext == case["plaintext"].encode()
        assert outcome(open_it) == "Replayed"


@cases("topics")
def test_topics_split_and_join_again(case):
    assert outcome(lambda: split_topic(case["root"], case["topic"], case["full"])) == case["expect"]
    if case["expect"] == "ok":
        sub = split_topic(case["root"], case["topic"], case["full"])
        expected = {
            "command": lambda: CommandTopic(case["address"], case["application"], case["command"]),
            "reply": lambda: ReplyTopic(case["client_id"]),
        }.get(case["kind"], lambda: case["kind"])()
        assert sub == expected
        assert full_topic(case["root"], case["topic"], sub) == case["full"]


@cases("replay")
def test_replays_are_refused_and_nothing_is_forgotten_early(case):
    cache = ReplayCache(case["capacity"], 30.0)
    for i, step in enumerate(case["steps"]):
        entry = (step["epoch"], bytes.fromhex(step["iv"]), step["timestamp"], step["now"])
        assert outcome(lambda entry=entry: cache.enter(*entry)) == step["expect"], i


@cases("pin_message")
def test_pin_messages_announce_a_pin_or_are_refused(case):
    epoch = epoch_with(Key(bytes(32)))
    token = seal_jwe(case["plaintext"].encode(), epoch.key, bytes(12))

    def open_it():
        return open_envelope(token, epoch, 0.0, ReplayCache(9, 30), 4096, pin_message_may_come=True)

    assert outcome(open_it) == case["expect"]
    if case["expect"] == "ok":
        assert open_it() == Pin(case["pin"])


@cases("qrurl")
def test_qr_urls_parse_and_are_made_again(case):
    assert outcome(lambda: parse_qr_url(case["url"])) == case["expect"]
    if case["expect"] == "ok":
        url = parse_qr_url(case["url"])
        login = Login(**case["login"]) if "login" in case else None
        assert (url.pin.digits, url.broker, url.root, url.mqtt, url.login) == (
            case["pin"],
            case["broker"],
            case["root"],
            case["mqtt"],
            login,
        )
        page, foreign = url.for_page("https://a.example/"), url.for_foreign_page("https://a.example/")
        assert parse_qr_url(page) == url
        assert "?" not in page, "our own form keeps everything out of the query"
        assert parse_qr_url(foreign, url.root) == replace(url, login=None), "no published page reads one there"


def test_a_refusal_does_not_say_more_than_its_type_needs():
    errors = list(PeerError.__subclasses__())
    assert len({cls.reason for cls in errors}) == len(errors)
