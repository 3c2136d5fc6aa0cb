"""Sessions on a broker, that anybody can read and publish on: topics, first messages, and what strangers can do."""

from __future__ import annotations

import pytest

from broker_world import HELLO_TOPIC, WHERE, Broker
from phalanx.link.session import EndReason, Invitation, Kind, Secret, SessionClient
from phalanx.link.session.connections import HELLOS_REMEMBERED
from phalanx.link.session.events import (
    Commanded,
    Ended,
    Joined,
    Transmit,
    Updated,
)
from phalanx.wire.sessions import SIGNED_HELLO
from session_world import PUBLIC, random_source


def test_a_visitor_joins_reads_drives_and_changes_keys_and_topics():
    broker = Broker()
    ada = broker.join()
    broker.state(b"one")
    assert ada.last(Updated) == Updated(b"one")
    assert broker.drive(ada) == [Commanded(1, "R1", "move_raw", b"{}", is_stop=False)]
    before = {topic for topic, _ in broker.seen}
    broker.wait(3_600_000)
    broker.seen.clear()
    broker.state(b"two")
    assert ada.last(Updated) == Updated(b"two")
    assert broker.drive(ada)
    assert not {topic for topic, _ in broker.seen} & before
    assert len([event for event in broker.happened if isinstance(event, Joined)]) == 1
    assert not broker.server.rejected
    assert not ada.client.rejected
    (topics,) = broker.listens.values()
    assert len(topics) <= 2


def test_topics_tell_nothing_and_nothing_readable_is_outside():
    broker = Broker()
    ada = broker.join()
    broker.state()
    broker.drive(ada, b'{"left_y":100}')
    for topic, data in broker.seen:
        assert len(topic) == 22
        for word in (b"R1", b"move_raw", b"left_y", b"state", ada.kept.raw, broker.server.door.code.raw):
            assert word not in data
    sizes = {len(data) for topic, data in broker.seen if topic != HELLO_TOPIC}
    assert sizes <= {50, 10 + 128 + 16, 77 + 128 + 16}


def test_on_a_broker_a_first_message_needs_its_mac_before_anything_is_computed(monkeypatch):
    broker = Broker()
    ada = broker.join()
    hello = next(data for topic, data in broker.seen if topic == HELLO_TOPIC)
    computed = []
    monkeypatch.setattr("phalanx.link.session.connections.respond", lambda *a: computed.append(a))
    for at in range(len(hello)):
        broker.publish(HELLO_TOPIC, hello[:at] + bytes([hello[at] ^ 1]) + hello[at + 1 :])
        broker.publish(HELLO_TOPIC, hello[:at])
    broker.publish(HELLO_TOPIC, hello)
    assert broker.server.rejected["replayed"] == 1
    assert not computed
    assert ada.client.is_joined
    assert len(list(broker.server.connections)) == 1


def test_a_room_code_is_not_taken_on_a_broker():
    broker = Broker()
    broker.server.door.show_room()
    hello = SIGNED_HELLO.encode(kind=Kind.ROOM, id=bytes(8), noise=bytes(48), mac1=bytes(16))
    broker.publish(HELLO_TOPIC, hello)
    assert broker.server.rejected == {"unexpected": 1}


def test_strangers_on_the_topics_of_a_session_cannot_end_it():
    broker = Broker()
    ada = broker.join()
    for topic, data in list(broker.seen):
        for forged in (data, data[:-1], b"", bytes(200), data[:10] + bytes(len(data) - 10)):
            broker.publish(topic, forged)
    for _ in range(200):
        for topics in list(broker.listens.values()):
            broker.publish(topics[0], b"\x10" + bytes(153))
    broker.state()
    assert ada.last(Updated) == Updated(b"state")
    assert broker.drive(ada)
    assert len([event for event in broker.happened if isinstance(event, Joined)]) == 1


def test_a_forged_answer_does_not_spoil_a_handshake():
    broker = Broker()
    forged: list[str] = []

    def answers_first(topic: str, data: bytes) -> bool:
        if data[:1] == b"\x02" and not forged:
            forged.append(topic)
            broker.publish(topic, data[:2] + bytes(48))
        return False

    broker.loses = answers_first
    ada = broker.join()
    assert forged
    assert ada.client.rejected == {"not_authentic": 1}
    assert ada.client.is_joined


@pytest.mark.parametrize("lost", range(9))
def test_whatever_single_message_of_a_key_change_is_lost_the_session_goes_on(lost):
    broker = Broker()
    ada = broker.join()
    broker.wait(599_000)
    count = 0

    def loses(topic: str, data: bytes) -> bool:
        nonlocal count
        count += 1
        return count == lost + 1

    broker.loses = loses
    broker.wait(40_000)
    broker.loses = lambda topic, data: False
    broker.state(b"after")
    broker.wait(1000)
    broker.state(b"after")
    assert ada.last(Updated) == Updated(b"after")
    assert broker.drive(ada)
    broker.wait(700_000)
    broker.state(b"and after the next")
    assert ada.last(Updated) == Updated(b"and after the next")
    assert broker.drive(ada)
    assert broker.join(ada.kept).client.is_joined


@pytest.mark.parametrize("lost", range(4))
def test_whatever_message_of_a_first_handshake_is_lost_it_ends_or_goes_on_and_can_be_tried_again(lost):
    broker = Broker()
    count = 0

    def loses(topic: str, data: bytes) -> bool:
        nonlocal count
        count += 1
        return count == lost + 1

    broker.loses = loses
    ada = broker.join()
    broker.loses = lambda topic, data: False
    broker.wait(6000)
    assert ada.client.is_joined or ada.last(Ended) == Ended(None)
    assert broker.join().client.is_joined


def test_a_client_that_is_silent_for_15_s_is_gone_and_told_so_and_resumes():
    broker = Broker()
    ada = broker.join()
    broker.wait(300_000)
    assert ada.client.is_joined
    broker.loses = lambda topic, data: topic in broker.listens.get(-1, ())
    broker.wait(10_000)
    assert ada.client.is_joined
    broker.wait(6_000)
    assert ada.last(Ended) == Ended(EndReason.CLOSING)
    assert not broker.listens
    assert not list(broker.server.connections)
    broker.loses = lambda topic, data: False
    assert broker.join(ada.kept).client.is_joined


def test_a_page_that_is_loaded_again_takes_its_session_over():
    broker = Broker()
    ada = broker.join()
    again = broker.join(ada.kept)
    broker.state()
    assert broker.drive(again)
    assert len(list(broker.server.connections)) == 1


def test_a_page_that_says_late_that_it_leaves_does_not_end_the_session_that_took_over():
    broker = Broker()
    ada = broker.join()
    goodbye = next(each for each in ada.client.leave(broker.world.ms) if isinstance(each, Transmit))
    again = broker.join(ada.kept)
    broker.publish(goodbye.topic, goodbye.data)
    broker.state()
    assert broker.drive(again)
    assert len(list(broker.server.connections)) == 1


def test_first_messages_have_a_budget_for_each_kind_and_bounded_memory():
    broker = Broker(open_hellos_per_s=5, open_hellos_at_once=5, connections_max=8)
    ada = broker.join()
    broker.loses = lambda topic, data: data[:1] == b"\x02"
    for _ in range(20):
        broker.join()
    assert broker.server.rejected["too_many"] == 16
    assert len(list(broker.server.connections)) == 5
    assert ada.client.is_joined
    broker.loses = lambda topic, data: False
    assert broker.join(ada.kept).client.is_joined
    for _ in range(30):
        broker.world.ms += 200
        broker.loses = lambda topic, data: data[:1] == b"\x02"
        broker.join()
    assert len(list(broker.server.connections)) <= 8
    assert len(broker.listens) <= 8
    assert len(broker.server.connections._hellos) <= HELLOS_REMEMBERED


def knock(broker: Broker, secret: Secret, times: int) -> int:
    """Send first messages with a secret and no more; return how many were answered."""
    answered = 0
    for n in range(times):
        where = WHERE["broker"], WHERE["root"], 5
        client = SessionClient(broker.world.config, Invitation(PUBLIC, secret, *where), random_source(f"knock {n}"))
        (hello,) = [each.data for each in client.start(broker.world.ms) if isinstance(each, Transmit)]
        answered += bool(broker.server.receive_hello(hello, broker.world.now))
    return answered


def test_no_visitor_locks_others_out_by_first_messages():
    broker = Broker(hellos_per_s=100, handshakes_at_once=10)
    ada, eve = broker.join(), broker.join()
    assert knock(broker, eve.kept, 200) == 10
    assert broker.join(ada.kept).client.is_joined
    assert not broker.join(eve.kept).client.is_joined
    broker.wait(5_000)
    assert broker.join(eve.kept).client.is_joined


def test_a_resumption_on_a_broker_is_counted_once():
    broker = Broker(handshakes_at_once=5)
    ada = broker.join()
    for _ in range(5):
        ada = broker.join(ada.kept)
        assert ada.client.is_joined
    assert not broker.join(ada.kept).client.is_joined


def test_no_ticket_locks_others_out_by_first_messages():
    broker = Broker(hellos_per_s=100, handshakes_at_once=10)
    his, hers = broker.world.ticket(uses=3).secret, broker.world.ticket().secret
    assert knock(broker, his, 200) == 13
    assert broker.join(hers).client.is_joined
    assert not broker.join(his).client.is_joined
    broker.wait(5_000)
    assert broker.join(his).client.is_joined


def test_who_is_removed_learns_so_and_hears_nothing_more():
    broker = Broker()
    ada, eve = broker.join(), broker.join()
    broker.carry(broker.world.operations.remove(2, broker.world.now))
    broker.state(b"after")
    assert eve.last(Ended) == Ended(EndReason.REMOVED)
    assert eve.last(Updated) is None
    assert ada.last(Updated) == Updated(b"after")
    assert not broker.join(eve.kept).client.is_joined


def test_who_hears_nothing_for_long_begins_anew_and_who_waits_for_approval_is_patient():
    broker = Broker()
    ada = broker.join()
    broker.server.visitors.set_approval(approval=True)
    bob = broker.join()
    broker.wait(4000, updates=False)
    assert ada.client.is_joined
    broker.wait(2000, updates=False)
    assert ada.last(Ended) == Ended(None)
    assert bob.last(Ended) is None
    assert broker.join(ada.kept).client.is_joined
    broker.wait(50_000)
    assert bob.client.is_joined
    broker.wait(10_000)
    assert bob.last(Ended) == Ended(None)


def test_forged_updates_and_records_are_not_taken_for_a_sign_of_life():
    broker = Broker()
    ada = broker.join()
    broker.state()
    heard = [(topic, data) for topic, data in broker.seen if topic in ada.topics]
    assert len(heard) > 1
    for _ in range(6):
        broker.wait(1000, updates=False)
        for topic, data in heard:
            broker.publish(topic, data)
            broker.publish(topic, data[:-1] + bytes([data[-1] ^ 1]))
    assert ada.last(Ended) == Ended(None)


def test_websockets_of_a_server_on_a_broker_are_direct():
    broker = Broker()
    ada = broker.world.join(Invitation(PUBLIC, broker.server.door.code))
    assert ada.client.is_joined
    assert not broker.listens
