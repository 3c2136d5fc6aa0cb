"""Many visitors in one process, as cheap as honest: MQTT over websockets by hand, for the broker sends browsers nothing
else; a `ClientSide` each, and every message really opened.

    python benchmarks/fleet_visitors.py < order

The order is one JSON line. Every further line on stdin is answered with the counters since the last one.
"""

from __future__ import annotations

import asyncio
import base64
import gc
import json
import os
import random
import sys
import time
from collections import Counter
from typing import Any

from phalanx.config import LinkConfig
from phalanx.io import parse_broker_url
from phalanx.link import QrUrl, parse_qr_url
from phalanx.link.client_side import ClientSide
from phalanx.link.messages import Moved, Notification, Publish, Rejected, Reply, Subscribe
from phalanx.link.topics import CommandTopic

FRAME = 16
ROBOTS = 0
KEEPALIVE_S = 30
# As web/client/watch.ts asks: about once a minute, and after a gap.
ASK_EVERY_S, ASK_JITTER_S = 60.0, 10.0
GAP_JITTER_S, ASK_GAP_S = 0.5, 1.0
# 64 places at random keep a robot busy for about five minutes.
WAYPOINTS, THRESHOLD_MM, ROUTE_S = 64, 60, 240.0
EDGE_MM = 100
# Frames of one tick leave within milliseconds, those of the next a tenth of a second later.
SAME_TICK_S = 0.03
BINARY, CLOSE, PING, PONG = 2, 8, 9, 10
CONNACK, PUBLISH, SUBACK = 2, 3, 9


def _string(text: str) -> bytes:
    raw = text.encode()
    return len(raw).to_bytes(2, "big") + raw


def packet(kind: int, body: bytes) -> bytes:
    """An MQTT 3.1.1 packet; `kind` is its first byte."""
    length, left = bytearray(), len(body)
    while True:
        left, seven = left >> 7, left & 127
        length.append(seven | (128 if left else 0))
        if not left:
            return bytes((kind,)) + length + body


def websocket_frame(kind: int, payload: bytes) -> bytes:
    """A masked frame, as clients must send them."""
    mask, size = os.urandom(4), len(payload)
    head = bytes((0x80 | kind,))
    head += bytes((0x80 | size,)) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
    key = (mask * (size // 4 + 1))[:size]
    return head + mask + (int.from_bytes(payload, "big") ^ int.from_bytes(key, "big")).to_bytes(size, "big")


class Tally:
    """What all visitors of this process counted since they were asked last."""

    def __init__(self) -> None:
        self.messages = 0
        self.bytes = 0
        self.frames = 0
        self.gaps = 0
        self.missed = 0
        self.asked = 0
        self.answered = 0
        self.commands = 0
        self.rejected: Counter[str] = Counter()
        self.ages_ms: Counter[int] = Counter()


class Visitor(asyncio.Protocol):
    """One visitor on one connection."""

    def __init__(self, qr: QrUrl, name: str) -> None:
        self.side = ClientSide(LinkConfig(root=qr.root), os.urandom, qr.pin, name)
        self.broker = parse_broker_url(qr.broker)
        self.tally = Tally()
        self.ready = asyncio.get_running_loop().create_future()
        self.listed = asyncio.Event()
        self.robots: list[dict[str, Any]] = []
        self.lost = False
        self.frames = self.frames_missed = self.ticks = 0
        self.worst_age_s = 0.0
        self.sent_at_s = 0.0
        self._seq: int | None = None
        self._ask_at = 0.0
        self._asked_at = 0.0
        self._upgraded = False
        self._bytes, self._packets = bytearray(), bytearray()
        self._transport: asyncio.Transport | None = None

    # --- the wire ---

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.write(
            (
                f"GET {self.broker.path} HTTP/1.1\r\nHost: {self.broker.host}:{self.broker.port}\r\n"
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\n"
                "Sec-WebSocket-Protocol: mqtt\r\n\r\n"
            ).encode()
        )

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self.lost = True
        if not self.ready.done():
            self.ready.set_exception(ConnectionError("the broker hung up"))

    def data_received(self, data: bytes) -> None:
        self._bytes += data
        if not self._upgraded:
            end = self._bytes.find(b"\r\n\r\n")
            if end < 0:
                return
            assert self._bytes.startswith(b"HTTP/1.1 101"), bytes(self._bytes[:end])
            del self._bytes[: end + 4]
            self._upgraded = True
            self.send(
                0x10, _string("MQTT") + b"\x04\x02" + (2 * KEEPALIVE_S).to_bytes(2, "big") + _string(_random_id())
            )
        self._take_websocket_frames()
        self._take_packets()

    def send(self, kind: int, body: bytes) -> None:
        if self._transport and not self.lost:
            self._transport.write(websocket_frame(BINARY, packet(kind, body)))

    def _take_websocket_frames(self) -> None:
        held, at = self._bytes, 0
        while len(held) - at >= 2:
            size, start = held[at + 1], at + 2
            if size >= 126:
                start += 2 if size == 126 else 8
                if len(held) < start:
                    break
                size = int.from_bytes(held[at + 2 : start], "big")
            if len(held) < start + size:
                break
            kind = held[at] & 15
            if kind <= BINARY:
                self._packets += held[start : start + size]
            elif kind == PING and self._transport:
                self._transport.write(websocket_frame(PONG, bytes(held[start : start + size])))
            elif kind == CLOSE and self._transport:
                self._transport.close()
            at = start + size
        del held[:at]

    def _take_packets(self) -> None:
        held, at = self._packets, 0
        while len(held) - at >= 2:
            size, shift, start = 0, 0, at + 1
            while start < len(held):
                byte = held[start]
                size |= (byte & 127) << shift
                shift += 7
                start += 1
                if byte < 128:
                    break
            else:
                break
            if len(held) < start + size:
                break
            kind = held[at] >> 4
            if kind == PUBLISH:
                topic_end = start + 2 + (held[start] << 8 | held[start + 1])
                self._on_message(held[start + 2 : topic_end].decode(), bytes(held[topic_end : start + size]))
            elif kind == CONNACK:
                assert held[start + 1] == 0, "the broker refused"
                self._carry_out(map(Subscribe, self.side.subscriptions()))
            elif kind == SUBACK and not self.ready.done():
                self.ready.set_result(None)
            at = start + size
        del held[:at]

    # --- the link ---

    def _on_message(self, topic: str, token: bytes) -> None:
        now_s, tally = time.time(), self.tally
        tally.messages += 1
        tally.bytes += len(token)
        said = self.side.receive(topic, token, now_s)
        if isinstance(said, Notification):
            if said.payload.get("cmd") == FRAME:
                self._on_frame(said.payload["data"], said.timestamp_s, now_s)
        elif isinstance(said, Rejected):
            tally.rejected[said.reason] += 1
        elif isinstance(said, Reply):
            if said.number == ROBOTS:
                tally.answered += 1
                self.robots = said.data
                self.listed.set()
        elif isinstance(said, Moved):
            self._carry_out(said.asks)

    def _on_frame(self, frame: dict[str, Any], sent_at_s: float, now_s: float) -> None:
        assert isinstance(frame["robots"], list)
        seq, tally, age_s = frame["seq"], self.tally, now_s - sent_at_s
        self.ticks += sent_at_s - self.sent_at_s > SAME_TICK_S
        self.sent_at_s = sent_at_s
        tally.frames += 1
        tally.ages_ms[int(age_s * 1000)] += 1
        self.frames += 1
        self.worst_age_s = max(self.worst_age_s, age_s)
        if self._seq is not None and seq != self._seq + 1:
            tally.gaps += 1
            tally.missed += max(0, seq - self._seq - 1)
            self.frames_missed += max(0, seq - self._seq - 1)
            self._ask_at = min(self._ask_at, time.monotonic() + random.uniform(0, GAP_JITTER_S))
        self._seq = seq

    def _carry_out(self, asks: Any) -> None:
        for ask in asks:
            if isinstance(ask, Publish):
                self.send(0x30, _string(ask.topic) + ask.payload)
            elif isinstance(ask, Subscribe):
                self.send(0x82, b"\0\1" + _string(ask.topic) + b"\0")
            else:
                self.send(0xA2, b"\0\1" + _string(ask.topic))

    def tick(self) -> None:
        """Ask what is due; called several times a second."""
        now = time.monotonic()
        if now >= self._ask_at and now - self._asked_at >= ASK_GAP_S:
            self._asked_at = now
            self._ask_at = now + ASK_EVERY_S + random.uniform(0, ASK_JITTER_S)
            self.tally.asked += 1
            self._carry_out((self.side.request(ROBOTS, time.time(), frames=True),))

    def keep_alive(self) -> None:
        self.send(0xC0, b"")

    def send_round(self, address: str, area_mm: tuple[int, int]) -> None:
        """Send a robot on a long tour."""
        width, height = area_mm
        points = [
            {"x": random.randint(EDGE_MM, width - EDGE_MM), "y": random.randint(EDGE_MM, height - EDGE_MM), "z": 0}
            for _ in range(WAYPOINTS)
        ]
        route = {"threshold": THRESHOLD_MM, "waypoints": points}
        self.tally.commands += 1
        self._carry_out((self.side.command(CommandTopic(address, "0", "waypoints"), route, time.time()),))


def _random_id() -> str:
    return f"bench{os.urandom(8).hex()}"


class Crowd:
    """All visitors of this process.

    Args:
        order: `qr`, `visitors` here, `join_per_s`, `first` robot and `every` so many that ours send round, and
            `commands_per_s`.
    """

    def __init__(self, order: dict[str, Any]) -> None:
        self._order = order
        self._tally = Tally()
        self.visitors: list[Visitor] = []

    async def join(self) -> None:
        qr = parse_qr_url(self._order["qr"])
        loop = asyncio.get_running_loop()
        for i in range(self._order["visitors"]):
            visitor = Visitor(qr, f"bench_{os.getpid()}_{i}")
            visitor.tally = self._tally
            await loop.create_connection(lambda visitor=visitor: visitor, visitor.broker.host, visitor.broker.port)
            await asyncio.wait_for(visitor.ready, 10)
            visitor.tick()
            self.visitors.append(visitor)
            await asyncio.sleep(1 / self._order["join_per_s"])
        for visitor in self.visitors:
            await asyncio.wait_for(visitor.listed.wait(), 30)

    async def ask(self) -> None:
        while True:
            for visitor in self.visitors:
                visitor.tick()
            await asyncio.sleep(0.2)

    async def keep_alive(self) -> None:
        while True:
            await asyncio.sleep(KEEPALIVE_S)
            for visitor in self.visitors:
                visitor.keep_alive()

    async def send_round(self) -> None:
        """Every robot of ours gets a route, and another before it has arrived."""
        visitor = self.visitors[0]
        addresses = sorted(robot["address"] for robot in visitor.robots)[self._order["first"] :: self._order["every"]]
        pause_s = 1 / self._order["commands_per_s"]
        while True:
            for i, address in enumerate(addresses):
                self.visitors[i % len(self.visitors)].send_round(address, (2000, 2000))
                await asyncio.sleep(pause_s)
            pause_s = ROUTE_S / len(addresses)

    def report(self) -> dict[str, Any]:
        tally, now_s = self._tally, time.time()
        for visitor in self.visitors:
            # What is still on its way counts as late, too.
            visitor.worst_age_s = max(visitor.worst_age_s, now_s - visitor.sent_at_s)
        told = {
            "visitors": len(self.visitors),
            "lost": sum(visitor.lost for visitor in self.visitors),
            # Each visitor's own share: got, missed, the oldest, and ticks seen.
            "each": [[v.frames, v.frames_missed, round(v.worst_age_s, 3), v.ticks] for v in self.visitors],
            **{key: value for key, value in vars(tally).items() if not isinstance(value, Counter)},
            "rejected": dict(tally.rejected),
            "ages_ms": {str(age): count for age, count in tally.ages_ms.items()},
        }
        self._tally = Tally()
        for visitor in self.visitors:
            visitor.tally = self._tally
            visitor.frames = visitor.frames_missed = visitor.ticks = 0
            visitor.worst_age_s = 0.0
        return told


async def main() -> None:
    stdin = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin)
    crowd = Crowd(json.loads(await stdin.readline()))
    jobs = [asyncio.create_task(job) for job in (crowd.ask(), crowd.keep_alive())]
    await crowd.join()
    # What is parsed dies by its reference count; looking through all that lives for cycles is no part of a visit.
    gc.freeze()
    gc.set_threshold(50_000, 50, 50)
    print(json.dumps({"joined": len(crowd.visitors)}), flush=True)
    while line := (await stdin.readline()).decode().strip():
        if line == "go":
            jobs.append(asyncio.create_task(crowd.send_round()))
        print(json.dumps(crowd.report()), flush=True)
    for job in jobs:
        job.cancel()


if __name__ == "__main__":
    asyncio.run(main())
