"""Size and time of what a visitor and its gateway send tell nobody what it does, or with which robot."""

from __future__ import annotations

import pytest

import traffic
from phalanx.gateway import session_link
from phalanx.gateway.trail import Trail
from phalanx.link.session import MemoryStore, padding
from phalanx.net.session_client import Client
from phalanx.net.session_store import new_link_keys
from session_front import FakeFront
from virtual_time import run_in_virtual_time

CHANCE, MARGIN = 0.5, 0.05  # classes weigh the same


@pytest.fixture
def best(monkeypatch):
    """How well the best classifier tells forward from stop, robots apart, and who asks from who does not."""

    def of(worlds, for_s):
        windows = run_in_virtual_time(traffic.windows(worlds, for_s), monkeypatch)
        found = traffic.guesses(*windows)
        print(len(windows[0]), "windows", *found)
        return tuple(max(each.values()) for each in found)

    return of


def test_a_listener_tells_neither_forward_from_stop_nor_one_robot_from_another_nor_requests(best):
    assert max(best(24, 24)) <= CHANCE + MARGIN


def test_without_padding_both_are_told(best, monkeypatch):
    monkeypatch.setattr(padding, "padded_size", lambda length: length + padding.PADDED.size)
    action, robot, _ = best(8, 8)
    assert action > 0.8
    assert robot > 0.8


def test_without_the_constant_rate_forward_is_told_from_stop(best, monkeypatch):
    monkeypatch.setattr(Client, "_is_paced", property(lambda self: False))
    action, *_ = best(8, 8)
    assert action > 0.9


def test_requests_outside_of_the_slots_are_told(best, monkeypatch):
    say = Client._say

    async def at_once(self, record, robot="", *, stop=False):
        await (say(self, record, robot, stop=stop) if robot else self._connection.transmit(record))

    monkeypatch.setattr(Client, "_say", at_once)
    assert best(8, 8)[2] > 0.8


def test_without_an_update_each_tick_forward_is_told_from_stop(best, monkeypatch):
    notify = session_link.SessionLink.notify

    async def only_news(self, payload):
        return payload["data"].keys() == {"seq"} or await notify(self, payload)

    monkeypatch.setattr(session_link.SessionLink, "notify", only_news)
    action, *_ = best(8, 8)
    assert action > 0.9


async def test_an_update_without_news_is_as_long_as_one_with():
    sent = []
    link = session_link.SessionLink(FakeFront(), MemoryStore(), new_link_keys(), list, Trail(None))
    link.carry = lambda events: sent.extend(len(each.data) for each in events)
    await link.notify({"seq": 1})
    await link.notify({"seq": 2, "places": "x" * 400})
    await link.notify({"seq": 3})
    await link.notify({"seq": 4, "joined": "x" * 5000})
    await link.notify({"seq": 5})
    short, news, silent, long, after = sent
    assert short < news == silent < after < long
    assert after - news == 2048 - 512, "the equal length is bounded"
    for _ in range(session_link.EQUAL_TICKS):
        await link.notify({"seq": 6})
    assert sent[-1] == short
