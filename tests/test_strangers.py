"""What a stranger without the pin sends to the broker of a running gateway: nothing freezes, fills or silences it."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from typing import Self

from conftest import a_gateway, a_server, bare_mosquitto, eventually
from phalanx.io import Client, Server
from phalanx.io.ports import free_port
from phalanx.link.envelope import encode_envelope, seal


def with_length(kind: int, body: bytes) -> bytes:
    """An MQTT packet."""
    return bytes([kind]) + varint(len(body)) + body


def varint(number: int) -> bytes:
    said = bytearray()
    while True:
        number, low = divmod(number, 128)
        said.append(low | (128 if number else 0))
        if not number:
            return bytes(said)


def connect(version: int, name: bytes = b"stranger", *, clean: bool = True, keepalive_s: int = 60) -> bytes:
    head = b"\x00\x04MQTT" + bytes([version, 2 if clean else 0]) + keepalive_s.to_bytes(2, "big")
    return with_length(0x10, head + (b"\x00" if version == 5 else b"") + len(name).to_bytes(2, "big") + name)


class Stranger:
    """A raw MQTT connection, by TCP on loopback."""

    def __init__(self, port: int, version: int = 5, **how) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), 5)
        self.socket.settimeout(5)
        self.socket.sendall(connect(version, **how))
        assert self.socket.recv(64)[:1] == b"\x20"

    def publish(self, topic: str, payload: bytes, properties: bytes | None = None) -> None:
        """At QoS 0; `properties` only by MQTT 5, and there always."""
        head = len(topic).to_bytes(2, "big") + topic.encode()
        head += b"" if properties is None else varint(len(properties)) + properties
        self.socket.sendall(with_length(0x30, head + payload))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()


class TestNothingFreezesTheGateway:
    async def test_a_hundred_thousand_empty_user_properties_hold_nothing_up(self):
        bomb = b"\x26\x00\x00\x00\x00" * 100_000
        with a_gateway("--robots", "2") as (gateway, ready):
            async with Client(ready["qr_url"]) as visitor:
                robot = (await visitor.request(0))[0]["address"]
                with Stranger(ready["broker_port"]) as stranger:
                    await visitor.command(robot, "move_raw", {"left_x": 0, "left_y": 60, "right_x": 0, "right_y": 60})
                    await asyncio.to_thread(stranger.publish, f"/qrkey/{ready['topic']}/request", b"x", bomb)
                    began_s = time.monotonic()
                    await asyncio.sleep(0.1)
                    await visitor.request(1, timeout_s=60)
                    # 91 s, when each was compared with all others.
                    assert time.monotonic() - began_s < 5
                await eventually(lambda: any(e["reason"] == "too_large" for e in gateway.events("rejected")))

    async def test_a_foreign_broker_that_passes_everything_on_holds_nothing_up_either(self, tmp_path):
        tcp = free_port()
        with bare_mosquitto(tcp, free_port(), tmp_path) as (start, _):
            start()
            async with Server(f"mqtt://127.0.0.1:{tcp}") as server:
                await server.wait_connected(10)
                request = f"/qrkey/{server.epoch.topic}/request"
                with Stranger(tcp) as stranger:
                    before_s = time.thread_time()
                    await asyncio.to_thread(stranger.publish, request, b"x", b"\x26\x00\x00\x00\x00" * 200_000)
                    command = f"/qrkey/{server.epoch.topic}/command/{'a/' * 150}{'b' * 60_000}"
                    await asyncio.to_thread(stranger.publish, command, b"x", b"")
                    await eventually(lambda: server.rejected == {"too_large": 2})
                    assert time.thread_time() - before_s < 1
                assert server.reconnects == 0

    async def test_a_packet_longer_than_any_is_skipped_and_the_connection_lives(self, tmp_path):
        tcp = free_port()
        with bare_mosquitto(tcp, free_port(), tmp_path) as (start, _):
            start()
            # By the older protocol nobody can tell a broker how much they read.
            async with Server(f"mqtt://127.0.0.1:{tcp}", mqtt=4) as server:
                server.on_request(0)(lambda request: [1, 2])
                await server.wait_connected(10)
                with Stranger(tcp, 4) as stranger:
                    request = f"/qrkey/{server.epoch.topic}/request"
                    for size in (3_000_000, 30_000_000):
                        await asyncio.to_thread(stranger.publish, request, b"A" * size)
                await eventually(lambda: server.rejected == {"too_large": 2})
                async with Client(server.qr(), broker=server.broker) as visitor:
                    assert await visitor.request(0) == [1, 2]
                assert server.reconnects == 0


class TestLateness:
    async def test_the_time_for_which_the_gateway_itself_is_held_up_counts_as_waiting(self, broker):
        async with a_server(broker) as server:
            waited = []
            server.on_command("move_raw")(lambda command: waited.append(command.waited_s))
            await server.wait_connected(10)
            topic = f"/qrkey/{server.epoch.topic}/command/0000/AB/0/move_raw"
            with Stranger(broker.url.port, 4) as visitor:  # with the key: a visitor, but in this very thread
                for held_up_s, count in ((0.0, 1), (1.0, 5)):
                    await asyncio.sleep(0.3)
                    for _ in range(count):
                        token = seal(encode_envelope({"left_y": 50}, time.time()), server.epoch, os.urandom(12))
                        visitor.publish(topic, token)
                    time.sleep(held_up_s)
                    await eventually(lambda count=count: len(waited) == count)
                    if held_up_s:
                        assert min(waited) > 0.9
                    else:
                        assert waited.pop() < 0.3
