"""Hostile messages through a real broker: refused, counted, survived, and never logged."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import random
import time

import aiomqtt
import pytest

from brokers import a_server, bare_mosquitto, somebody
from phalanx.config import LinkConfig
from phalanx.crypto import seal_jwe
from phalanx.link.envelope import encode_envelope, seal
from phalanx.net import Login, QrkeyClient, Server
from ports import free_port
from waiting import eventually

pytestmark = pytest.mark.waits


class TestHostileMessages:
    async def test_ten_thousand_random_and_mutated_messages_and_the_server_still_answers(self, broker):
        chance = random.Random(20261121)
        async with a_server(broker) as server:
            await server.wait_connected(10)
            base = f"/qrkey/{server.epoch.topic}"
            good = seal(encode_envelope({"left_y": 1}, time.time()), server.epoch, os.urandom(12))
            sent = 0
            async with somebody(broker) as attacker:
                for i in range(10_000):
                    await attacker.publish(*hostile(chance, base, good, server.epoch, i))
                    sent += 1
            async with QrkeyClient(server.qr()) as client:
                assert (await client.request(0))["robots"] == [1, 2]
            await eventually(lambda: sum(server.rejected.values()) + len(server.heard) >= sent, 30)
            assert sum(server.rejected.values()) + len(server.heard) == sent
            assert not server.rejected["overrun"], "ten thousand small ones find room"
            assert set(server.rejected) >= {
                "malformed_jwe",
                "not_authentic",
                "malformed_envelope",
                "stale",
                "too_large",
                "wrong_topic",
                "bad_payload",
                "replayed",
            }

    async def test_what_comes_faster_than_it_is_read_is_dropped_and_counted(self, broker, caplog):
        server = a_server(broker)
        began, reading = asyncio.Event(), asyncio.Event()

        @server.on_command("slow")
        async def slow(command):
            began.set()
            await reading.wait()

        async with server:
            await server.wait_connected(10)
            async with QrkeyClient(server.qr()) as client:
                await client.command("AB", "slow", 1)
                await began.wait()
                async with somebody(broker) as attacker:
                    for _ in range(240):
                        await attacker.publish(f"/qrkey/{server.epoch.topic}/request", b"A" * 300_000)
                        await asyncio.sleep(0.005)
                await eventually(lambda: server.rejected["overrun"] >= 10)
                assert server.rejected["overrun"] <= 20, "64 MiB find room"
                assert not server.rejected["too_large"], "nobody read yet"
                reading.set()
                await eventually(lambda: sum(server.rejected.values()) == 240)
                assert (await client.request(0))["robots"] == [1, 2]
        assert "full" not in caplog.text

    async def test_a_client_too_counts_what_comes_faster_than_it_is_read(self, broker, monkeypatch):
        monkeypatch.setattr("phalanx.net.connection.INCOMING_MESSAGES", 3)
        reading = asyncio.Event()
        async with a_server(broker) as server:
            await server.wait_connected(10)
            client = QrkeyClient(server.qr())
            read = client._on_message

            async def slowly(topic, token):
                await reading.wait()
                await read(topic, token)

            client._on_message = slowly
            async with client:
                for n in range(10):
                    await server.notify(n)
                await eventually(lambda: client.rejected == {"overrun": 6})
                reading.set()
                assert [await anext(client.notifications()) for _ in range(4)] == [0, 1, 2, 3]

    async def test_a_megabyte_is_refused_unread(self, tmp_path):
        # By a broker that lets it pass; our own hangs up on it.
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            start()
            server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
            server.on_request(0)(lambda request: [1, 2])
            async with server:
                await server.wait_connected(10)
                async with aiomqtt.Client("127.0.0.1", tcp) as attacker:
                    for _ in range(20):
                        await attacker.publish(f"/qrkey/{server.epoch.topic}/request", b"A" * 1_000_000)
                await eventually(lambda: server.rejected["too_large"] == 20)
                async with QrkeyClient(server.qr()) as client:
                    assert await client.request(0) == [1, 2]

    @pytest.mark.parametrize("topic", [b"a/+/b", b"#", b"", b"\xff\xfe", b"\x1b]0;owned\x07/#"])
    async def test_a_broker_that_sends_impossible_topics_is_left_and_nothing_of_it_logged(self, topic, caplog):
        caplog.set_level(logging.DEBUG)
        connects = []

        async def broker(reader, writer):
            connects.append(1)
            await reader.read(1000)
            writer.write(bytes.fromhex("2003000000"))  # CONNACK of MQTT 5
            for _ in range(2):
                request = await reader.read(1000)
                if not request:
                    break
                packet_id = request[2:4] if request[1] < 128 else request[3:5]
                writer.write(b"\x90\x04" + packet_id + b"\x00\x00")
            body = len(topic).to_bytes(2, "big") + topic + b"\x00" + b"payload"
            writer.write(bytes([0x30, len(body)]) + body)
            await reader.read(1000)
            writer.close()

        listening = await asyncio.start_server(broker, "127.0.0.1", 0)
        port = listening.sockets[0].getsockname()[1]
        async with listening, Server(f"mqtt://127.0.0.1:{port}") as server:
            with contextlib.suppress(TimeoutError):
                await server.wait_connected(3)
            await asyncio.sleep(0.5)
            lines = len(caplog.records)
            await asyncio.sleep(1)
            assert len(caplog.records) - lines < 50, "it does not read the same packet for ever"
        assert connects
        assert "\x1b" not in caplog.text

    async def test_a_forged_rotation_moves_visitors_but_not_the_server(self, broker):
        # What can and what cannot be refused in this mode: docs/explanation/threats-qrkey.md.
        async with Server(broker.url, broker_for_visitors=broker.websocket) as server:
            server.on_request(0)(lambda request: [1, 2])
            await server.wait_connected(10)
            before = server.epoch
            async with QrkeyClient(server.qr()) as client:
                token = seal_jwe(b'{"cmd":255,"pin_code":"666666666666"}', before.key, os.urandom(12))
                async with somebody(broker) as visitor:
                    for sub in ("request", "notify", "command/0000/A/0/x"):
                        await visitor.publish(f"/qrkey/{before.topic}/{sub}", token)
                await eventually(lambda: client.moves and server.rejected.total() >= 2)
                # Nobody speaks there. Who asks, and is not answered, goes back.
                assert client.epoch_topic != before.topic
                assert await client.request(0) == [1, 2]
                assert client.epoch_topic == before.topic
            assert server.epoch is before
            assert server.rejected == {"malformed_envelope": 2}

    async def test_secrets_are_not_logged(self, broker, caplog):
        caplog.set_level(logging.DEBUG)
        login = Login("ferris", "hunter2-and-more")
        config = LinkConfig(rotate_s=1.5, overlap_s=0.8)
        server = Server(str(broker.url), login=login, broker_for_visitors=broker.websocket, config=config)
        pins = {server.epoch.pin.digits}
        keys = {server.epoch.key.raw.hex()}
        server.on_event = lambda said: (
            (pins.add(said.pin.digits), keys.add(said.key.raw.hex())) if hasattr(said, "pin") else None
        )
        async with server:
            await server.wait_connected(10)
            async with QrkeyClient(server.qr(), login=login) as client:
                await client.command("AB", "x", {"payload": "of the visitor"})
                await eventually(lambda: client.moves >= 2, 15)
        assert len(pins) >= 3
        assert "connected to" in caplog.text, "the log was really taken at DEBUG"
        for secret in (*pins, *keys, "hunter2", "of the visitor"):
            assert secret not in caplog.text


def hostile(chance, base, good, epoch, i):
    """Topic and payload of the i-th attack."""
    sub = chance.choice(["/request", "/command/0000/AB/0/x"])
    kind = i % 10
    if kind == 0:
        return base + sub, chance.randbytes(chance.randrange(300))
    if kind == 1:
        mutated = bytearray(good)
        mutated[chance.randrange(len(mutated))] = chance.randrange(256)
        return base + sub, bytes(mutated)
    if kind == 2:
        return base + sub, good[: chance.randrange(len(good))]
    if kind == 3:
        words = chance.choice(["NaN", "Infinity", "-1e999", '"now"', "null", "true", "[]"])
        return base + sub, seal(f'{{"timestamp":{words},"payload":1}}'.encode(), epoch, chance.randbytes(12))
    if kind == 4:
        then = time.time() + chance.choice([-1, 1]) * chance.uniform(31, 1e9)
        return base + sub, seal(encode_envelope(1, then), epoch, chance.randbytes(12))
    if kind == 5:
        return base + "/command/0000/AB/0/x", good  # the first one counts, the others are replays
    if kind == 6:
        return base + chance.choice(["/command/0001/AB/0/x", "/command/0000/AB", "/command/0000/A B/0/x"]), good
    if kind == 7:
        junk = json.dumps(chance.choice([None, [], {}, {"request": "0"}, {"request": 0, "reply": "+"}, "x" * 1000]))
        plain = f'{{"timestamp":{time.time()},"payload":{junk}}}'.encode()
        return base + "/request", seal(plain, epoch, chance.randbytes(12))
    if kind == 8:
        return base + sub, b"A" * chance.choice([70_000, 200_000]) if i % 100 == 8 else b"A" * 10
    return base + sub, seal(b"[" * 10_000, epoch, chance.randbytes(12))
