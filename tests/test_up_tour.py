"""`phalanx up --tour`: the three shields one after the other, with captions, at one address."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager

import pytest

from commands import called
from phalanx.gateway import tour
from phalanx.gateway.demo import plan_swarm, simulated_swarm
from phalanx.gateway.up import UpOptions


def test_it_chooses_what_is_shown():
    for words in (("--mission", "office"), ("--scenario", "patrol"), ("--duration", "5")):
        done = called("up", "--tour", *words)
        assert (done.returncode, "the tour has a fixed program" in done.stderr) == (2, True), done.stderr
    done = called("up", "--tour", "--robots", "3")
    assert (done.returncode, "needs robots that audit" in done.stderr) == (2, True), done.stderr


@pytest.mark.waits
@pytest.mark.timeout(300)
async def test_a_stop_outlives_an_act_and_each_act_says_what_it_shows(monkeypatch, tmp_path):
    monkeypatch.setattr(tour, "ACT_S", 3.0)
    monkeypatch.setattr(tour, "SETTLE_S", 0.1)
    events, gateways, captions = [], [], []

    @contextmanager
    def swarm():
        yield simulated_swarm(plan_swarm(5, None, None), 0, print)

    def started(running):
        gateways.append(running)

    options = UpOptions(state=tmp_path / "state", port=0)
    playing = asyncio.ensure_future(tour.tour(options, events.append, started, swarm, swarm))
    try:
        async with asyncio.timeout(200):
            while len(gateways) < 4:
                assert not playing.done(), playing.exception()
                captions += [gateways[-1].projector.caption] if gateways else []
                if len(gateways) == 2:
                    gateways[1].hold(True)
                await asyncio.sleep(0.05)
            await asyncio.sleep(0.2)
            assert gateways[3].gateway.brakes.held, "the operator has not lifted it"
    finally:
        playing.cancel()
        await asyncio.gather(playing, return_exceptions=True)
    ready = [event for event in events if event["event"] == "ready"]
    assert len({(event["page_url"], event["operator_url"], event["projector_url"]) for event in ready}) == 1
    joined = [event for event in events if event["event"] == "joined"]
    assert joined[0]["name"] == "Tour"
    assert any(event["event"] == "compromised" for event in events)
    for said in ("A visitor drives", "landmarks", "is compromised now"):
        assert any(said in caption for caption in captions), said
