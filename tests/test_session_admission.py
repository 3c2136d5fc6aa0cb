"""Admission: in whose place newcomers come, and what one visitor may do however often it comes."""

from __future__ import annotations

from typing import Any

import pytest

from phalanx.link.session import Kind, Reason, Role, Secret, parse_room_code
from phalanx.link.session.errors import EndReason, NotAllowed
from phalanx.link.session.events import (
    Admitted,
    Commanded,
    Ended,
    Joined,
    KeepSecret,
    Requested,
    Send,
    StandingChanged,
    WasRefused,
)
from session_world import Phone, World

R1 = "R1"


def with_robots(**config: Any) -> World:
    world = World(**config)
    world.server.assignment.set_robots([R1, "R2"], world.ms)
    return world


def leave(world: World, *phones: Phone) -> None:
    for phone in phones:
        world.carry(world.server.closed(phone.connection, world.now))
        phone.closed = "away"
        world.ms += 10


def joins(world: World, phone: Phone, heard: int = 10) -> None:
    """Have a phone join, and hear so many of the server's records before its connection dies."""
    (hello,) = phone.client.start(world.ms)
    for event in world.server.receive(phone.connection, hello.data, world.now):
        sent = phone.client.receive(event.data, world.ms)
        told = world.server.receive(phone.connection, sent[0].data, world.now)
        for each in told[: heard + 1]:
            if isinstance(each, Send):
                phone.events += phone.client.receive(each.data, world.ms)
        world.happened += told
    phone.closed = "cut"


def store_nothing(world: World) -> None:
    """Let clients store no secret from now on, and say so of none."""
    do = world.do
    world.do = lambda phone, events: do(phone, [each for each in events if not isinstance(each, KeepSecret)])


# --- places ---


def test_whoever_comes_by_the_open_code_takes_no_place_of_a_ticket():
    world = World(visitors_max=4)
    holders = [world.join(world.ticket(role)) for role in (Role.WATCH, Role.DRIVE, Role.OPERATE)]
    leave(world, *holders)
    for n in range(20):
        leave(world, world.join(address=f"10.0.1.{n}"))
    holders = [world.resume(each.kept) for each in holders]
    assert all(each.client.is_joined for each in holders)
    leave(world, *holders)
    last = world.join(world.ticket())
    assert last.client.is_joined, "in the place of who has no ticket"
    leave(world, last)
    assert world.join().last(Ended) == Ended(EndReason.FULL)
    assert all(world.resume(each.kept).client.is_joined for each in holders)


def test_newcomers_without_a_secret_go_first_then_who_has_no_ticket_then_the_lowest_role():
    world = World(visitors_max=4)
    ticket, driver = world.join(world.ticket()), world.join()
    watcher = world.join()
    world.operations.set_role(watcher.last(Admitted).visitor, Role.WATCH, world.now)
    new = world.dial(world.ticket())
    joins(world, new, heard=0)
    world.carry(world.server.closed(new.connection, world.now))
    leave(world, driver, watcher, ticket)
    for gone in (4, watcher.last(Admitted).visitor, driver.last(Admitted).visitor, ticket.last(Admitted).visitor):
        assert world.server.visitors.find(gone)
        assert world.join(world.ticket()).client.is_joined
        assert world.server.visitors.find(gone) is None


def test_an_address_has_so_many_joins_an_hour_without_a_ticket_and_fifty_phones_are_less():
    world = World(joins_per_address=60)
    assert all(world.join().client.is_joined for _ in range(50))
    ended = [world.join().last(Ended) for _ in range(11)]
    assert ended == [None] * 10 + [Ended(EndReason.FULL)]
    assert world.join(address="10.0.0.2").client.is_joined
    assert world.join(world.ticket()).client.is_joined
    world.server.door.show_room()
    assert world.join(world.invitation(parse_room_code(world.server.door.room))).last(Ended)
    world.wait(61_000)
    assert world.join().client.is_joined
    assert world.join().last(Ended) == Ended(EndReason.FULL)


# --- approval ---


def test_who_waits_for_approval_asks_nothing_and_commands_nothing():
    world = with_robots()
    world.operations.close_door()
    eve = world.join()
    world.do(eve, [eve.client.request("robots", b"", world.ms)[1]])
    world.drive(eve)
    world.drive(eve, stop=True)
    assert not [event for event in world.happened if isinstance(event, Requested | Commanded)]
    assert eve.all(WasRefused)[0] == WasRefused(1, Reason.NOT_ALLOWED)
    assert len(eve.all(WasRefused)) == 3
    again = world.resume(eve.kept)
    assert again.last(StandingChanged).standing.waiting
    world.carry(world.operations.approve(1, world.now))
    world.do(again, [again.client.request("robots", b"", world.ms)[1]])
    assert isinstance(world.happened[-1], Requested)


def test_places_of_those_who_wait_are_not_kept_by_who_is_away():
    world = World(waiting_max=3)
    driver = world.join()
    leave(world, driver)
    world.operations.close_door()
    leave(world, *(world.join() for _ in range(3)))
    honest = [world.join() for _ in range(3)]
    assert all(each.last(StandingChanged).standing.waiting for each in honest)
    assert world.join().last(Ended) == Ended(EndReason.FULL)
    assert world.resume(driver.kept).client.is_joined, "who does not wait is not forgotten for it"


# --- room codes ---


def tries(world: World, *addresses: str) -> list[str | None]:
    wrong = world.invitation(Secret(Kind.ROOM, b"00000000"))
    return [world.join(wrong, address=each).closed for each in addresses for _ in range(10)]


def test_an_operators_new_room_code_has_tries_of_its_own_and_used_up_addresses_still_wait():
    world = World()
    world.server.door.show_room()
    attackers = [f"10.0.1.{n}" for n in range(12)]
    assert tries(world, *attackers) == ["not_authentic"] * 120

    def honest() -> Phone:
        return world.join(world.invitation(parse_room_code(world.server.door.room)), address="10.0.9.9")

    assert honest().closed == "tries_used_up"
    world.operations.new_code(world.now)
    assert tries(world, *attackers) == ["tries_used_up"] * 120
    assert honest().client.is_joined
    assert tries(world, *(f"10.0.2.{n}" for n in range(12))) == ["not_authentic"] * 120
    assert honest().closed == "tries_used_up"
    world.server.door.show_room()
    assert honest().client.is_joined


def test_who_is_admitted_gives_those_who_guess_no_more_tries():
    world = World()
    world.server.door.show_room()
    for n in range(11):
        assert tries(world, f"10.0.1.{n}") == ["not_authentic"] * 10
        right = world.invitation(parse_room_code(world.server.door.room))
        assert world.join(right, address="10.0.9.9").client.is_joined
    assert tries(world, "10.0.2.1") == ["not_authentic"] * 10
    assert tries(world, "10.0.2.2") == ["tries_used_up"] * 10


# --- leases ---


def test_only_a_command_that_was_carried_out_takes_or_renews_a_lease():
    world = with_robots()
    ada, bea = world.join(), world.join()
    world.publish()
    carry, held = world.carry, []
    world.carry = lambda events: [
        held.append(event) if isinstance(event, Commanded) else carry([event]) for event in events
    ]
    world.drive(ada)
    assert world.server.assignment.driver_of(R1, world.ms) is None
    carry(world.server.refuse(1, 0, Reason.BAD))
    assert ada.last(StandingChanged).standing.robot == ""
    world.carry = carry
    assert isinstance(world.drive(bea), Commanded)
    assert bea.last(StandingChanged).standing.robot == R1
    assert len(held) == 1


def test_another_visitors_robot_is_not_stopped_but_by_an_operator():
    world = with_robots()
    ada, bea, op = world.join(), world.join(), world.join(world.ticket(Role.OPERATE))
    world.publish()
    world.drive(ada)
    world.drive(bea, stop=True)
    assert bea.last(WasRefused) == WasRefused(0, Reason.BUSY)
    assert world.drive(op, stop=True).is_stop
    assert world.server.assignment.driver_of(R1, world.ms) == 1


def test_a_robot_is_given_only_to_who_may_drive_it():
    world = with_robots()
    ada, limited = world.join(), world.join(world.ticket(robots=frozenset({"R2"})))
    with pytest.raises(NotAllowed):
        world.operations.give(R1, limited.last(Admitted).visitor, world.now)
    world.operations.set_role(1, Role.WATCH, world.now)
    with pytest.raises(NotAllowed):
        world.operations.give(R1, 1, world.now)
    world.operations.close_door()
    waits = world.join()
    with pytest.raises(NotAllowed):
        world.operations.give(R1, waits.last(Admitted).visitor, world.now)
    world.operations.set_role(1, Role.DRIVE, world.now)
    world.operations.give(R1, 1, world.now)
    world.operations.give("R2", limited.last(Admitted).visitor, world.now)
    with pytest.raises(NotAllowed):
        world.operations.swap(R1, "R2", world.now)
    assert world.server.assignment.robot_of(1) == R1
    assert ada.client.is_joined


# --- caps ---


def test_a_visitor_that_resumes_has_no_fresh_burst():
    world = with_robots()
    ada = world.join()
    world.publish()
    for _ in range(3):
        for _ in range(20):
            world.drive(ada)
            world.do(ada, [ada.client.request("robots", b"", world.ms)[1]])
        leave(world, ada)
        ada = world.resume(ada.kept)
        world.publish()
    counts = [sum(isinstance(event, kind) for event in world.happened) for kind in (Commanded, Requested)]
    assert counts == [20, 10]


def test_the_caps_of_all_visitors_are_bounded():
    world = World(visitors_max=3)
    for n in range(10):
        world.server.caps.of(n, 0).command(0)
    assert len(world.server.caps._of) == 3


def test_resumptions_are_limited_and_come_back():
    world = World(handshakes_at_once=5, handshakes_per_min=12)
    ada, secrets = world.join(), []
    for _ in range(6):
        leave(world, ada)
        secrets.append(ada.kept)
        last, ada = ada, world.resume(ada.kept)
    assert ada.last(Ended) == Ended(EndReason.FULL)
    assert last.kept == secrets[-1]
    world.wait(5_000)
    assert world.resume(last.kept).client.is_joined


def test_repeated_first_messages_of_others_use_up_nothing():
    world = World(handshakes_at_once=3, handshakes_per_min=1)
    ada = world.join()
    hello = world.dial(world.invitation(ada.kept)).client.start(world.ms)[0].data
    for _ in range(20):
        listener = world.dial()
        assert world.server.receive(listener.connection, hello, world.now)
    assert world.resume(ada.kept).client.is_joined


def test_a_session_that_makes_new_keys_without_end_is_refused():
    world = World(handshakes_at_once=3, handshakes_per_min=1, rekey_ms=1_000)
    ada = world.join()
    world.wait(10_000)
    assert world.server.rejected["too_many"]
    written = len(ada.all(KeepSecret))
    assert written <= 5, "each is written to disk"


# --- a ticket for one use ---


@pytest.mark.parametrize("heard", [0, 1])
@pytest.mark.parametrize("killed", [False, True])
def test_a_ticket_admits_again_until_its_visitor_has_a_secret(heard, killed):
    world = with_robots()
    ticket = world.ticket(name="Ada")
    first = world.dial(ticket)
    joins(world, first, heard)
    assert not first.all(KeepSecret)
    if killed:
        world.boot()
    second = world.join(ticket)
    assert (second.client.is_joined, second.last(Admitted).name) == (True, "Ada")
    assert [each.id for each in world.server.visitors] == [2], "it took the other's place"
    assert world.join(ticket).closed == "unknown_secret"
    leave(world, second)
    world.boot()
    assert world.resume(second.kept).last(Admitted).visitor == 2
    assert not world.server.door.tickets()


def test_the_one_before_is_ended_and_its_secret_is_dead():
    world = with_robots()
    ticket = world.ticket()
    first = world.dial(ticket)
    store_nothing(world)
    world.do(first, first.client.start(world.ms))
    assert first.client.is_joined
    world.publish()
    world.drive(first)
    (row,) = world.server.visitors
    second = world.join(ticket)
    assert first.last(Ended) == Ended(EndReason.REPLACED)
    assert second.client.is_joined
    assert world.server.assignment.driver_of(R1, world.ms) is None
    assert world.resume(Secret(Kind.RESUME, row.pending)).closed == "unknown_secret"
    assert len(world.server.visitors) == 1


def test_a_newcomer_that_resumes_has_used_its_ticket():
    world = World()
    ticket = world.ticket()
    first = world.dial(ticket)
    joins(world, first, heard=2)
    secret = first.last(KeepSecret).secret
    assert world.server.door.tickets()
    assert world.resume(secret).client.is_joined
    assert world.join(ticket).closed == "unknown_secret"


def test_a_ticket_for_two_uses_has_two_visitors_and_no_more():
    world = World()
    ticket = world.ticket(uses=2)
    phones = [world.dial(ticket) for _ in range(3)]
    for phone in phones:
        joins(world, phone, heard=0)
    assert [each.id for each in world.server.visitors] == [2, 3]
    world.join(ticket)
    assert [each.id for each in world.server.visitors] == [3, 4]
    world.join(ticket)
    assert world.join(ticket).closed == "unknown_secret"
    assert len(world.server.visitors) == 2


def test_who_comes_again_and_again_by_one_ticket_has_one_visitors_caps():
    world = with_robots(handshakes_at_once=5, handshakes_per_min=1)
    ticket = world.ticket()
    world.publish()
    store_nothing(world)
    for _ in range(9):
        phone = world.join(ticket)
        world.publish()
        for _ in range(20):
            if phone.client.is_joined:
                world.drive(phone)
    assert sum(isinstance(event, Commanded) for event in world.happened) == 20
    assert sum(isinstance(event, Joined) for event in world.happened) == 6


def test_removing_a_newcomer_revokes_its_ticket():
    world = World()
    ticket = world.ticket()
    joins(world, world.dial(ticket), heard=0)
    world.carry(world.operations.remove(1, world.now))
    assert world.join(ticket).closed == "unknown_secret"
    world.boot()
    assert world.join(ticket).closed == "unknown_secret"
