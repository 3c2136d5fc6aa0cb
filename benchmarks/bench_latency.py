"""From a visitor's command to the robot's handler, against the broker's own round trip of the same bytes.

One message at a time, ours and theirs in turn, through one mosquitto, all ends in one process.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import time
from collections.abc import Awaitable, Callable

import aiomqtt
from bench_codec import LINK, WHEELS, fresh_epoch
from rows import Row, ratio

from phalanx.crypto import IV_BYTES
from phalanx.link.envelope import encode_envelope, seal
from phalanx.net import QrkeyClient, Server
from phalanx.net.broker import RunningBroker, open_broker
from phalanx.net.ports import free_port

ADDRESS = "DECAFBAD00000001"
MOST_TIMES_BROKER = 2.0
PAUSE_S = 0.002
PATIENCE_S = 10.0


class Arrival:
    """Takes the time from sending a message to its arrival."""

    def __init__(self) -> None:
        self._came = asyncio.Event()
        self._at = 0.0

    def here(self) -> None:
        self._at = time.perf_counter()
        self._came.set()

    async def of(self, send: Callable[[], Awaitable[object]]) -> float:
        """Microseconds."""
        self._came.clear()
        began = time.perf_counter()
        await send()
        # A message that is lost must end the benchmark, not hang it.
        await asyncio.wait_for(self._came.wait(), PATIENCE_S)
        return (self._at - began) * 1e6


async def bench_latency(blocks: int, count: int) -> list[Row]:
    async with open_broker("mosquitto", tcp_port=free_port(), ws_port=free_port()) as broker:
        return await _bench_latency(broker, blocks, count)


async def _bench_latency(broker: RunningBroker, blocks: int, count: int) -> list[Row]:
    url = broker.url
    ours, theirs = Arrival(), Arrival()
    server = Server(url)
    server.on_command("move_raw")(lambda _: ours.here())
    same_bytes = seal(encode_envelope(WHEELS, time.time()), fresh_epoch(), os.urandom(IV_BYTES))

    async def listen(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            assert message.payload == same_bytes
            theirs.here()

    def bare() -> aiomqtt.Client:
        return aiomqtt.Client(url.host, url.port, protocol=aiomqtt.ProtocolVersion.V5)

    async with server:
        await server.wait_connected(PATIENCE_S)
        topic = f"{LINK.root}/{server.epoch.topic[::-1]}/command/0000/{ADDRESS}/0/move_raw"
        async with QrkeyClient(server.qr(), broker=url) as visitor, bare() as receiver, bare() as sender:
            await receiver.subscribe(topic)
            listening = asyncio.create_task(listen(receiver))
            took: list[tuple[list[float], list[float]]] = []
            for _ in range(blocks + 1):
                block: tuple[list[float], list[float]] = ([], [])
                for _ in range(count):
                    block[0].append(await ours.of(lambda: visitor.command(ADDRESS, "move_raw", WHEELS)))
                    await asyncio.sleep(PAUSE_S)
                    block[1].append(await theirs.of(lambda: sender.publish(topic, same_bytes)))
                    await asyncio.sleep(PAUSE_S)
                took.append(block)
            listening.cancel()
    assert not server.rejected, server.rejected
    del took[0]  # warming up
    medians = [[statistics.median(block[i]) for block in took] for i in (0, 1)]
    slow = [sorted(time_us for block in took for time_us in block[i])[-len(took) * count // 20] for i in (0, 1)]
    return [
        ratio(2, "command to handler, p50, of the broker's round trip", *medians, limit=MOST_TIMES_BROKER),
        Row(
            section=0,
            what="… p95",
            measured=slow[0] / slow[1],
            unit="times",
            note=f"{slow[0]:.1f} µs against {slow[1]:.1f} µs",
        ),
    ]
