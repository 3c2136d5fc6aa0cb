"""From a visitor's command to the wheels, against a bare websocket's echo and the broker, all in one run.

    python benchmarks/bench_wheels.py [--count 500]

`phalanx up`'s gateway runs in this process, so that both ends have one clock, and so do all visitors; the front end
and mosquitto are children. Ways take turns, message by message: what else the machine does meets all alike.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import statistics
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import aiohttp
from aiohttp import web

from phalanx.gateway import UpOptions, up
from phalanx.link import Client
from phalanx.link.session import parse_invitation
from phalanx.world import Dotbots

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "kit"))
from session_front import visiting

PAUSE_S = 0.06  # a session takes twenty commands a second
PATIENCE_S = 10.0
LOOPBACK = "127.0.0.1"
Way = Callable[[], Awaitable[object]]


class Wheels(Dotbots):
    """Robots that note when their wheels are told to turn."""

    def __init__(self) -> None:
        super().__init__(2, 1, time.time)
        self.turned = asyncio.Event()
        self.at_s = 0.0

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        super().drive(address, left_pct, right_pct)
        if left_pct or right_pct:
            self.at_s = time.perf_counter()
            self.turned.set()


@contextlib.asynccontextmanager
async def a_gateway(wheels: Wheels, **options):
    events: list[dict] = []
    job = asyncio.create_task(up(UpOptions(port=0, **options), events.append, swarm=lambda: wheels))
    try:
        while not events or events[-1]["event"] != "ready":
            if job.done():
                job.result()
            await asyncio.sleep(0.02)
        yield events[-1]
    finally:
        job.cancel()
        await asyncio.wait([job])


@contextlib.asynccontextmanager
async def an_echo():
    """Yield a way through a websocket whose server only answers: half of a round trip is one direction."""

    async def serve(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        async for message in socket:
            await socket.send_bytes(message.data)
        return socket

    app = web.Application()
    app.router.add_get("/", serve)
    runner = web.AppRunner(app, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, LOOPBACK, 0).start()
    record = os.urandom(157)  # as long as a command
    async with aiohttp.ClientSession() as http, http.ws_connect(f"http://{LOOPBACK}:{runner.addresses[0][1]}") as ws:

        async def way() -> None:
            await ws.send_bytes(record)
            await ws.receive_bytes()

        yield way
    await runner.cleanup()


async def measure(count: int) -> dict[str, list[float]]:
    """Return milliseconds, by way."""
    direct, shared = Wheels(), Wheels()
    address = direct.robots()[0].address
    words = {"left_x": 0, "left_y": 40, "right_x": 0, "right_y": 40}
    async with contextlib.AsyncExitStack() as stack:
        enter = stack.enter_async_context
        echo = await enter(an_echo())
        ready = await enter(a_gateway(direct))
        invitation = parse_invitation(ready["qr_url"])
        port = int(ready["page_url"].rstrip("/").rpartition(":")[2])
        ada = await enter(visiting(port, invitation, "Ada"))
        by_broker = await enter(a_gateway(shared, broker="mosquitto"))
        # A page and the Python client send in slots of 0.1 s; the visitor of the tests sends at once.
        bob, eve = [await enter(Client(each["qr_url"])) for each in (ready, by_broker)]
        while not ada.frames:  # noqa: ASYNC110  # a visitor of the tests has no event for it
            await asyncio.sleep(0.02)

        async def until_turned(wheels: Wheels, send: Way) -> float:
            wheels.turned.clear()
            began_s = time.perf_counter()
            await send()
            await asyncio.wait_for(wheels.turned.wait(), PATIENCE_S)
            return (wheels.at_s - began_s) * 1000

        robot, other = direct.robots()[1].address, shared.robots()[0].address
        took: dict[str, list[float]] = {
            "websocket echo, half": [],
            "direct": [],
            "direct, in slots": [],
            "broker, in slots": [],
        }
        for _ in range(count):
            began_s = time.perf_counter()
            await echo()
            took["websocket echo, half"].append((time.perf_counter() - began_s) * 500)
            took["direct"].append(await until_turned(direct, lambda: ada.command(address, "move_raw", words)))
            took["direct, in slots"].append(await until_turned(direct, lambda: bob.command(robot, "move_raw", words)))
            took["broker, in slots"].append(await until_turned(shared, lambda: eve.command(other, "move_raw", words)))
            await asyncio.sleep(PAUSE_S)
    return took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    took = asyncio.run(measure(parser.parse_args().count))
    print("| way | p50, ms | p99, ms |\n|---|---|---|")
    for way, times in took.items():
        print(f"| {way} | {statistics.median(times):.2f} | {sorted(times)[len(times) * 99 // 100]:.2f} |")


if __name__ == "__main__":
    main()
