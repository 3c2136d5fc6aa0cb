"""Server and client through a real broker, and everything that must survive."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import os
import random
import re
import time
from pathlib import Path

import aiomqtt
import pytest

from conftest import a_broker, bare_mosquitto, eventually
from phalanx.config import LinkConfig
from phalanx.crypto import seal_jwe
from phalanx.errors import BadPayload, Unavailable, UsageError
from phalanx.io import ANY, Client, Login, Server, parse_broker_url
from phalanx.io.mosquitto import mosquitto
from phalanx.io.ports import free_port
from phalanx.link.envelope import encode_envelope, seal


def a_server(broker, **more) -> Server:
    server = Server(broker.url, broker_for_visitors=broker.websocket, mqtt=broker.mqtt, **more)
    server.heard = []

    @server.on_command(ANY)
    def hear(command):
        server.heard.append((command.address, command.name, command.payload))

    @server.on_request(0)
    async def answer(request):
        return {"asked": request.words.get("what"), "robots": [1, 2]}

    return server


class TestEverydayUse:
    async def test_command_request_and_notification(self, any_broker):
        async with a_server(any_broker) as server:
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                assert await client.request(0, what="this") == {"asked": "this", "robots": [1, 2]}
                assert await client.command("AB", "move_raw", {"left_y": 60})
                await eventually(lambda: server.heard)
                assert server.heard == [("AB", "move_raw", {"left_y": 60})]
                assert await server.notify({"cmd": 1})
                assert await anext(client.notifications()) == {"cmd": 1}
        assert server.counters == {"commands": 1, "requests": 1, "notifications": 1}
        assert not server.rejected

    async def test_public_names_are_on_link(self, broker):
        from phalanx import link

        assert link.Server is Server
        assert link.Client is Client
        with pytest.raises(AttributeError, match="no attribute 'Sever'"):
            link.Sever  # noqa: B018

    async def test_following_a_rotation(self, any_broker):
        config = LinkConfig(rotate_s=2.0, overlap_s=0.7)
        async with a_server(any_broker, config=config) as server:
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                before = server.epoch
                await eventually(lambda: client.moves, 5)
                assert client.epoch_topic == server.epoch.topic != before.topic
                assert (await client.request(0))["robots"] == [1, 2]
                await eventually(lambda: not server.overlapping, 5)
                await client.command("AB", "x", 1)
                await eventually(lambda: server.heard)

    async def test_a_phone_that_slept_through_a_whole_rotation_finds_its_way(self, broker):
        config = LinkConfig(rotate_s=2.0, overlap_s=0.3, knock_gap_s=0.1)
        async with a_server(broker, config=config) as server:
            await server.wait_connected(10)
            asleep_with = server.qr()
            await eventually(lambda: server.qr() != asleep_with and not server.overlapping, 6)
            async with Client(asleep_with) as phone:
                assert (await phone.request(0, timeout_s=8))["robots"] == [1, 2]
                assert phone.moves >= 1
        assert server.counters["knocks"] >= 1

    async def test_handlers_that_refuse_or_break_are_counted_and_survived(self, broker, caplog):
        server = Server(broker.url, broker_for_visitors=broker.websocket)

        def watch(said):
            if getattr(said, "name", "") == "watched":
                raise ValueError("secret payload")

        server.on_event = watch
        server.on_command("watched")(lambda command: None)

        @server.on_command("lookup")
        def look_up(command):
            return {}[command.payload]

        @server.on_command("library")
        def library(command):
            return json.loads("secret payload")

        @server.on_command("unfit")
        def unfit():
            """Takes no command."""

        @server.on_command("refuse")
        def refuse(command):
            raise BadPayload("no")

        @server.on_command("break")
        async def breaks(command):
            raise RuntimeError("secret payload " + str(command.payload))

        @server.on_request(1)
        def too_much(request):
            return "x" * (2 << 20)

        async with server:
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                for name in ("refuse", "break", "lookup", "library", "unfit", "unheard-of", "watched"):
                    await client.command("AB", name, "secret payload")
                for number in (1, 2):
                    with pytest.raises(Unavailable):
                        await client.request(number, timeout_s=0.3)
        assert server.rejected == {"bad_payload": 1, "handler_failed": 5, "unknown": 2}
        assert "secret payload" not in caplog.text
        assert "Traceback" not in caplog.text
        ours = re.escape(__file__)
        for name, kind in (("breaks", "RuntimeError"), ("look_up", "KeyError"), ("library", "JSONDecodeError")):
            assert re.search(rf"{name} failed: {kind} at {ours}:\d+", caplog.text), name
        assert re.search(r"unfit failed: TypeError at .*server.py:\d+", caplog.text)
        assert re.search(rf"on_event failed: ValueError at {ours}:\d+", caplog.text)

    @pytest.mark.parametrize(("skew_s", "well"), [(29.0, True), (-29.0, True), (31.0, False), (-31.0, False)])
    async def test_a_clock_may_be_off_by_thirty_seconds(self, broker, skew_s, well):
        async with a_server(broker) as server:
            await server.wait_connected(10)
            async with Client(server.qr(), clock=lambda: time.time() + skew_s) as client:
                if well:
                    assert await client.request(0)
                    return
                telling = asyncio.create_task(tell_until_cancelled(server))
                with pytest.raises(Unavailable, match=f"clock is 31 s {'ahead of' if skew_s > 0 else 'behind'} the"):
                    await client.request(0, timeout_s=1)
                telling.cancel()
                assert server.rejected["stale"] >= 1


async def tell_until_cancelled(server):
    while True:
        await server.notify({"cmd": 1})
        await asyncio.sleep(0.1)


class TestBrokersThatComeAndGo:
    async def test_commands_flow_again_within_five_seconds_of_a_killed_brokers_return(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, kill):
            start()
            server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
            heard = []
            server.on_command(ANY)(heard.append)
            async with server:
                await server.wait_connected(10)
                async with Client(server.qr()) as client:
                    await client.command("AB", "x", 0)
                    await eventually(lambda: heard)
                    kill()
                    await eventually(lambda: not server.connected)
                    assert not await server.notify("nobody hears this")
                    await asyncio.sleep(3)  # long enough for the retries to be at their slowest
                    start()
                    returned = time.monotonic()
                    heard.clear()
                    while not heard:
                        await client.command("AB", "x", 1)
                        await asyncio.sleep(0.05)
                        assert time.monotonic() - returned < 5
                    assert server.reconnects == 1

    async def test_a_supervised_mosquitto_that_is_killed_comes_back_by_itself(self):
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                os.system(f"pkill -9 -f 'mosquitto -c /tmp/phalanx-.*' -P {os.getpid()}")
                await eventually(lambda: not server.connected)
                await eventually(lambda: server.connected, 5)
                assert (await client.request(0))["robots"] == [1, 2]

    async def test_without_a_broker_it_waits_says_so_and_comes_up(self, tmp_path, caplog):
        tcp, ws = free_port(), free_port()
        server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            async with server:
                with pytest.raises(TimeoutError):
                    await server.wait_connected(1)
                assert "waiting for it" in caplog.text
                assert server.trouble
                start()
                await server.wait_connected(5)
                assert server.qr().mqtt == 5

    async def test_a_rotation_while_the_broker_is_away_is_told_afterwards(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, kill):
            start()
            config = LinkConfig(rotate_s=3.0, overlap_s=1.5)
            server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt", config=config)
            async with server:
                await server.wait_connected(10)
                async with Client(server.qr()) as client:
                    await asyncio.sleep(2.0)
                    kill()
                    await eventually(lambda: server.overlapping, 5)
                    start()
                    await eventually(lambda: client.moves, 8)
                    assert client.epoch_topic == server.epoch.topic

    @pytest.mark.parametrize("slow_s", [0.0, 0.45])
    async def test_a_rotation_while_it_subscribes_is_heard_of(self, broker, monkeypatch, slow_s):
        subscribe = aiomqtt.Client.subscribe
        asked: list[str] = []

        async def slowly(self, topic, *arguments, **more):
            asked.append(topic)
            await asyncio.sleep(slow_s)
            return await subscribe(self, topic, *arguments, **more)

        config = LinkConfig(rotate_s=1.5, overlap_s=1.2)
        async with a_server(broker, config=config) as server:
            await server.wait_connected(10)
            await eventually(lambda: server.overlapping)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", slowly)
            # Four filters, slowly, take 1.8 s: a rotation falls due meanwhile.
            before = server.epoch
            server._link._client._disconnected.set_exception(aiomqtt.MqttError("cut"))
            await eventually(lambda: not server.connected)
            await eventually(lambda: server.connected, 15)
            assert slow_s == 0 or server.epoch is not before
            monkeypatch.undo()
            assert {topic.split("/")[2] for topic in asked} >= {server.epoch.topic}
            async with Client(server.qr()) as client:
                assert (await client.request(0, timeout_s=5))["robots"] == [1, 2]

    async def test_a_subscription_that_fails_leads_to_a_new_connection(self, broker, monkeypatch):
        subscribe = aiomqtt.Client.subscribe

        async def fails(self, topic, *arguments, **more):
            raise aiomqtt.MqttError("no answer")

        async with a_server(broker, config=LinkConfig(rotate_s=1.5, overlap_s=1.0)) as server:
            await server.wait_connected(10)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", fails)
            await eventually(lambda: not server.connected, 5)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", subscribe)
            await eventually(lambda: server.connected, 5)
            assert server.reconnects == 1
            async with Client(server.qr()) as client:
                assert (await client.request(0, timeout_s=5))["robots"] == [1, 2]

    async def test_a_broker_that_does_not_answer_a_goodbye_does_not_keep_us(self, broker, monkeypatch):
        server = a_server(broker)
        async with server:
            await server.wait_connected(10)
            link = server._tasks[0]

            async def unanswered(self, *trouble):
                raise aiomqtt.MqttError("timed out")

            monkeypatch.setattr(aiomqtt.Client, "__aexit__", unanswered)
            link.cancel()
            await eventually(link.done, 5)
            assert link.cancelled()

    async def test_a_cancellation_that_is_swallowed_while_sending_is_heeded(self, broker, monkeypatch):
        async def swallows(self, *arguments, **more):
            with contextlib.suppress(asyncio.CancelledError):  # as wait_for may, before Python 3.12
                await asyncio.sleep(60)

        async with a_server(broker) as server:
            await server.wait_connected(10)
            monkeypatch.setattr(aiomqtt.Client, "publish", swallows)
            telling = asyncio.create_task(tell_until_cancelled(server))
            await asyncio.sleep(0.1)
            telling.cancel()
            await eventually(telling.done, 5)

    async def test_the_first_pin_lives_its_whole_time_from_the_first_connect_on(self, tmp_path):
        tcp, ws = free_port(), free_port()
        config = LinkConfig(rotate_s=1.5, overlap_s=0.5)
        server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt", config=config)
        first, told = server.epoch, []
        server.on_event = told.append
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            async with server:
                await asyncio.sleep(2.0)
                assert server.epoch is first
                assert server.rotates_in_s == 1.5
                start()
                await server.wait_connected(10)
                assert server.epoch is first
                assert server.rotates_in_s > 1.0
                assert not told
                await eventually(lambda: server.epoch is not first, 5)

    async def test_mosquitto_that_cannot_start_or_is_interrupted_leaves_nothing_behind(self, monkeypatch):
        children = Path(f"/proc/self/task/{os.getpid()}/children")
        before = children.read_text()
        with (
            monkeypatch.context() as patch,
            pytest.raises(Unavailable, match=r"not start: .*mosquitto\.conf:1"),
        ):
            patch.setattr("phalanx.io.mosquitto.configuration", lambda *_: "nonsense\n")
            async with mosquitto(free_port(), "127.0.0.1", free_port()):
                pass
        for after_s in (0.0, 0.001, 0.01, 0.03, 0.1):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(after_s), mosquitto(free_port(), "127.0.0.1", free_port()):
                    await asyncio.sleep(1)
        with pytest.raises(ZeroDivisionError):
            async with mosquitto(free_port(), "127.0.0.1", free_port()):
                raise ZeroDivisionError
        assert children.read_text() == before
        gc.collect()  # a pipe left open would say so here

    async def test_a_broker_of_the_older_protocol_is_found_out(self):
        async with a_broker("amqtt") as broker:
            server = Server(broker.url, broker_for_visitors=broker.websocket, mqtt=5)
            async with server:
                await server.wait_connected(10)
                assert server.qr().mqtt == 4

    @pytest.mark.parametrize("mqtt", [5, 4])
    async def test_a_wrong_login_is_one_clear_error(self, tmp_path, mqtt):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path, "allow_anonymous false") as (start, _):
            start()
            login = Login("who", "hunter2")
            server = Server(f"mqtt://127.0.0.1:{tcp}", login=login, mqtt=mqtt)
            async with server:
                with pytest.raises(Unavailable, match="refused the login") as caught:
                    await server.wait_connected(10)
            assert "hunter2" not in str(caught.value) + repr(login) + repr(server.broker) + str(server.broker)

    async def test_an_unreachable_broker_is_one_clear_error_for_a_client(self):
        qr = Server("mqtt://127.0.0.1:1", broker_for_visitors=f"ws://127.0.0.1:{free_port()}/mqtt").qr()
        with pytest.raises(Unavailable, match="no broker at"):
            async with Client(qr, timeout_s=0.5):
                pass

    async def test_two_servers_on_one_broker_do_not_hear_each_other(self, broker):
        async with a_server(broker) as one, a_server(broker) as other:
            await one.wait_connected(10)
            await other.wait_connected(10)
            async with Client(one.qr()) as client:
                await client.command("AB", "x", 1)
                await eventually(lambda: one.heard)
            assert not other.heard
            assert not other.rejected

    async def test_amqtt_retains_nothing(self):
        async with a_broker("amqtt") as broker:
            async with aiomqtt.Client(broker.url.host, broker.url.port) as client:
                await client.publish("t", b"x", retain=True)
                await asyncio.sleep(0.2)
            async with aiomqtt.Client(broker.url.host, broker.url.port) as client:
                await client.subscribe("t")
                with pytest.raises(TimeoutError):
                    await asyncio.wait_for(anext(client.messages), 0.5)

    async def test_amqtt_hangs_up_on_a_reader_that_stalls(self):
        async with a_broker("amqtt") as broker:
            reader, writer = await asyncio.open_connection(broker.url.host, broker.url.port)
            writer.write(bytes.fromhex("101000044d5154540402003c000473746c31"))  # CONNECT as stl1
            await reader.readexactly(4)
            writer.write(bytes.fromhex("8206000100017400"))  # SUBSCRIBE t
            await reader.readexactly(5)
            writer.transport.pause_reading()
            async with aiomqtt.Client(broker.url.host, broker.url.port) as flood:
                for _ in range(400):
                    await flood.publish("t", b"x" * 50_000)
                    if writer.transport.is_closing():
                        break
                    await asyncio.sleep(0.005)
                await asyncio.sleep(5)
                writer.transport.resume_reading()
                with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
                    await asyncio.wait_for(reader.readexactly(400 * 50_000), 10)


class TestHostileMessages:
    async def test_ten_thousand_random_and_mutated_messages_and_the_server_still_answers(self, broker):
        chance = random.Random(20261121)
        async with a_server(broker) as server:
            await server.wait_connected(10)
            base = f"/qrkey/{server.epoch.topic}"
            good = seal(encode_envelope({"left_y": 1}, time.time()), server.epoch, os.urandom(12))
            sent = 0
            async with aiomqtt.Client(broker.url.host, broker.url.port) as attacker:
                for i in range(10_000):
                    await attacker.publish(*hostile(chance, base, good, server.epoch, i))
                    sent += 1
            async with Client(server.qr()) as client:
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
        reading = asyncio.Event()

        @server.on_command("slow")
        async def slow(command):
            await reading.wait()

        async with server:
            await server.wait_connected(10)
            async with Client(server.qr()) as client:
                await client.command("AB", "slow", 1)
                async with aiomqtt.Client(broker.url.host, broker.url.port) as attacker:
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
                async with Client(server.qr()) as client:
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
        # What can and what cannot be refused in this mode: docs/threat-model.md.
        async with a_server(broker) as server:
            await server.wait_connected(10)
            before = server.epoch
            async with Client(server.qr()) as client:
                token = seal_jwe(b'{"cmd":255,"pin_code":"666666666666"}', before.key, os.urandom(12))
                async with aiomqtt.Client(broker.url.host, broker.url.port) as visitor:
                    for sub in ("request", "notify", "command/0000/A/0/x"):
                        await visitor.publish(f"/qrkey/{before.topic}/{sub}", token)
                await eventually(lambda: client.moves)
            assert server.epoch is before
            assert server.rejected == {"malformed_envelope": 2}

    async def test_secrets_are_not_logged(self, caplog, tmp_path):
        caplog.set_level(logging.DEBUG)
        tcp, ws = free_port(), free_port()
        login = Login("ferris", "hunter2-and-more")
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            start()
            config = LinkConfig(rotate_s=1.0, overlap_s=0.4)
            server = Server(
                f"mqtt://127.0.0.1:{tcp}", login=login, broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt", config=config
            )
            pins = {server.epoch.pin.digits}
            keys = {server.epoch.key.raw.hex()}
            server.on_event = lambda said: (
                (pins.add(said.pin.digits), keys.add(said.key.raw.hex())) if hasattr(said, "pin") else None
            )
            async with server:
                await server.wait_connected(10)
                async with Client(server.qr(), login=login) as client:
                    await client.command("AB", "x", {"payload": "of the visitor"})
                    await eventually(lambda: client.moves >= 2, 8)
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


class TestBrokerUrls:
    @pytest.mark.parametrize(
        ("url", "text"),
        [
            ("mqtt://h", "mqtt://h:1883"),
            ("mqtts://h", "mqtts://h:8883"),
            ("ws://h:9001", "ws://h:9001/mqtt"),
            ("wss://h/other", "wss://h:443/other"),
            ("localhost:1884", "mqtt://localhost:1884"),
            ("mqtt://[::1]:1883", "mqtt://[::1]:1883"),
        ],
    )
    def test_good(self, url, text):
        assert str(parse_broker_url(url)) == text

    @pytest.mark.parametrize(
        "url",
        ["", "http://h", "mqtt://", "mqtt://h:99999", "mqtt://h:x", "mqtt://h:0", "mqtt://h/path", "ws://h?x", "://"],
    )
    def test_bad(self, url):
        with pytest.raises(UsageError) as caught:
            parse_broker_url(url)
        assert caught.value.hint

    def test_a_login_in_a_url_is_refused_and_not_repeated(self):
        with pytest.raises(UsageError) as caught:
            parse_broker_url("mqtt://me:hunter2@h")
        assert "hunter2" not in str(caught.value) + caught.value.hint
