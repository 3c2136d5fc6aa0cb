"""The two sides of the link, without a broker: what one seals the other opens, across rotations."""

from __future__ import annotations

import json
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.config import LinkConfig
from phalanx.crypto import Key, seal_jwe
from phalanx.errors import Stale, UsageError
from phalanx.link import ClientSide, Command, Pin, QrUrl, Request, ServerSide, new_pin
from phalanx.link.envelope import encode_envelope, encode_pin_message, seal
from phalanx.link.messages import Knock, Moved, Notification, Publish, Rejected, Reply, Subscribe, Unsubscribe
from phalanx.link.rotation import TABLE, Act, Event, State, step
from phalanx.link.topics import CommandTopic, full_topic
from phalanx.net import QrkeyClient

NOW = 1_700_000_000.0
MOVE = CommandTopic("DECAFBAD00000001", "0", "move_raw")
CONFIG = LinkConfig(rotate_s=900, overlap_s=120)


def pair(config: LinkConfig = CONFIG) -> tuple[ServerSide, ClientSide]:
    server = ServerSide(config, os.urandom, 0.0)
    return server, ClientSide(config, os.urandom, server.epoch.pin, "phone-1")


def deliver(side, publish: Publish, *uptime: float):
    return side.receive(publish.topic, publish.payload, NOW, *uptime)


def published(asks) -> list[Publish]:
    return [ask for ask in asks if isinstance(ask, Publish)]


async def unread(payloads) -> tuple[list, int]:
    """What a client has for a late reader of these notifications, and how many it says it dropped."""
    server, _ = pair()
    client = QrkeyClient(QrUrl(server.epoch.pin, "ws://nowhere.invalid/mqtt"), clock=lambda: NOW)
    for payload in payloads:
        (note,) = server.notify(payload, NOW)
        await client._on_message(note.topic, note.payload)
    heard = client.notifications()
    kept = [await anext(heard) for _ in range(client._unread.qsize())]
    assert not client._unread_bytes
    return kept, client.dropped


class TestMessages:
    async def test_what_nobody_reads_is_bounded_in_number_and_in_bytes_and_what_is_dropped_is_counted(self):
        assert await unread(range(300)) == ([*range(44, 300)], 44)
        long = "x" * 1_000_000
        assert await unread([long + str(i) for i in range(6)]) == ([long + str(i) for i in range(3, 6)], 3)
        assert await unread([1, long + "y", 2]) == ([1, long + "y", 2], 0)

    def test_a_command_arrives_as_it_was_sent(self):
        server, client = pair()
        said = deliver(server, client.command(MOVE, {"left_y": 60}, NOW), 0.0)
        assert said == Command(MOVE, {"left_y": 60})

    def test_a_request_is_answered_to_the_one_who_asked(self):
        server, client = pair()
        other = ClientSide(CONFIG, os.urandom, server.epoch.pin, "phone-2")
        request = deliver(server, client.request(0, NOW, what="this"), 0.0)
        assert isinstance(request, Request)
        assert (request.number, request.client_id, request.words["what"]) == (0, "phone-1", "this")
        (answer,) = server.reply(request, [1, 2], NOW)
        assert deliver(client, answer) == Reply(0, [1, 2])
        refused = deliver(other, answer)
        assert isinstance(refused, Rejected)
        assert refused.reason == "wrong_topic"

    def test_a_notification_reaches_everybody(self):
        server, client = pair()
        (note,) = server.notify({"cmd": 1}, NOW)
        assert deliver(client, note) == Notification({"cmd": 1}, NOW)

    def test_a_replay_counts_once(self):
        server, client = pair()
        publish = client.command(MOVE, 1, NOW)
        assert isinstance(deliver(server, publish, 0.0), Command)
        for _ in range(3):
            assert deliver(server, publish, 0.0).reason == "replayed"
        assert server.rejected == {"replayed": 3}

    def test_a_withheld_command_can_be_delivered_to_another_robot(self):
        # Documented in docs/explanation/threats-qrkey.md: clients do not bind the topic into the envelope.
        server, client = pair()
        publish = client.command(MOVE, 1, NOW)
        payload = seal(encode_envelope(1, NOW), server.epoch, os.urandom(12))
        spliced = Publish(publish.topic.replace("00000001", "00000002"), payload)
        assert deliver(server, spliced, 0.0).address == "DECAFBAD00000002"

    @pytest.mark.parametrize("skew, well", [(29.0, True), (-29.0, True), (31.0, False), (-31.0, False)])
    def test_clocks_may_differ_by_thirty_seconds(self, skew, well):
        server, client = pair()
        publish = client.command(MOVE, 1, NOW + skew)
        assert isinstance(deliver(server, publish, 0.0), Command) is well
        (note,) = server.notify(1, NOW)
        heard = client.receive(note.topic, note.payload, NOW + skew)
        assert isinstance(heard, Notification) is well
        if not well:
            assert isinstance(heard.error.cause, Stale)
            assert heard.error.cause.skew_s == pytest.approx(-skew)

    def test_what_a_client_would_refuse_is_not_sent(self):
        server, client = pair()
        with pytest.raises(UsageError, match="clients accept"):
            server.notify("x" * (1 << 20), NOW)
        with pytest.raises(UsageError, match="servers accept"):
            client.command(MOVE, "x" * 49_152, NOW)
        with pytest.raises(UsageError, match="not JSON"):
            server.notify(float("nan"), NOW)
        with pytest.raises(UsageError, match="not JSON"):
            server.notify({1, 2}, NOW)
        with pytest.raises(UsageError, match="client id"):
            ClientSide(CONFIG, os.urandom, server.epoch.pin, "a/b")

    @pytest.mark.parametrize(
        "payload, reason",
        [
            ({"request": 0}, "bad_payload"),
            ({"request": 0, "reply": "a/b"}, "bad_payload"),
            ({"request": 0, "reply": "#"}, "bad_payload"),
            ({"request": 0, "reply": ""}, "bad_payload"),
            ({"request": 0, "reply": "x" * 129}, "bad_payload"),
            ({"request": 0, "reply": 7}, "bad_payload"),
            ({"request": 0, "reply": "\ud800"}, "bad_payload"),
            ({"request": True, "reply": "a"}, "bad_payload"),
            ({"request": 1.5, "reply": "a"}, "bad_payload"),
            ({"request": 1 << 60, "reply": "a"}, "bad_payload"),
            ([], "bad_payload"),
            (None, "bad_payload"),
            ("request", "bad_payload"),
        ],
    )
    def test_a_request_that_makes_no_sense_is_counted(self, payload, reason):
        server, _ = pair()
        token = seal_jwe(json.dumps({"timestamp": NOW, "payload": payload}).encode(), server.epoch.key, os.urandom(12))
        assert server.receive(f"/qrkey/{server.epoch.topic}/request", token, NOW, 0.0).reason == reason

    def test_a_pin_message_sent_to_the_server_changes_nothing(self):
        # A visitor has the key and can seal one; the server never reads it.
        server, _ = pair()
        before = server.epoch
        token = seal_jwe(b'{"cmd":255,"pin_code":"123456789012"}', server.epoch.key, os.urandom(12))
        for sub in ("request", "notify", "command/0000/A/0/x"):
            said = server.receive(f"/qrkey/{server.epoch.topic}/{sub}", token, NOW, 0.0)
            assert said.reason in ("malformed_envelope", "wrong_topic")
        assert server.epoch is before


class TestRotation:
    def test_every_state_has_a_way_on(self):
        assert {state for state, _ in TABLE} == set(State)
        assert {state for state, _ in TABLE.values()} <= set(State)
        assert step(State.FIRST, Event.KNOCK) == (State.FIRST, ())

    def test_a_client_follows_and_both_epochs_work_in_the_overlap(self):
        server, client = pair()
        late = ClientSide(CONFIG, os.urandom, server.epoch.pin, "phone-2")
        old_topics = client.subscriptions()
        assert server.advance(899.9) == ()
        asks = server.advance(900.0)
        assert server.state is State.OVERLAP
        assert [type(ask) for ask in asks] == [Subscribe, Subscribe, Publish]
        moved = deliver(client, published(asks)[0])
        assert isinstance(moved, Moved)
        assert moved.epoch.pin == server.epoch.pin
        assert {ask.topic for ask in moved.asks if isinstance(ask, Unsubscribe)} == set(old_topics)
        assert {ask.topic for ask in moved.asks if isinstance(ask, Subscribe)} == set(client.subscriptions())
        for side in (client, late):
            assert isinstance(deliver(server, side.command(MOVE, 1, NOW), 901.0), Command)
        notes = server.notify("news", NOW)
        assert len(notes) == 2
        assert isinstance(deliver(client, notes[0]), Notification)
        assert isinstance(deliver(late, notes[1]), Notification)

    def test_a_client_falls_back_from_an_epoch_in_which_nobody_speaks_and_only_from_there(self):
        server, client = pair()
        assert client.fall_back(client.epoch) is None
        forged = seal(encode_pin_message(Pin("6" * 12)), server.epoch, os.urandom(12))
        client.receive(full_topic("/qrkey", server.epoch.topic, "notify"), forged, NOW)
        assert client.epoch.topic != server.epoch.topic
        assert client.fall_back(server.epoch) is None, "what it asked before it came here says nothing of here"
        assert client.fall_back(client.epoch).epoch is client.epoch
        assert client.epoch.topic == server.epoch.topic
        assert client.fall_back(client.epoch) is None
        deliver(client, published(server.advance(900.0))[0])
        deliver(client, server.notify("news", NOW)[0])
        assert client.fall_back(client.epoch) is None
        assert client.epoch.topic == server.epoch.topic

    def test_at_the_end_of_the_overlap_the_pin_is_told_once_more_and_the_old_epoch_dropped(self):
        server, client = pair()
        command = client.command(MOVE, 1, NOW)
        server.advance(900.0)
        asks = server.advance(1020.0)
        assert server.state is State.SETTLED
        assert isinstance(deliver(client, published(asks)[0]), Moved)
        assert [ask.topic.rsplit("/", 1)[1] for ask in asks if isinstance(ask, Unsubscribe)] == ["#"]
        assert deliver(server, command, 1020.0).reason == "wrong_topic"
        assert len(server.notify(1, NOW)) == 1

    def test_a_phone_that_slept_through_a_rotation_is_told_where_to_go(self):
        server, phone = pair()
        server.advance(900.0)
        server.advance(1020.0)
        knock = deliver(server, phone.request(0, NOW), 1500.0)
        assert isinstance(knock, Knock)
        moved = deliver(phone, published(knock.asks)[0])
        assert isinstance(moved, Moved)
        assert isinstance(deliver(server, phone.request(0, NOW), 1501.0), Request)

    def test_a_knock_is_answered_at_most_once_a_second_and_only_if_authentic(self):
        server, phone = pair()
        old_request = phone.request(0, NOW)
        server.advance(900.0)
        server.advance(1020.0)
        assert len(deliver(server, old_request, 1500.0).asks) == 1
        assert deliver(server, old_request, 1600.0).reason == "replayed"
        assert deliver(server, phone.request(0, NOW), 1500.5).asks == ()
        assert len(deliver(server, phone.request(0, NOW), 1501.5).asks) == 1
        forged = seal_jwe(b"{}", Key(bytes(32)), bytes(12))
        assert server.receive(old_request.topic, forged, NOW, 1600.0).reason == "not_authentic"

    def test_it_may_rotate_before_its_time_but_not_in_an_overlap(self):
        server, phone = pair()
        first = server.epoch
        assert isinstance(deliver(phone, published(server.rotate(5.0))[0]), Moved)
        second = server.epoch
        assert second is not first
        assert server.next_due_s() == 125.0
        assert server.rotate(6.0) == ()
        assert server.epoch is second
        server.advance(125.0)
        server.rotate(126.0)
        assert server.epoch not in (first, second)

    def test_two_rotations_ago_is_forgotten(self):
        server, phone = pair()
        for uptime in (900.0, 1020.0, 1800.0):
            server.advance(uptime)
        assert deliver(server, phone.request(0, NOW), 1801.0).reason == "wrong_topic"

    def test_after_a_reconnect_the_pin_is_told_again(self):
        server, phone = pair()
        assert server.reconnected(10.0) == ()
        server.advance(900.0)
        told = published(server.reconnected(910.0))
        server.advance(1020.0)
        assert published(server.reconnected(1030.0)), "who slept through all of it"
        assert isinstance(deliver(phone, told[0]), Moved)

    def test_subscriptions_follow_the_state(self):
        server, _ = pair()
        assert len(server.subscriptions()) == 2
        server.advance(900.0)
        assert len(server.subscriptions()) == 4
        server.advance(1020.0)
        assert len(server.subscriptions()) == 3
        server.advance(1800.0)
        assert len(server.subscriptions()) == 4

    def test_a_machine_that_slept_through_everything_goes_on(self):
        server, _ = pair()
        server.advance(100_000.0)
        assert server.state is State.OVERLAP
        assert server.next_due_s() == 100_120.0

    @given(st.lists(st.floats(0.1, 2000), max_size=30))
    def test_time_only_ever_rotates_as_the_table_says(self, gaps):
        server, _ = pair()
        uptime, pins = 0.0, {server.epoch.pin.digits}
        for gap in gaps:
            uptime += gap
            before, state, since = server.epoch, server.state, uptime - server.rotated_at_s
            asks = server.advance(uptime)
            rotated = server.epoch is not before
            overlap_ended = state is State.OVERLAP and since >= CONFIG.overlap_s
            assert rotated == (since >= CONFIG.rotate_s)
            assert len(published(asks)) == rotated + overlap_ended
            if rotated:
                assert server.epoch.pin.digits not in pins
                pins.add(server.epoch.pin.digits)
                assert server.state is State.OVERLAP
            assert len(server.live_epochs()) == (2 if server.state is State.OVERLAP else 1)


class TestPins:
    def test_every_act_of_the_table_is_carried_out(self):
        assert {act for _, acts in TABLE.values() for act in acts} == set(Act)

    @given(st.integers(12, 64))
    def test_pins_have_the_digits_asked_for(self, digits):
        pin = new_pin(digits, os.urandom)
        assert len(pin.digits) == digits
        assert pin.digits.isdigit()

    def test_digits_are_equally_likely_whatever_the_bytes(self):
        every_byte = bytes(range(256))
        pin = new_pin(64, lambda _: every_byte)
        assert pin.digits == ("0123456789" * 7)[:64]
        drawn = iter([bytes([255] * 12), bytes([250] * 12), bytes(range(12))])
        assert new_pin(12, lambda _: next(drawn)).digits == "012345678901"

    @pytest.mark.parametrize("secret", [Pin("123456789012"), Key(b"k" * 32), pair()[0].epoch])
    def test_secrets_do_not_print(self, secret):
        for text in (repr(secret), str(secret), f"{secret}", f"{[secret]}"):
            assert "123456789012" not in text
            assert "kkkk" not in text

    @pytest.mark.parametrize(
        "bad",
        [
            {"root": "qrkey"},
            {"root": "/#"},
            {"pin_digits": 11},
            {"pin_digits": 65},
            {"rotate_s": 0},
            {"rotate_s": float("nan")},
            {"overlap_s": 900},
            {"overlap_s": -1},
            {"tolerance_s": float("inf")},
            {"replay_capacity": 0},
        ],
        ids=str,
    )
    def test_a_bad_configuration_cannot_be_made(self, bad):
        with pytest.raises(UsageError) as caught:
            LinkConfig(**bad)
        assert caught.value.hint
