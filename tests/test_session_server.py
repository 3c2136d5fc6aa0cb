"""Sessions from end to end in memory: who is admitted, what each may do, and that who was removed stays removed."""

from __future__ import annotations

import itertools

import pytest

from phalanx.errors import UsageError
from phalanx.link.session import (
    EndReason,
    Invitation,
    Kind,
    MemoryStore,
    Reason,
    Role,
    Secret,
    SessionClient,
    Ticket,
    parse_room_code,
)
from phalanx.link.session.events import (
    Admitted,
    Commanded,
    Ended,
    Joined,
    KeepSecret,
    Left,
    Replied,
    Requested,
    Send,
    StandingChanged,
    Updated,
    WasRefused,
)
from phalanx.link.session.messages import Join, Leave
from phalanx.wire.sessions import ACCEPT, HELLO, RECORD
from session_world import PUBLIC, UNIX_S, World, random_source


def with_robots(*robots: str, **config) -> World:
    world = World(**config)
    world.server.assignment.set_robots(robots or ("R1", "R2", "R3"), world.ms)
    return world


# --- joining ---


def test_a_visitor_is_admitted_with_its_first_record_and_then_reads_and_drives():
    world = with_robots()
    ada = world.join(name="Ada")
    assert ada.last(Admitted) == Admitted(1, "Ada")
    assert ada.last(StandingChanged).standing.role is Role.DRIVE
    world.publish(b"here")
    assert ada.last(Updated) == Updated(b"here")
    assert world.drive(ada, payload=b'{"left_y":60}') == Commanded(1, "R1", "move_raw", b'{"left_y":60}', is_stop=False)
    world.do(ada, [ada.client.request("robots", b"", world.ms)[1]])
    assert world.happened[-1] == Requested(1, 1, "robots", b"")
    world.carry(world.server.reply(1, 1, b"[]"))
    assert ada.last(Replied) == Replied(1, b"[]")
    world.do(ada, ada.client.leave(world.ms))
    assert world.happened[-2:][0] == Left(1)
    assert not world.server.rejected
    assert not ada.client.rejected


def test_a_first_message_alone_has_no_effect_nor_has_its_replay():
    world = World()
    ticket = world.ticket(uses=1)
    ada = world.join(ticket)
    hello = next(raw for way, _, raw in world.wire if way == "up")
    for secret in (ticket, world.invitation()):
        copy = world.dial(secret)
        world.carry(world.server.receive(copy.connection, hello, world.now))
    assert [event for event in world.happened if isinstance(event, Joined)] == [
        Joined(1, "Visitor 1", Role.DRIVE, True, False)
    ]
    assert ada.client.is_joined
    assert len(world.server.visitors) == 1


def test_a_replayed_open_hello_is_answered_and_forgotten_after_five_seconds():
    world = World()
    world.join()
    hello = next(raw for way, _, raw in world.wire if way == "up")
    copy = world.dial()
    world.carry(world.server.receive(copy.connection, hello, world.now))
    assert copy.closed is None
    world.wait(6000)
    assert copy.closed == "handshake"
    assert len(world.server.visitors) == 1


def test_without_an_invitation_nobody_gets_an_answer():
    world = World()
    for secret in (Secret(Kind.OPEN, bytes(16)), Secret(Kind.TICKET, bytes(16)), Secret(Kind.RESUME, bytes(32))):
        phone = world.join(world.invitation(secret))
        assert phone.closed == "unknown_secret"
    known = world.server.door.code
    wrong = Secret(Kind.OPEN, known.raw)
    client = SessionClient(world.config, world.invitation(wrong), random_source("x"))
    hello = HELLO.decode(client.start(0)[0].data)
    phone = world.dial()
    world.carry(world.server.receive(phone.connection, HELLO.encode(**hello | {"noise": bytes(48)}), world.now))
    assert phone.closed == "not_authentic"
    assert not [raw for way, _, raw in world.wire if way == "down"]


@pytest.mark.parametrize("raw", [b"", b"\0", b"\x01", b"\x02" * 50, b"\x10" * 40, b"\x11" * 200, bytes(70_000)])
def test_garbage_before_admission_ends_the_connection_and_nothing_else(raw):
    world = World()
    ada, stranger = world.join(), world.dial()
    world.carry(world.server.receive(stranger.connection, raw, world.now))
    assert stranger.closed
    assert world.server.receive(stranger.connection, raw, world.now) == []
    assert ada.closed is None
    assert sum(world.server.rejected.values()) == 1


def test_garbage_of_a_visitor_is_counted_and_ends_its_session_after_64():
    world = World()
    ada = world.join()
    for n in range(64):
        assert (ada.closed is None) is (n < 64)
        world.carry(world.server.receive(ada.connection, b"\x10" + bytes(150), world.now))
    assert ada.closed
    assert world.server.connections.find(ada.connection) is None


def test_the_server_reads_no_updates_and_no_answers():
    world = World()
    ada = world.join()
    update = world.publish()
    for raw in (update, ACCEPT.encode(generation=0, noise=bytes(48))):
        assert world.server.receive(ada.connection, raw, world.now) == []
    assert world.server.rejected.total() == 2


# --- codes ---


def test_the_open_code_changes_every_15_minutes_and_the_one_before_is_valid_for_2():
    world = World()
    old = world.invitation()
    world.wait(899_000)
    assert world.join(old).client.is_joined
    world.wait(2_000)
    assert world.server.door.code.raw != old.secret.raw
    world.wait(117_000)
    assert world.join(old).client.is_joined
    world.wait(4_000)
    assert world.join(old).closed == "unknown_secret"
    assert world.join().client.is_joined


def test_new_code_refuses_the_old_one_at_once_even_in_the_middle_of_a_handshake():
    world = World()
    old = world.invitation()
    ada, half = world.join(old), world.dial(old)
    (hello,) = half.client.start(world.ms)
    answer = world.server.receive(half.connection, hello.data, world.now)
    world.operations.new_code(world.now)
    assert world.join(old).closed == "unknown_secret"
    world.carry(answer)
    assert half.last(Ended) == Ended(EndReason.NOT_ADMITTED)
    assert half.closed == "not_admitted"
    assert ada.closed is None
    assert world.join().client.is_joined


def test_a_ticket_admits_as_often_as_it_says_until_its_time_is_over():
    world = with_robots()
    ticket = world.ticket(uses=2, name="Grace", robots=frozenset({"R2"}))
    first, second, third = world.join(ticket, name="Eve"), world.join(ticket), world.join(ticket)
    assert (first.last(Admitted).name, second.last(Admitted).name) == ("Grace", "Grace 2")
    assert third.closed == "unknown_secret"
    world.publish()
    assert isinstance(world.drive(first, "R2"), Commanded)
    world.drive(first, "R1")
    assert first.last(WasRefused) == WasRefused(0, Reason.NOT_ALLOWED)
    brief = world.ticket(lifetime_s=10)
    world.wait(11_000)
    assert world.join(brief).closed == "unknown_secret"


def test_no_two_visitors_have_one_nickname_and_nobody_is_without():
    world = World()
    wishes = ("Ada", "ada", "", "Visitor 4", "ADA", "x" * 40, "x" * 32, "Ada 2")
    names = [world.join(name=wish).last(Admitted).name for wish in wishes]
    long = "x" * 32
    assert names == ["Ada", "ada 2", "Visitor 3", "Visitor 4", "ADA 3", long, f"{long[:26]} 2", "Ada 2 2"]
    assert all(len(name) <= 32 for name in names)
    world.operations.remove(1, world.now)
    assert world.join(name="Ada").last(Admitted).name == "Ada", "that one is free again"


def test_two_handshakes_with_one_use_admit_one():
    world = World()
    ticket = world.ticket(uses=1)
    phones = [world.dial(ticket), world.dial(ticket)]
    answers = [world.server.receive(p.connection, p.client.start(world.ms)[0].data, world.now) for p in phones]
    for answer in answers:
        world.carry(answer)
    assert [phone.client.is_joined for phone in phones] == [True, False]


def test_no_open_code_admits_operators_and_an_operators_ticket_is_for_one():
    from phalanx.link.session import SessionServer
    from session_world import STATIC

    world = World()
    with pytest.raises(UsageError):
        SessionServer(
            world.config, STATIC, world.server.updates._signer, MemoryStore(), world.random, world.now, Role.OPERATE
        )
    with pytest.raises(UsageError):
        world.ticket(Role.OPERATE, uses=2)
    assert world.join(world.ticket(Role.OPERATE)).last(StandingChanged).standing.role is Role.OPERATE


def test_a_room_code_admits_one_visitor_and_then_changes():
    world = World()
    digits = world.server.door.show_room()
    room = world.invitation(parse_room_code(digits))
    assert world.join(room).client.is_joined
    assert world.server.door.room != digits
    assert world.join(room).closed == "not_authentic"
    world.server.door.hide_room()
    assert world.join(room).closed == "unknown_secret"


def test_tries_of_room_codes_are_limited_and_qr_codes_are_not():
    world = World()
    world.server.door.show_room()
    wrong = world.invitation(parse_room_code("00000000"))
    closed = [world.join(wrong, address="10.0.0.1").closed for _ in range(11)]
    assert closed == ["not_authentic"] * 10 + ["tries_used_up"]
    for n in range(110):
        assert world.join(wrong, address=f"10.0.1.{n}").closed == "not_authentic"
    assert world.join(wrong, address="10.0.2.1").closed == "tries_used_up"
    assert world.join(address="10.0.0.1").client.is_joined
    world.wait(3_600_000, 60_000)
    assert world.join(wrong, address="10.0.0.1").closed == "not_authentic"


def test_fifty_phones_behind_one_router_join_by_room_code():
    world = World()
    for _ in range(50):
        world.server.door.show_room()
        assert world.join(world.invitation(parse_room_code(world.server.door.room))).client.is_joined


# --- new keys, and resuming ---


def test_a_session_of_an_hour_makes_new_keys_six_times_and_loses_nothing():
    world = with_robots()
    ada = world.join()
    for second in range(360):
        world.wait(10_000, 10_000)
        world.publish(str(second).encode())
        assert ada.last(Updated) == Updated(str(second).encode())
        assert isinstance(world.drive(ada), Commanded)
    assert ada.client._channel._now.number == 6
    assert len([event for event in world.happened if isinstance(event, Joined)]) == 1
    assert not world.server.rejected
    assert not ada.client.rejected


def test_a_client_that_makes_no_new_keys_is_ended():
    world = World()
    ada = world.join()
    ada.client.tick = lambda now_ms: []
    world.wait(1_201_000)
    assert ada.last(Ended) == Ended(EndReason.OLD_KEYS)
    assert world.resume(ada.kept).client.is_joined


def test_a_visitor_resumes_with_its_last_secret_and_the_one_before_dies():
    world = World()
    world.join(name="Bea")
    ada = world.join(name="Ada")
    first = ada.kept
    world.carry(world.server.closed(ada.connection, world.now))
    again = world.resume(first)
    assert again.last(Admitted) == Admitted(2, "Ada")
    assert [event.is_new for event in world.happened if isinstance(event, Joined)] == [True, True, False]
    assert world.resume(first).closed == "unknown_secret"
    assert world.resume(again.kept).client.is_joined


def test_the_secret_before_is_valid_until_the_new_one_is_stored():
    world = World()
    ada = world.join()
    world.do = lambda phone, events, do=world.do: do(phone, [e for e in events if type(e).__name__ != "KeepSecret"])
    again = world.resume(ada.kept)
    assert again.kept is None
    third = world.resume(ada.kept)
    assert third.client.is_joined
    assert again.last(Ended) == Ended(EndReason.REPLACED)


def test_a_resume_secret_is_valid_for_its_time():
    world = World(resume_s=3600)
    ada = world.join()
    world.carry(world.server.closed(ada.connection, world.now))
    ada.closed = "away"
    world.wait(3_601_000, 60_000)
    assert world.resume(ada.kept).closed == "unknown_secret"


def test_a_visitor_cannot_take_over_anothers_connection():
    world = World()
    ada, eve = world.join(), world.join()
    stolen = SessionClient(world.config, world.invitation(ada.kept), random_source("stolen"))
    (hello,) = stolen.start(world.ms)
    world.carry(world.server.receive(eve.connection, hello.data, world.now))
    assert world.server.rejected["unexpected"] == 1
    world.publish()
    assert eve.client.is_joined
    assert ada.client.is_joined


# --- after the gateway was killed ---


class Killed(BaseException):
    """The process dies."""


class MortalStore(MemoryStore):
    """A store whose process is killed at its n-th write: before it, or just after."""

    def __init__(self) -> None:
        super().__init__()
        self.left, self.written = -1, False

    def write(self, rows):
        self.left -= 1
        if self.left == -1 and not self.written:
            raise Killed
        super().write(rows)
        if self.left == -1:
            raise Killed


def test_visitors_tickets_and_approval_survive_a_restart_and_the_open_code_does_not():
    world = World()
    ticket = world.ticket(uses=2, robots=frozenset({"R1", "R2"}), name="Ada")
    code = world.invitation()
    ada = world.join(ticket)
    world.operations.close_door()
    world.boot()
    assert world.join(code).closed == "unknown_secret"
    again = world.resume(ada.kept)
    assert again.last(Admitted) == Admitted(1, "Ada")
    assert world.server.visitors.find(1).robots == {"R1", "R2"}
    newcomer = world.join(ticket)
    assert newcomer.last(StandingChanged).standing.waiting
    assert newcomer.last(Admitted).visitor == 2
    assert world.join(ticket).closed == "unknown_secret"


@pytest.mark.parametrize(("writes", "written"), [*itertools.product(range(7), (False, True))])
def test_whenever_the_gateway_is_killed_an_acknowledged_removal_holds_and_others_can_resume(writes, written):
    store = MortalStore()
    world = World(store)
    secrets, acknowledged = {}, False
    store.left, store.written = writes, written
    try:
        eve = world.join(world.ticket(uses=9))
        secrets["eve"], code = eve.kept, world.invitation()
        ada = world.join()
        secrets["ada"] = ada.kept
        world.carry(world.operations.remove(eve.last(Admitted).visitor, world.now))
        acknowledged = True
    except Killed:
        pass
    store.left = -1_000_000
    world.boot()
    if acknowledged:
        assert world.resume(secrets["eve"]).closed == "unknown_secret"
        assert world.server.door.tickets() == []
        assert world.join(code).closed == "unknown_secret"
        assert world.join().last(StandingChanged).standing.waiting
    if "ada" in secrets:
        assert world.resume(secrets["ada"]).client.is_joined


# --- operators ---


def test_a_removed_visitor_stays_removed_and_newcomers_wait():
    world = with_robots()
    code = world.invitation()
    ada, eve = world.join(name="Ada"), world.join(name="Eve")
    world.publish()
    world.drive(eve, "R1")
    epochs = [world.server.updates.epochs()[0].epoch]
    world.carry(world.operations.remove(2, world.now))
    assert eve.last(Ended) == Ended(EndReason.REMOVED)
    assert eve.closed == "removed"
    assert world.resume(eve.kept).closed == "unknown_secret"
    assert world.join(code).closed == "unknown_secret"
    assert world.server.updates.epochs()[0].epoch == epochs[0] + 1
    update = world.publish(b"after")
    assert ada.last(Updated) == Updated(b"after")
    assert eve.client._reader is not None
    assert eve.last(Updated) == Updated(b"state")
    eve.client.is_over = False
    assert eve.client.receive(update, world.ms) == []
    assert isinstance(world.drive(ada, "R1"), Commanded)
    waits = world.join(name="Eve again")
    assert waits.last(StandingChanged).standing.waiting
    world.publish(b"unseen")
    assert waits.last(Updated) is None
    with pytest.raises(UsageError):
        world.operations.approve(99, world.now)
    world.carry(world.operations.approve(waits.last(Admitted).visitor, world.now))
    world.publish(b"seen")
    assert waits.last(Updated) == Updated(b"seen")
    world.operations.open_door()
    assert not world.join().last(StandingChanged).standing.waiting


def test_a_removed_visitors_ticket_admits_nobody_any_more():
    world = World()
    ticket = world.ticket(uses=5)
    world.join(ticket)
    world.carry(world.operations.remove(1, world.now))
    assert world.join(ticket).closed == "unknown_secret"


def test_a_removal_in_the_middle_of_a_resume_holds():
    world = World()
    eve = world.join()
    half = world.dial(world.invitation(eve.kept))
    answer = world.server.receive(half.connection, half.client.start(world.ms)[0].data, world.now)
    world.carry(world.operations.remove(1, world.now))
    world.carry(answer)
    assert half.last(Ended) == Ended(EndReason.NOT_ADMITTED)
    assert len(world.server.visitors) == 0


def test_everybody_out_keeps_operators():
    world = World()
    operator = world.join(world.ticket(Role.OPERATE))
    others = [world.join() for _ in range(3)]
    world.carry(world.operations.everybody_out(world.now))
    assert [each.last(Ended) for each in others] == [Ended(EndReason.NEW_CODE)] * 3
    assert operator.client.is_joined
    for each in others:
        assert world.resume(each.kept).closed == "unknown_secret"
    assert world.join().last(StandingChanged).standing.waiting


def test_an_operators_ticket_is_admitted_while_newcomers_wait():
    world = World()
    world.operations.close_door()
    assert not world.join(world.ticket(Role.OPERATE)).last(StandingChanged).standing.waiting


def test_watch_only_keeps_the_view():
    world = with_robots()
    ada = world.join()
    world.publish()
    world.drive(ada)
    world.carry(world.operations.set_role(1, Role.WATCH, world.now))
    assert ada.last(StandingChanged).standing.role is Role.WATCH
    assert ada.last(StandingChanged).standing.robot == ""
    for stop in (False, True):
        world.drive(ada, stop=stop)
        assert ada.last(WasRefused) == WasRefused(0, Reason.NOT_ALLOWED)
    world.publish(b"still")
    assert ada.last(Updated) == Updated(b"still")
    with pytest.raises(UsageError):
        world.operations.set_role(1, Role.OPERATE, world.now)


def test_at_most_256_wait_for_approval():
    world = World(waiting_max=3)
    world.operations.close_door()
    phones = [world.join() for _ in range(4)]
    assert phones[-1].last(Ended) == Ended(EndReason.FULL)
    assert phones[2].last(StandingChanged).standing.waiting


# --- leaving ---


def test_who_leaves_frees_its_robot_at_once_and_a_page_that_may_be_loaded_again_after_ten_seconds():
    world = with_robots("R1", assign="one-each")
    ada, bea, cy = (world.join() for _ in range(3))
    world.do(ada, [ada.client._send(Leave(keep=True), world.ms)])
    world.wait(9_000)
    assert bea.last(StandingChanged).standing.place == 1
    world.wait(1_000)
    assert bea.last(StandingChanged).standing.robot == "R1"
    world.do(bea, bea.client.leave(world.ms))
    world.wait(100)
    assert cy.last(StandingChanged).standing.robot == "R1"


# --- commands ---


def test_a_late_command_is_refused_and_a_late_stop_is_not():
    world = with_robots()
    ada = world.join()
    world.drive(ada)
    assert ada.last(WasRefused) == WasRefused(0, Reason.LATE)
    world.publish()
    world.ms += 1000
    assert isinstance(world.drive(ada), Commanded)
    world.ms += 1
    before = len(world.happened)
    world.drive(ada)
    assert not any(isinstance(event, Commanded) for event in world.happened[before:])
    assert world.drive(ada, stop=True).is_stop


def test_a_command_or_request_after_a_later_one_is_late_and_a_stop_is_not():
    world = with_robots()
    ada = world.join()
    world.publish()
    commands = [ada.client.command("R1", "move_raw", bytes([n]), world.ms, stop=n == 1) for n in range(3)]
    asked = [ada.client.request("robots", b"", world.ms)[1] for _ in range(2)]
    for sent in (commands[2], commands[0], commands[1], asked[1], asked[0]):
        world.do(ada, [sent])
    done = [event for event in world.happened if isinstance(event, Commanded | Requested)]
    assert [(event.payload, event.is_stop) for event in done[:2]] == [(b"\2", False), (b"\1", True)]
    assert done[2:] == [Requested(1, 2, "robots", b"")]
    assert ada.all(WasRefused) == [WasRefused(0, Reason.LATE), WasRefused(1, Reason.LATE)]


def test_what_a_visitor_may_do_is_not_undone_by_an_older_record():
    world = with_robots()
    ada = world.join()
    held = []
    carry, world.carry = world.carry, lambda events: held.extend(event for event in events if isinstance(event, Send))
    for role in (Role.WATCH, Role.DRIVE):
        world.carry(world.operations.set_role(1, role, world.now))
    for event in reversed(held):
        carry([event])
    assert ada.last(StandingChanged).standing.role is Role.DRIVE
    assert ada.client.rejected == {"unexpected": 1}


def test_commands_and_requests_of_a_visitor_are_capped():
    world = with_robots()
    ada, bea = world.join(), world.join()
    world.publish()
    for _ in range(30):
        world.drive(ada)
        world.do(ada, [ada.client.request("robots", b"", world.ms)[1]])
    counts = [sum(isinstance(event, kind) for event in world.happened) for kind in (Commanded, Requested)]
    assert counts == [20, 10]
    assert ada.all(WasRefused)[-2:] == [WasRefused(0, Reason.TOO_MANY), WasRefused(30, Reason.TOO_MANY)]
    assert isinstance(world.drive(bea, "R2"), Commanded)
    world.ms += 500
    world.publish()
    assert isinstance(world.drive(ada), Commanded)


@pytest.mark.parametrize(
    "content",
    [b"", b"\x41" + bytes(40), b"\x24", b"\x24" + bytes(30), b"\x26\2", b"\x21\x01\xff", b"\xff"],
)
def test_what_an_authentic_record_says_may_be_garbage_too(content):
    world = with_robots()
    ada = world.join()
    record = ada.client._channel.seal(content)
    assert world.server.receive(ada.connection, record, world.now) == []
    assert world.server.rejected.total() == 1
    assert ada.client.is_joined


def test_a_newcomer_that_does_not_join_is_not_admitted():
    world = World()
    phone = world.dial()
    answer = world.server.receive(phone.connection, phone.client.start(world.ms)[0].data, world.now)
    phone.client._accept(answer[0].data, world.ms)
    from phalanx.link.session.messages import Alive, encode

    world.carry(world.server.receive(phone.connection, phone.client._channel.seal(encode(Alive())), world.now))
    assert phone.closed == "unexpected"
    assert len(world.server.visitors) == 0
    world.do(ada := world.join(), [])
    assert world.server.receive(ada.connection, ada.client._channel.seal(encode(Join("x"))), world.now) == []


# --- bounds ---


def test_connections_and_visitors_are_bounded():
    world = World(connections_max=5, visitors_max=3)
    phones = [world.join() for _ in range(3)]
    full = world.join()
    assert full.last(Ended) == Ended(EndReason.FULL)
    world.carry(world.server.closed(phones[0].connection, world.now))
    assert world.join().client.is_joined
    assert world.resume(phones[0].kept).closed == "unknown_secret"
    assert len(world.server.visitors) == 3
    for _ in range(5):
        world.dial()
    assert len(list(world.server.connections)) == 5
    assert len(world.store.rows) == 4


def test_visitors_whose_time_is_over_make_room_first():
    world = World(visitors_max=2, resume_s=100)
    old, operator = world.join(), world.join(world.ticket(Role.OPERATE))
    for phone in (old, operator):
        world.carry(world.server.closed(phone.connection, world.now))
        phone.closed = "away"
    assert world.join().client.is_joined
    assert world.server.visitors.find(1) is None
    assert world.resume(operator.kept).client.is_joined


def test_tickets_are_bounded():
    world = World(tickets_max=2)
    world.ticket()
    world.ticket()
    with pytest.raises(UsageError) as refused:
        world.ticket()
    assert "3600 s" in refused.value.hint
    assert Ticket(Secret(Kind.TICKET, bytes(16)), Role.WATCH, 1, UNIX_S).uses == 1


@pytest.mark.parametrize("killed", [False, True])
def test_tickets_whose_time_is_over_make_room(killed):
    world = World(tickets_max=2)
    first, second = world.ticket(lifetime_s=60), world.ticket(lifetime_s=61)
    assert [each.secret.id for each in world.server.door.tickets()] == [first.secret.id, second.secret.id]
    world.unix_s += 60
    if killed:
        world.boot()
    third = world.ticket()
    with pytest.raises(UsageError):
        world.ticket()
    world.boot()
    ids = {each.secret.id for each in world.server.door.tickets()}
    assert ids == {second.secret.id, third.secret.id}, "the row is gone as well"
    assert world.join(third).client.is_joined


def test_a_record_of_another_session_is_refused():
    world = with_robots()
    ada, eve = world.join(), world.join()
    sent = [raw for way, number, raw in world.wire if way == "up" and number == ada.connection and raw[0] == RECORD.tag]
    for raw in sent:
        for connection in (ada.connection, eve.connection):
            assert world.server.receive(connection, raw, world.now) == []
    assert world.server.rejected.total() == 2 * len(sent)


def test_an_invitation_names_the_swarm_it_is_for():
    world = World()
    other = Invitation(bytes(31) + b"\x09", world.server.door.code)
    assert other.static != PUBLIC
    assert world.join(other).closed == "not_authentic"
    elsewhere = Invitation(PUBLIC, world.server.door.code, "ws://b/mqtt", "/lab", 5)
    phone = world.dial(elsewhere)
    hello = phone.client.start(world.ms)[-1].data
    world.carry(world.server.receive(phone.connection, hello[: HELLO.size], world.now))
    assert phone.closed == "not_authentic"


class TestAnOlderConnection:
    def test_its_first_record_does_not_take_the_secret_that_the_visitor_has_stored(self):
        """Found by spin: tests/model/session.pml."""
        world = World()
        visitor = world.join(name="Ada")
        world.publish()
        first = visitor.kept
        old = world.dial(world.invitation(first))
        (hello,) = old.client.start(world.ms)
        (answer,) = world.server.receive(old.connection, hello.data, world.now)
        (record,) = old.client.receive(answer.data, world.ms)  # held back on the way
        newer = world.dial(world.invitation(first))
        (hello,) = newer.client.start(world.ms)
        (answer,) = world.server.receive(newer.connection, hello.data, world.now)
        (ready,) = newer.client.receive(answer.data, world.ms)
        told = world.server.receive(newer.connection, ready.data, world.now)
        for event in told:
            if isinstance(event, Send) and event.connection == newer.connection:
                newer.events += newer.client.receive(event.data, world.ms)
        kept = newer.last(KeepSecret).secret  # stored; what says so is on the way
        world.server.receive(old.connection, record.data, world.now)
        assert world.resume(kept).last(Admitted).visitor == visitor.last(Admitted).visitor
