"""Who drives which robot, and what one visitor may send."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.session import SessionConfig
from phalanx.errors import UsageError
from phalanx.link.session import Role
from phalanx.link.session.assignment import Assignment
from phalanx.link.session.errors import Busy, NotAllowed, TooMany, TriesUsedUp
from phalanx.link.session.limits import ROBOTS_REMEMBERED, RoomCodeAttempts, VisitorLimits
from phalanx.link.session.visitors import Visitor
from session_world import World


def visitor(number: int, role: Role = Role.DRIVE, *robots: str, waiting: bool = False) -> Visitor:
    return Visitor(number, f"v{number}", role, waiting, frozenset(robots), bytes(8), 0, bytes(32))


ADA, BEA, CYD = (visitor(n) for n in (1, 2, 3))
OPERATOR = visitor(9, Role.OPERATE)


def assigned(mode: str = "free", robots: tuple[str, ...] = ("R1", "R2"), *arrive: Visitor) -> Assignment:
    made = Assignment(SessionConfig(assign=mode))
    made.set_robots(robots, 0)
    for each in arrive:
        made.arrive(each, 0)
    return made


# --- free ---


def test_a_robot_has_one_driver_for_ten_seconds_after_each_command():
    made = assigned()
    made.claim(ADA, "R1", 0)
    with pytest.raises(Busy):
        made.claim(BEA, "R1", 9_999)
    made.claim(ADA, "R1", 9_999)
    with pytest.raises(Busy):
        made.claim(BEA, "R1", 19_998)
    assert made.driver_of("R1", 19_998) == 1
    made.claim(BEA, "R1", 19_999)
    assert made.driver_of("R1", 19_999) == 2


def test_a_visitor_has_one_lease_so_that_it_cannot_keep_all_robots():
    made = assigned()
    made.claim(ADA, "R1", 0)
    made.claim(ADA, "R2", 1)
    made.claim(BEA, "R1", 2)
    assert (made.robot_of(1), made.robot_of(2)) == ("R2", "R1")


def test_a_stop_takes_no_lease_and_renews_none_and_needs_the_right_to_drive():
    made = assigned()
    made.claim(ADA, "R1", 0, is_stop=True)
    assert made.driver_of("R1", 0) is None
    made.claim(ADA, "R1", 0)
    made.claim(ADA, "R1", 9_000, is_stop=True)
    assert made.driver_of("R1", 10_000) is None
    made.claim(BEA, "R1", 10_000)
    with pytest.raises(Busy):
        made.claim(ADA, "R1", 10_001, is_stop=True)


@pytest.mark.parametrize("who", [visitor(1, Role.WATCH), visitor(1, waiting=True)])
def test_who_only_watches_or_waits_drives_nothing(who):
    for stop in (False, True):
        with pytest.raises(NotAllowed):
            assigned().claim(who, "R1", 0, is_stop=stop)


def test_no_robot_that_there_is_not_is_driven():
    made = assigned()
    for who in (ADA, OPERATOR):
        with pytest.raises(NotAllowed):
            made.claim(who, "R9", 0)
    for act in (lambda: made.give("R9", ADA, 0), lambda: made.take("R9", 0), lambda: made.swap("R1", "R9")):
        with pytest.raises(NotAllowed):
            act()
    made.claim(ADA, "R2", 0)
    made.set_robots(["R1"], 1)
    assert made.robot_of(1) is None


def test_a_tickets_robots_limit_its_visitor_in_every_mode():
    limited = visitor(1, Role.DRIVE, "R2")
    for mode in ("free", "tickets"):
        made = assigned(mode)
        made.claim(limited, "R2", 0)
        with pytest.raises(NotAllowed):
            made.claim(limited, "R1", 0)
    with pytest.raises(NotAllowed):
        assigned("tickets").claim(ADA, "R1", 0)


def test_an_operator_takes_over_and_what_it_gives_lasts():
    made = assigned()
    made.claim(ADA, "R1", 0)
    made.claim(OPERATOR, "R1", 1)
    with pytest.raises(Busy):
        made.claim(ADA, "R1", 2)
    made.give("R1", BEA, 3)
    made.tick(1_000_000)
    made.claim(OPERATOR, "R1", 1_000_000)
    assert made.driver_of("R1", 1_000_000) == 2
    with pytest.raises(Busy):
        made.claim(ADA, "R1", 1_000_001)
    made.swap("R1", "R2")
    assert made.robot_of(2) == "R2"
    made.take("R2", 1_000_002)
    made.claim(ADA, "R2", 1_000_003)


# --- one each ---


def test_each_visitor_gets_a_robot_and_who_comes_later_queues():
    made = assigned("one-each", ("R1", "R2"), ADA, BEA, CYD)
    assert [made.robot_of(n) for n in (1, 2, 3)] == ["R1", "R2", None]
    assert [made.place_of(n) for n in (1, 2, 3)] == [0, 0, 1]
    made.claim(ADA, "R1", 0)
    for who, robot in ((ADA, "R2"), (CYD, "R1")):
        with pytest.raises(NotAllowed):
            made.claim(who, robot, 0)
    made.leave(1, 1)
    assert made.robot_of(3) == "R1"


def test_turns_are_of_120_s_while_somebody_waits():
    made = assigned("one-each", ("R1",), ADA)
    assert made.left_ms(1, 500_000) == 0
    made.tick(500_000)
    assert made.robot_of(1) == "R1"
    made.arrive(BEA, 500_000)
    assert made.left_ms(1, 500_000) == 1
    made.tick(500_001)
    assert (made.robot_of(2), made.place_of(1)) == ("R1", 1)
    assert made.left_ms(2, 500_001) == 120_000
    made.tick(620_000)
    assert made.robot_of(2) == "R1"
    made.tick(620_001)
    assert made.robot_of(1) == "R1"


def test_a_robot_that_comes_is_given_and_the_driver_of_one_that_goes_is_next():
    made = assigned("one-each", ("R1",), ADA, BEA)
    made.set_robots(["R2"], 1)
    assert (made.robot_of(1), made.place_of(2)) == ("R2", 1)
    made.set_robots(["R2", "R3"], 2)
    assert made.robot_of(2) == "R3"


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_with_one_robot_each_nobody_has_two_nobody_is_lost_and_no_robot_idles(data):
    made = assigned("one-each", ("R1", "R2", "R3"))
    here, now = set(), 0
    for _ in range(data.draw(st.integers(1, 40))):
        now += data.draw(st.integers(0, 100_000))
        who = data.draw(st.integers(1, 6))
        match data.draw(st.integers(0, 6)):
            case 0 | 1:
                made.arrive(visitor(who), now)
                here.add(who)
            case 2:
                made.leave(who, now)
                here.discard(who)
            case 3:
                made.tick(now)
            case 4:
                made.set_robots(data.draw(st.sets(st.sampled_from(["R1", "R2", "R3", "R4"]), min_size=1)), now)
            case 5 if here and made._robots:
                whose = visitor(data.draw(st.sampled_from(sorted(here))))
                made.give(data.draw(st.sampled_from(list(made._robots))), whose, now)
            case 6 if made._robots:
                made.take(data.draw(st.sampled_from(list(made._robots))), now)
        driven = [hold.visitor for hold in made._robots.values() if hold]
        queued = [each for each in range(1, 7) if made.place_of(each)]
        assert len(driven) == len(set(driven))
        assert sorted([*driven, *queued]) == sorted(here)
        assert len(made._queue) == len(set(made._queue))
        assert not queued or None not in made._robots.values()


def test_a_visitor_that_is_back_within_ten_seconds_keeps_its_robot():
    world = World(assign="one-each")
    world.server.assignment.set_robots(["R1"], 0)
    ada, bea = world.join(), world.join()
    world.carry(world.server.closed(ada.connection, world.now))
    ada.closed = "reload"
    world.wait(9_000)
    again = world.resume(ada.kept)
    world.wait(20_000)
    assert world.server.assignment.robot_of(1) == "R1"
    world.carry(world.server.closed(again.connection, world.now))
    again.closed = "gone"
    world.wait(11_000)
    assert world.server.assignment.robot_of(2) == "R1"
    from phalanx.link.session.events import StandingChanged

    assert bea.last(StandingChanged).standing.robot == "R1"


# --- limits ---


def test_routes_are_capped_for_each_robot_and_in_length():
    caps = VisitorLimits(SessionConfig(), 0)
    caps.route("R1", 64, 0)
    caps.route("R1", 64, 0)
    with pytest.raises(TooMany):
        caps.route("R1", 1, 499)
    caps.route("R2", 1, 0)
    caps.route("R1", 1, 500)
    with pytest.raises(TooMany):
        caps.route("R3", 65, 0)
    for n in range(1000):
        caps.route(f"X{n}", 1, 0)
    assert len(caps._routes) == ROBOTS_REMEMBERED


def test_the_memory_of_tries_is_bounded():
    tries = RoomCodeAttempts(SessionConfig())
    refused = 0
    for n in range(5000):
        try:
            tries.count(f"10.0.{n % 200}.1", 0)
        except TriesUsedUp:
            refused += 1
    assert (len(tries._tries), refused) == (120, 4880)
    tries.forgive("10.0.7.1")
    assert len(tries._tries) == 119
    tries.count("10.0.8.1", 1)
    with pytest.raises(TriesUsedUp):
        tries.count("10.0.8.1", 3_599_999)
    tries.count("10.0.8.1", 3_600_000)


@pytest.mark.parametrize("name", ["late_ms", "connections_max", "room_tries"])
def test_parameters_are_positive(name):
    with pytest.raises(UsageError, match=name):
        SessionConfig(**{name: 0})
