"""A server that is said more than it can read reads what is new, and not what is late already."""

from __future__ import annotations

import math
import random
from types import SimpleNamespace

import pytest

from phalanx.net import incoming as where
from phalanx.net.broker_packets import Arrived
from phalanx.net.incoming import BACKLOG, STALE_S, Incoming

ARRIVE, READ_MS, SECONDS = 2, 1, 10  # twice as many come as can be read


class Clock:
    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


def flooded(monkeypatch, stale_s: float) -> tuple[list[float], float, int]:
    """For how long each message that was read had waited, the share of honest ones that was
    read in time, and how many were dropped unread."""
    clock = Clock()
    monkeypatch.setattr(where, "time", clock)
    emptied = SimpleNamespace(at_s=clock.now_s)
    dropped, waited, read = [], [], []
    incoming = Incoming(lambda: dropped.append(1), emptied, waited.append, 2000, stale_s=stale_s)
    chance, said = random.Random(1), 0
    for _ in range(SECONDS * 1000 // READ_MS):
        clock.now_s += READ_MS / 1000
        emptied.at_s = clock.now_s
        for _ in range(ARRIVE):
            honest = chance.random() < 0.01
            said += honest
            payload = b"honest" if honest else b"flood"
            incoming.put_nowait(Arrived("a", payload))
        read.append(incoming.get_nowait())
    fresh = [message for message, waited_s in zip(read, waited, strict=True) if waited_s <= 0.3]
    return waited, sum(message.payload == b"honest" for message in fresh) / said, len(dropped)


def test_half_of_all_is_read_and_nothing_of_that_has_waited_long(monkeypatch):
    waited, honest, dropped = flooded(monkeypatch, STALE_S)
    assert max(waited) <= STALE_S + 0.01
    assert 0.4 <= honest <= 0.6, "as half of all messages can be read"
    assert dropped == pytest.approx(SECONDS * 1000, rel=0.1)


def test_in_the_order_in_which_they_came_all_that_is_read_would_be_late(monkeypatch):
    waited, honest, _ = flooded(monkeypatch, math.inf)
    assert max(waited) > 1
    assert honest < 0.1


def test_a_hiccup_costs_nothing(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(where, "time", clock)
    waited, dropped = [], []
    incoming = Incoming(lambda: dropped.append(1), SimpleNamespace(at_s=clock.now_s), waited.append, stale_s=STALE_S)
    for _ in range(BACKLOG):
        incoming.put_nowait(Arrived("a", b""))
    clock.now_s += 0.8
    for _ in range(BACKLOG):
        incoming.get_nowait()
    assert (len(waited), dropped) == (BACKLOG, [])
