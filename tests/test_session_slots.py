"""The order in which a client says things at a constant rate."""

from __future__ import annotations

import pytest

from phalanx.errors import UsageError
from phalanx.link.session.slots import LONGEST, Slots


class Client:
    alive = "alive"


def taken(slots, count):
    return [slots.take(Client) for _ in range(count)]


def test_every_slot_has_something():
    slots = Slots()
    assert taken(slots, 2) == ["alive", "alive"]
    slots.steady = "wheels"
    assert taken(slots, 2) == ["wheels", "wheels"]


def test_what_waits_leaves_every_other_slot_to_the_wheels():
    slots = Slots()
    slots.steady = "wheels"
    for each in ("one", "two"):
        slots.put(each)
    said = taken(slots, 5)
    assert said.count("wheels") == 3
    assert [each for each in said if each != "wheels"] == ["one", "two"]


def test_it_says_whether_something_waits():
    """Or a command is never sent, if its robot is taken away before its slot comes."""
    slots = Slots()
    slots.steady = "wheels"
    assert not slots.waits
    slots.put("one")
    slots.stop("stop", "A1")
    assert taken(slots, 1) == ["stop"]
    assert slots.waits
    assert "one" in taken(slots, 2)
    assert not slots.waits


def test_a_stop_comes_first_and_drops_the_robot_s_commands_before_it():
    slots, dropped = Slots(), []
    slots.put("route", "A1", lambda: dropped.append("route"))
    slots.put("colour", "B2", lambda: dropped.append("colour"))
    slots.put("robots")
    slots.stop("stop", "A1")
    slots.put("later route", "A1")
    assert taken(slots, 5) == ["stop", "colour", "robots", "later route", "alive"]
    assert dropped == ["route"]


def test_what_waits_is_bounded_and_a_stop_is_always_taken():
    slots = Slots()
    for _ in range(LONGEST):
        slots.put("x")
    with pytest.raises(UsageError, match="are queued already"):
        slots.put("x")
    slots.stop("stop", "A1")
    assert slots.take(Client) == "stop"
    slots.clear()
    assert taken(slots, 1) == ["alive"]
