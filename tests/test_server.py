"""Server and client through a real broker, on ordinary days."""

from __future__ import annotations

import asyncio
import json
import re
import time
from dataclasses import replace

import pytest

from brokers import a_server, tell_until_cancelled, with_an_old_pin
from phalanx.config import LinkConfig
from phalanx.errors import BadPayload, Unavailable, UsageError
from phalanx.net import QrkeyClient, Server, parse_broker_url
from waiting import eventually

pytestmark = pytest.mark.waits


class TestEverydayUse:
    @pytest.mark.parametrize("mqtt", [5, 4])
    async def test_command_request_and_notification(self, broker, mqtt):
        async with a_server(broker, mqtt=mqtt) as server:
            await server.wait_connected(10)
            async with QrkeyClient(server.qr()) as client:
                assert await client.request(0, what="this") == {"asked": "this", "robots": [1, 2]}
                assert await client.command("AB", "move_raw", {"left_y": 60})
                await eventually(lambda: server.heard)
                assert server.heard == [("AB", "move_raw", {"left_y": 60})]
                assert await server.notify({"cmd": 1})
                assert await anext(client.notifications()) == {"cmd": 1}
        assert server.counters == {"commands": 1, "requests": 1, "notifications": 1}
        assert not server.rejected

    async def test_what_is_said_before_entering_is_one_clear_error(self):
        server = Server("mqtt://127.0.0.1:1")
        client = QrkeyClient(server.qr(), broker="mqtt://127.0.0.1:1")
        for saying in (
            server.notify({}),
            server.run(),
            server.wait_connected(1),
            client.command("AB", "x", 1),
            client.request(0),
        ):
            with pytest.raises(UsageError, match="is not entered") as caught:
                await saying
            assert caught.value.hint.startswith("use it as `async with ")

    async def test_a_clients_broker_may_be_a_url(self, broker):
        async with a_server(broker) as server:
            await server.wait_connected(10)
            async with QrkeyClient(
                replace(server.qr(), broker="ws://unused.invalid"), broker=str(broker.url)
            ) as client:
                assert (await client.request(0))["robots"] == [1, 2]
        with pytest.raises(UsageError, match="unknown broker scheme gopher://"):
            QrkeyClient(server.qr(), broker="gopher://x")

    async def test_public_names_are_on_link(self, broker):
        from phalanx import link

        assert link.Server is Server
        assert link.QrkeyClient is QrkeyClient
        with pytest.raises(AttributeError, match="no attribute 'Sever'"):
            link.Sever  # noqa: B018

    @pytest.mark.parametrize("mqtt", [5, 4])
    async def test_following_a_rotation(self, broker, mqtt):
        config = LinkConfig(rotate_s=30.0, overlap_s=1.5)
        async with with_an_old_pin(a_server(broker, config=config, mqtt=mqtt), 28.5) as server:
            await server.wait_connected(10)
            before = server.epoch
            async with QrkeyClient(server.qr()) as client:
                await eventually(lambda: client.moves)
                assert client.epoch_topic == server.epoch.topic != before.topic
                assert (await client.request(0))["robots"] == [1, 2]
                await eventually(lambda: not server.overlapping)
                # A machine that is held up refuses what is late: as a thumb does, it says so again.
                for _ in range(20):
                    await client.command("AB", "x", 1)
                    await asyncio.sleep(0.2)
                    if server.heard:
                        break
                assert server.heard

    async def test_a_phone_that_slept_through_a_whole_rotation_finds_its_way(self, broker):
        config = LinkConfig(rotate_s=30.0, overlap_s=0.3, knock_gap_s=0.1)
        async with with_an_old_pin(a_server(broker, config=config), 29.0) as server:
            asleep_with = server.qr()
            await server.wait_connected(10)
            await eventually(lambda: server.qr() != asleep_with and not server.overlapping)
            async with QrkeyClient(asleep_with) as phone:
                assert (await phone.request(0))["robots"] == [1, 2]
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
            async with QrkeyClient(server.qr()) as client:
                for name in ("refuse", "break", "lookup", "library", "unfit", "unheard-of", "watched"):
                    await client.command("AB", name, "secret payload")
                for number in (1, 2):
                    with pytest.raises(Unavailable):
                        await client.request(number, timeout_s=0.3)
                await eventually(lambda: server.rejected.total() >= 8)
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
            async with QrkeyClient(server.qr(), clock=lambda: time.time() + skew_s) as client:
                if well:
                    assert await client.request(0)
                    return
                telling = asyncio.create_task(tell_until_cancelled(server))
                with pytest.raises(
                    Unavailable, match=f"clock is 3[0-2] s {'ahead of' if skew_s > 0 else 'behind'} the"
                ):
                    await client.request(0, timeout_s=3)
                telling.cancel()
                assert server.rejected["stale"] >= 1


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
