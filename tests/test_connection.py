"""One MQTT client of ours, on a real broker."""

from __future__ import annotations

import asyncio
import time

import pytest

from phalanx.net.connection import Connection
from stranger import Stranger
from waiting import eventually

pytestmark = pytest.mark.waits


async def test_what_comes_at_once_does_not_wait_for_turns_of_the_loop(broker):
    """Some turns for each message, in which as many more are read, left a gateway no time to hear any."""
    turns, heard_in = 0, []

    async def hear(topic: str, token: bytes) -> None:
        heard_in.append(turns)

    async def ignore(again: bool) -> None: ...

    async def count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    link = Connection(broker.url, "test", lambda: ["x"], hear, ignore)
    living, counting = link.start(), asyncio.create_task(count())
    await link.wait_connected(10)
    async with Stranger(broker.url.port, 4) as stranger:
        for _ in range(300):
            stranger.publish("x", b"rubbish")
        time.sleep(0.5)  # in this very thread: they come together
        await eventually(lambda: len(heard_in) == 300)
    for task in (living, counting):
        task.cancel()
    assert len(set(heard_in)) < 150, "each had turns of its own"
