"""Seats at a server: whoever has one address pushes out only who shares it."""

from __future__ import annotations

from phalanx.net.seats import KNOWN_PERCENT, Seats, place_of


class Sitting:
    def __init__(self, seats: Seats, place: str, heard_at_s: float) -> None:
        self.place, self.heard_at_s, self.left, self._seats = place, heard_at_s, False, seats
        seats.take(self)

    def leave(self) -> None:
        self.left = True
        self._seats.gone(self)


def test_a_network_that_one_machine_has_to_itself_is_one_place():
    assert place_of("2001:db8::1") == place_of("2001:db8::ffff:1") != place_of("2001:db8:0:1::1")
    assert place_of("::ffff:192.0.2.7") == place_of("192.0.2.7") != place_of("192.0.2.8")
    assert place_of("fe80::1%eth0") == place_of("fe80::2%eth0")


def test_a_crowd_that_comes_and_says_nothing_pushes_out_nobody_who_was_served_nor_whoever_has_just_come():
    seats: Seats[Sitting] = Seats(100)
    served = [Sitting(seats, "here", float(n)) for n in range(40)]
    elsewhere = [Sitting(seats, "there", 0.0) for _ in range(10)]
    for one in served:
        seats.heard(one)
    for n in range(1000):
        come = [Sitting(seats, "here", 100.0 + n), Sitting(seats, "here", 100.0 + n)]
        assert not come[0].left
        assert len(seats) <= 100
    assert not any(one.left for one in (*served, *elsewhere))


def test_among_who_was_served_it_is_who_was_silent_longest_of_where_most_are():
    seats: Seats[Sitting] = Seats(10)
    sit = [Sitting(seats, "here" if n < 7 else "there", float(n)) for n in range(10)]
    for one in sit:
        seats.heard(one)
    seats.heard(sit[0])
    Sitting(seats, "elsewhere", 20.0)
    assert [one.left for one in sit] == [False, True] + [False] * 8
    assert list(map(len, seats._guests._from.values())) == [6, 3, 1]


def test_who_has_just_come_is_not_pushed_out_by_the_next_one():
    seats: Seats[Sitting] = Seats(10)
    sit = [Sitting(seats, "here", float(n)) for n in range(10)]
    for one in sit:
        seats.heard(one)
    come = [Sitting(seats, "here", 20.0) for _ in range(2)]
    assert [one.left for one in (*sit, *come)] == [True] * 2 + [False] * 10


def test_when_all_are_known_it_is_who_was_silent_longest():
    seats: Seats[Sitting] = Seats(10)
    sit = [Sitting(seats, "here", float(n)) for n in range(10)]
    for one in sit:
        seats.mark_known(one)
    for one in sit[:6]:
        seats.heard(one)
    Sitting(seats, "there", 20.0)
    assert [one.left for one in sit] == [False] * 6 + [True] + [False] * 3


def test_of_places_where_as_many_are_it_is_the_one_that_was_silent_longest():
    seats: Seats[Sitting] = Seats(100)
    sit = [Sitting(seats, f"place {n}", float(n)) for n in range(100)]
    for one in reversed(sit):
        seats.heard(one)
    come = [Sitting(seats, f"more {n}", 200.0) for n in range(30)]
    assert [one for one in (*sit, *come) if one.left] == sit[-30:]
    for one in sit:
        seats.gone(one)
    assert (len(seats), seats._guests._crowd) == (30, 1)


def test_who_is_known_keeps_its_seat_while_there_are_others_and_leaves_some_to_those_who_come():
    seats: Seats[Sitting] = Seats(100)
    known = [Sitting(seats, "school", float(n)) for n in range(50)]
    for one in known:
        seats.heard(one)
        seats.mark_known(one)
    for n in range(1000):
        seats.heard(Sitting(seats, f"flood {n % 200}", 100.0 + n))
    assert len(seats) == 100
    assert not any(one.left for one in known)
    for n in range(200):
        seats.mark_known(late := Sitting(seats, f"more {n % 10}", 2000.0 + n))
        assert not late.left
    assert len(seats._known) <= KNOWN_PERCENT + 1
    assert sum(one.left for one in known) > 25, "of where most are"
    seats.gone(late)
    assert late not in list(seats)
