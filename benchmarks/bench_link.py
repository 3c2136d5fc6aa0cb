"""What the link costs, as ratios against a peer or a limit measured in the same run.

    python benchmarks/bench_link.py [--quick] [--json]

Times differ between machines and from minute to minute; ratios of two things measured in turn, again and again, hardly
do. Each line is the median over the repetitions, with the smallest and the largest ratio seen.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import logging
import math
import os
import platform
import statistics
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass

import aiomqtt
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from joserfc import jwe
from joserfc.jwk import OctKey

from phalanx.config import LinkConfig
from phalanx.crypto import IV_BYTES, open_jwe, seal_jwe
from phalanx.gateway.frames import Frames
from phalanx.gateway.gateway import TICK_S
from phalanx.io import Client, Server
from phalanx.io.broker import RunningBroker, open_broker
from phalanx.io.ports import free_port
from phalanx.link import Epoch, derive_epoch, new_pin
from phalanx.link.envelope import encode_envelope, open_envelope, seal
from phalanx.link.replay import ReplayCache
from phalanx.robot import Point
from phalanx.sim.dotbots import Dotbots

LINK = LinkConfig()
WHEELS = {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60}
ADDRESS = "DECAFBAD00000001"
HEADER = {"alg": "dir", "enc": "A256GCM"}
SWARMS = (12, 100, 1000)
STEP_S = 0.02
# Commands under way at once, for both: enough to keep everybody busy, and too few for a broker to drop any.
WINDOW = 200


@dataclass(frozen=True, slots=True)
class Line:
    """Ours, what it is held against, and how many times as long ours takes.

    Args:
        what: was measured.
        ours_us: median time of one, microseconds.
        against: the peer or the limit.
        against_us: likewise.
        ratio: ours over theirs, the median over pairs measured one after the other.
        low: the smallest.
        high: the largest.
    """

    what: str
    ours_us: float
    against: str
    against_us: float
    ratio: float
    low: float
    high: float


def timed(job: Callable[[], object], count: int) -> float:
    """Microseconds a call."""
    gc.collect()
    began = time.perf_counter()
    for _ in range(count):
        job()
    return (time.perf_counter() - began) / count * 1e6


def line(what: str, ours: list[float], against: str, theirs: list[float]) -> Line:
    ratios = [mine / other for mine, other in zip(ours, theirs, strict=True)]
    return Line(
        what,
        statistics.median(ours),
        against,
        statistics.median(theirs),
        statistics.median(ratios),
        min(ratios),
        max(ratios),
    )


def fresh_epoch() -> Epoch:
    return derive_epoch(new_pin(LINK.pin_digits, os.urandom))


def bench_codec(repetitions: int, count: int) -> list[Line]:
    """Seal and open one command: the bare token, and the whole envelope with JSON, clock and replay cache."""
    epoch = fresh_epoch()
    plaintext = encode_envelope(WHEELS, time.time())
    raw_key, jose_key = AESGCM(epoch.key.raw), OctKey.import_key(epoch.key.raw)
    cache = ReplayCache(LINK.replay_capacity, LINK.tolerance_s)

    def raw() -> None:
        iv = os.urandom(IV_BYTES)
        assert raw_key.decrypt(iv, raw_key.encrypt(iv, plaintext, b""), b"") == plaintext

    def ours() -> None:
        token = seal_jwe(plaintext, epoch.key, os.urandom(IV_BYTES))
        assert open_jwe(token, epoch.key, LINK.max_to_server_bytes)[1] == plaintext

    def joserfc() -> None:
        assert jwe.decrypt_compact(jwe.encrypt_compact(HEADER, plaintext, jose_key), jose_key).plaintext == plaintext

    def envelope() -> None:
        now_s = time.time()
        token = seal(encode_envelope(WHEELS, now_s), epoch, os.urandom(IV_BYTES))
        open_envelope(token, epoch, now_s, cache, LINK.max_to_server_bytes)

    jobs = {"raw": raw, "ours": ours, "joserfc": joserfc, "envelope": envelope}
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repetitions):
        for name, job in jobs.items():
            times[name].append(timed(job, count))
    size = len(plaintext)
    return [
        line(f"seal+open {size} B, token", times["ours"], "raw AES-GCM", times["raw"]),
        line(f"seal+open {size} B, token", times["ours"], "joserfc", times["joserfc"]),
        line(f"seal+open {size} B, envelope", times["envelope"], "raw AES-GCM", times["raw"]),
        line(f"seal+open {size} B, envelope", times["envelope"], "joserfc", times["joserfc"]),
    ]


class Window:
    """Holds back whoever sends while too much is under way."""

    def __init__(self) -> None:
        self.got = 0
        self._more = asyncio.Event()

    def received(self) -> None:
        self.got += 1
        self._more.set()

    async def send(self, job: Callable[[], Awaitable[object]], count: int) -> float:
        """Microseconds a message, from the first sent to the last received."""
        gc.collect()
        first, began = self.got, time.perf_counter()
        for sent in range(count):
            await job()
            await self._until(first + sent - WINDOW)
        await self._until(first + count)
        return (time.perf_counter() - began) / count * 1e6

    async def _until(self, got: int) -> None:
        while self.got < got:
            self._more.clear()
            # A message that is lost must end the benchmark, not hang it.
            await asyncio.wait_for(self._more.wait(), 10)


async def bench_commands(repetitions: int, count: int) -> list[Line]:
    """Commands through a real mosquitto: our Server and Client, and bare aiomqtt with the same bytes in the clear."""
    async with open_broker("mosquitto", tcp_port=free_port(), ws_port=free_port()) as broker:
        return await _bench_commands(broker, repetitions, count)


async def _bench_commands(broker: RunningBroker, repetitions: int, count: int) -> list[Line]:
    url = broker.url
    ours, bare = Window(), Window()
    server = Server(url, mqtt=broker.mqtt)
    server.on_command("move_raw")(lambda _: ours.received())
    plaintext = encode_envelope(WHEELS, time.time())

    async def listen(client: aiomqtt.Client) -> None:
        async for _ in client.messages:
            bare.received()

    async with server:
        await server.wait_connected(10)
        topic = f"{LINK.root}/{server.epoch.topic[::-1]}/command/0000/{ADDRESS}/0/move_raw"
        async with (
            Client(server.qr(), broker=url) as visitor,
            aiomqtt.Client(url.host, url.port, protocol=aiomqtt.ProtocolVersion.V5) as receiver,
            aiomqtt.Client(url.host, url.port, protocol=aiomqtt.ProtocolVersion.V5) as sender,
        ):
            await receiver.subscribe(topic)
            listening = asyncio.create_task(listen(receiver))
            times: tuple[list[float], list[float]] = [], []
            for _ in range(repetitions):
                times[0].append(await ours.send(lambda: visitor.command(ADDRESS, "move_raw", WHEELS), count))
                times[1].append(await bare.send(lambda: sender.publish(topic, plaintext), count))
            listening.cancel()
    assert not server.rejected, server.rejected
    return [line("command through mosquitto", times[0], "bare aiomqtt, unsealed", times[1])]


def driving(count: int) -> Dotbots:
    """A swarm of which one half is driven and the other half follows a route; nobody stands still."""
    swarm = Dotbots(count, seed=0, clock=time.time)
    for i, robot in enumerate(swarm.robots()):
        if i % 2:
            swarm.follow(robot.address, [Point(200.0 + 1600 * (j % 2), 100.0 * (j % 19)) for j in range(60)], 60)
        else:
            swarm.drive(robot.address, 60, 55)
    return swarm


def bench_tick(robots: int, repetitions: int, ticks: int) -> list[Line]:
    """What a tick costs the gateway: the frame made and sealed, against nothing but its JSON, and against the tick."""
    swarm, frames, epoch = driving(robots), Frames(), fresh_epoch()
    uptime_s = 0.0
    ours: list[float] = []
    plain: list[float] = []
    for _ in range(repetitions):
        gc.collect()
        spent = [0.0, 0.0]
        for _ in range(ticks):
            swarm.step(TICK_S)
            now, uptime_s = swarm.robots(), uptime_s + TICK_S
            began = time.perf_counter()
            now_s = time.time()
            frame = frames.next(now, now_s, uptime_s)
            assert frame is not None
            seal(encode_envelope(frame.payload, now_s), epoch, os.urandom(IV_BYTES))
            sealed = time.perf_counter()
            json.dumps(frame.payload).encode()
            spent[1] += time.perf_counter() - sealed
            spent[0] += sealed - began
        ours.append(spent[0] / ticks * 1e6)
        plain.append(spent[1] / ticks * 1e6)
    tick = [TICK_S * 1e6] * repetitions
    return [
        line(f"notify tick, {robots} robots", ours, "json.dumps of the same", plain),
        line(f"notify tick, {robots} robots", ours, f"{TICK_S * 1000:g} ms between ticks", tick),
    ]


def bench_step(robots: int, repetitions: int, steps: int) -> list[Line]:
    """One step of the simulated swarm against the time until the next."""
    swarm = driving(robots)
    times = [timed(lambda: swarm.step(STEP_S), steps) for _ in range(repetitions)]
    budget = [STEP_S * 1e6] * repetitions
    return [line(f"Dotbots.step, {robots} robots", times, f"{STEP_S * 1000:g} ms between steps", budget)]


def measure(quick: bool) -> list[Line]:
    repetitions = 3 if quick else 15
    share = 0.1 if quick else 1.0

    def say(what: str) -> None:
        print(f"{what} …", file=sys.stderr, flush=True)

    say("codec")
    lines = bench_codec(repetitions, math.ceil(1000 * share))
    say("commands")
    lines += asyncio.run(bench_commands(repetitions, math.ceil(2000 * share)))
    for robots in SWARMS:
        say(f"{robots} robots")
        lines += bench_tick(robots, repetitions, math.ceil(50 * share))
    for robots in SWARMS:
        lines += bench_step(robots, repetitions, math.ceil(200 * share))
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few seconds, and coarse")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    lines = measure(options.quick)
    if options.json:
        machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": os.cpu_count()}
        print(json.dumps({"rows": [asdict(each) for each in lines], **machine}))
        return
    print(f"{'':28} {'ours':>10}  {'against':26} {'theirs':>10}  {'ratio':>7}  {'from':>7} {'to':>7}")
    for each in lines:
        print(
            f"{each.what:28} {each.ours_us:7.1f} µs  {each.against:26} {each.against_us:7.1f} µs"
            f"  {each.ratio:7.3f}  {each.low:7.3f} {each.high:7.3f}"
        )
    for each in lines:
        if each.what.startswith("command "):
            print(f"commands/s: {1e6 / each.ours_us:.0f}, {each.against}: {1e6 / each.against_us:.0f}")


if __name__ == "__main__":
    main()
