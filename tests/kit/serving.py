"""Gateways in this process: with a front end that is none, and as `phalanx up` runs them."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

from phalanx.config.session import SessionConfig
from phalanx.gateway import Gateway, UpOptions, up
from phalanx.gateway.session_link import SessionLink
from phalanx.gateway.trail import Trail
from phalanx.link.session import MemoryStore
from phalanx.net.session_store import new_link_keys
from session_front import FakeFront
from waiting import eventually


@asynccontextmanager
async def meanwhile(*work):
    """What none of is done before it is cancelled."""
    jobs = [asyncio.create_task(each) for each in work]
    try:
        yield
        assert not [job for job in jobs if job.done()]
    finally:
        for job in jobs:
            job.cancel()
        await asyncio.wait(jobs)


@asynccontextmanager
async def serving(swarm, store=None, keys=None, trail=None, **config):
    """A gateway with sessions."""

    async def turn():
        while True:
            swarm.step(0.02)
            await asyncio.sleep(0.02)

    async with FakeFront() as front:
        link = SessionLink(
            front,
            store or MemoryStore(),
            keys or new_link_keys(),
            lambda: [robot.address for robot in swarm.robots()],
            Trail(trail),
            SessionConfig(**config),
        )
        link.port = front.port
        link.front = front
        link.gateway = gateway = Gateway(swarm, link, is_driven=link.is_driven, drivers=link.drivers)
        async with meanwhile(link.run(), gateway.run(), turn()):
            yield link
        link.trail.close()


@asynccontextmanager
async def up_here(swarm, **options):
    """A gateway, and what it says when it is ready."""
    events, gateways = [], []
    said = UpOptions(**{"port": 0} | options)
    job = asyncio.create_task(up(said, events.append, gateways.append, swarm=lambda: swarm))
    ready = lambda: next((each for each in events if each["event"] == "ready"), None)
    try:
        await eventually(lambda: job.done() or ready(), 30)
        if job.done():
            job.result()
        gateways[0].job = job
        yield gateways[0], ready()
    finally:
        job.cancel()
        await asyncio.wait([job])
