"""Brokers that come and go, refuse, deny or stall: what server and client survive."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import os
import re
import signal
import socket
import time
from pathlib import Path

import aiomqtt
import pytest

from brokers import a_broker, a_server, bare_mosquitto, tell_until_cancelled, with_an_old_pin
from phalanx.config import LinkConfig
from phalanx.errors import Unavailable, UsageError
from phalanx.net import ANY, Login, QrkeyClient, Server
from phalanx.net.broker import open_broker
from phalanx.net.mosquitto import MEMORY_BYTES, mosquitto, serves
from ports import free_port
from stranger import the_process
from waiting import eventually

pytestmark = pytest.mark.waits


def somewhere() -> tuple[int, str, int]:
    """Return free ports for a broker of ours."""
    return free_port(), "127.0.0.1", free_port()


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
                async with QrkeyClient(server.qr()) as client:
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
            async with QrkeyClient(server.qr()) as client:
                os.system(f"pkill -9 -f 'mosquitto -c /tmp/phalanx-.*' -P {os.getpid()}")
                await eventually(lambda: not server.connected)
                await eventually(lambda: server.connected)
                assert (await client.request(0))["robots"] == [1, 2]

    async def test_a_root_who_may_give_no_file_away_runs_it_all_the_same(self, monkeypatch):
        def refused(*_):
            raise PermissionError

        monkeypatch.setattr("phalanx.net.mosquitto.os.geteuid", lambda: 0)
        monkeypatch.setattr("phalanx.net.mosquitto.shutil.chown", refused)
        async with open_broker("mosquitto", tcp_port=free_port(), ws_port=free_port()) as broker:
            assert await serves(broker.url)

    async def test_ours_has_a_limit_of_memory_and_is_no_longer_root(self, broker):
        process = Path(f"/proc/{the_process(broker.url.port)}")
        limits = (process / "limits").read_text().splitlines()
        assert [line for line in limits if "Max data size" in line and f" {MEMORY_BYTES} " in line]
        assert os.geteuid() or process.stat().st_uid, "root gives it away"

    async def test_who_has_no_file_left_to_ask_it_ends_no_broker_that_is_well(self, broker, monkeypatch):
        async def out_of_files(*where, **how):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

        async with a_server(broker) as server:
            await server.wait_connected(10)
            before = the_process(broker.url.port)
            monkeypatch.setattr(asyncio, "open_connection", out_of_files)
            await asyncio.sleep(4)
            monkeypatch.undo()
            assert the_process(broker.url.port) == before
            assert not server.reconnects
            os.kill(before, signal.SIGSTOP)  # it is still watched
            await eventually(lambda: server.reconnects, 60)
            async with QrkeyClient(server.qr()) as client:
                assert (await client.request(0))["robots"] == [1, 2]

    async def test_without_a_broker_it_waits_says_so_and_comes_up(self, tmp_path, caplog):
        tcp, ws = free_port(), free_port()
        server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            async with server:
                with pytest.raises(TimeoutError, match="refused"):
                    await server.wait_connected(1)
                assert not caplog.text, "whoever waits for a time is told by the error"
                assert server.trouble
            server = Server(server.broker, broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt")
            async with server:
                await eventually(lambda: "waiting for it" in caplog.text)
                start()
                await server.wait_connected(10)
                assert server.qr().mqtt == 5

    async def test_a_rotation_while_the_broker_is_away_is_told_afterwards(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, kill):
            start()
            # Both come back within two seconds. Whoever comes back last, the end of the overlap tells once more.
            config = LinkConfig(rotate_s=60.0, overlap_s=6.0)
            server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt", config=config)
            async with with_an_old_pin(server, 57.0):
                await server.wait_connected(10)
                async with QrkeyClient(server.qr()) as client:
                    kill()
                    await eventually(lambda: not server.connected)
                    assert not server.overlapping
                    await eventually(lambda: server.overlapping)
                    start()
                    await eventually(lambda: client.moves, 20)
                    assert client.epoch_topic == server.epoch.topic

    @pytest.mark.parametrize("slow_s", [0.0, 3.6])
    async def test_a_rotation_while_it_subscribes_is_heard_of(self, broker, monkeypatch, slow_s):
        subscribe = aiomqtt.Client.subscribe
        asked: list[str] = []

        async def slowly(self, topic, *arguments, **more):
            asked.append(topic)
            await asyncio.sleep(slow_s if len(asked) <= 4 else 0)
            return await subscribe(self, topic, *arguments, **more)

        config = LinkConfig(rotate_s=3.0, overlap_s=2.4)
        async with with_an_old_pin(a_server(broker, config=config), 2.0) as server:
            await server.wait_connected(10)
            await eventually(lambda: server.overlapping)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", slowly)
            # The first four filters, slowly: a rotation falls due meanwhile.
            before = server.epoch
            server._link._client._disconnected.set_exception(aiomqtt.MqttError("cut"))
            await eventually(lambda: not server.connected)
            await eventually(lambda: server.connected, 15)
            assert slow_s == 0 or server.epoch is not before
            monkeypatch.undo()
            assert {topic.split("/")[2] for topic in asked} >= {server.epoch.topic}
            async with QrkeyClient(server.qr()) as client:
                assert (await client.request(0, timeout_s=5))["robots"] == [1, 2]

    async def test_a_subscription_that_fails_leads_to_a_new_connection(self, broker, monkeypatch):
        subscribe = aiomqtt.Client.subscribe

        async def fails(self, topic, *arguments, **more):
            raise aiomqtt.MqttError("no answer")

        config = LinkConfig(rotate_s=30.0, overlap_s=1.0)
        async with with_an_old_pin(a_server(broker, config=config), 28.5) as server:
            await server.wait_connected(10)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", fails)
            await eventually(lambda: not server.connected)
            monkeypatch.setattr(aiomqtt.Client, "subscribe", subscribe)
            await eventually(lambda: server.connected)
            assert server.reconnects == 1
            async with QrkeyClient(server.qr()) as client:
                assert (await client.request(0, timeout_s=5))["robots"] == [1, 2]

    @pytest.mark.parametrize("mqtt", [5, 4])
    async def test_a_subscription_that_the_broker_denies_is_told_once_and_asked_for_again(self, mqtt, caplog):
        allowed, asked = asyncio.Event(), []

        async def guarded(reader, writer):
            with contextlib.suppress(asyncio.IncompleteReadError):
                while True:
                    kind, length = await reader.readexactly(2)
                    body = await reader.readexactly(length)
                    if kind == 0x10:
                        writer.write(bytes.fromhex("2003000000" if mqtt == 5 else "20020000"))
                    elif kind == 0x82:
                        asked.append(body)
                        denial = b"\x87" if mqtt == 5 else b"\x80"
                        code = b"\x00" if allowed.is_set() else denial
                        body = body[:2] + (b"\x00" if mqtt == 5 else b"") + code
                        writer.write(bytes([0x90, len(body)]) + body)
            writer.close()

        listening = await asyncio.start_server(guarded, "127.0.0.1", 0)
        url = f"mqtt://127.0.0.1:{listening.sockets[0].getsockname()[1]}"
        async with listening, Server(url, mqtt=mqtt) as server:
            await eventually(lambda: len(asked) >= 3)
            assert not server.connected
            with pytest.raises(TimeoutError, match=r"denies the subscription to /qrkey/.*/command/#"):
                await server.wait_connected(0.1)
            allowed.set()
            await server.wait_connected(10)
            assert server.qr().mqtt == mqtt
        topic = f"/qrkey/{server.epoch.topic}/command/#"
        told = f"the broker at {url} denies the subscription to {topic}: check its access control; trying again"
        assert [record.message for record in caplog.records] == [told]

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
        config = LinkConfig(rotate_s=2.5, overlap_s=0.5)
        server = Server(f"mqtt://127.0.0.1:{tcp}", broker_for_visitors=f"ws://127.0.0.1:{ws}/mqtt", config=config)
        first, told = server.epoch, []
        server.on_event = told.append
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            async with server:
                await asyncio.sleep(2.7)
                assert server.epoch is first
                assert server.rotates_in_s == 2.5
                start()
                await server.wait_connected(10)
                assert server.epoch is first
                assert server.rotates_in_s > 1.0
                assert not told
                await eventually(lambda: server.epoch is not first)

    async def test_mosquitto_that_cannot_start_or_is_interrupted_leaves_nothing_behind(self, monkeypatch):
        children = Path(f"/proc/self/task/{os.getpid()}/children")
        before = children.read_text()
        with (
            monkeypatch.context() as patch,
            pytest.raises(Unavailable, match=r"not start: .*mosquitto\.conf:1"),
        ):
            patch.setattr("phalanx.net.mosquitto.configuration", lambda *_: "nonsense\n")
            async with mosquitto(*somewhere()):
                pass
        for after_s in (0.0, 0.001, 0.01, 0.03, 0.1):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(after_s), mosquitto(*somewhere()):
                    await asyncio.sleep(1)
        with pytest.raises(ZeroDivisionError):
            async with mosquitto(*somewhere()):
                raise ZeroDivisionError
        assert children.read_text() == before
        gc.collect()  # a pipe left open would say so here

    async def test_brokers_that_start_together_take_ports_of_their_own_and_say_so(self, caplog):
        async with contextlib.AsyncExitStack() as stack:
            # None of them listens when the others look for a free port.
            at = await asyncio.gather(*(stack.enter_async_context(open_broker("mosquitto")) for _ in range(3)))
            assert len({broker.url.port for broker in at}) == 3
            assert len(re.findall(r"port 1883 is in use: using \d+ instead", caplog.text)) >= 2
            assert all(await asyncio.gather(*(serves(broker.url) for broker in at)))

    @pytest.mark.parametrize("which", ["tcp_port", "ws_port"])
    async def test_a_port_that_was_asked_for_and_is_taken_is_told(self, which):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            ports = {"tcp_port": free_port(), "ws_port": free_port()} | {which: port}
            with pytest.raises(Unavailable, match=f"cannot listen on .* port {port}"):
                async with open_broker("mosquitto", **ports):
                    pass

    @pytest.mark.parametrize("code", [b"\x01", b""], ids=["says so", "hangs up"])
    async def test_a_broker_of_the_older_protocol_is_found_out(self, code):
        async def older(reader, writer):
            with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
                while True:
                    kind, length = await reader.readexactly(2)
                    body = await reader.readexactly(length)
                    if kind == 0x10 and body[6] == 5:
                        writer.write(b"\x20\x02\x00" + code if code else b"")
                        break
                    if kind == 0x10:
                        writer.write(b"\x20\x02\x00\x00")
                    elif kind == 0x82:
                        writer.write(b"\x90\x03" + body[:2] + b"\x00")
            writer.close()

        async with await asyncio.start_server(older, "127.0.0.1", 0) as listening:
            url = f"mqtt://127.0.0.1:{listening.sockets[0].getsockname()[1]}"
            async with Server(url) as server:
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
            async with QrkeyClient(qr, timeout_s=0.5):
                pass

    async def test_two_servers_on_one_broker_do_not_hear_each_other(self, broker):
        async with a_server(broker) as one, a_server(broker) as other:
            await one.wait_connected(10)
            await other.wait_connected(10)
            async with QrkeyClient(one.qr()) as client:
                await client.command("AB", "x", 1)
                await eventually(lambda: one.heard)
            assert not other.heard
            assert not other.rejected

    async def test_without_mosquitto_one_line_says_how_to_get_it(self, monkeypatch):
        monkeypatch.setattr("phalanx.net.mosquitto.find_mosquitto", lambda: None)
        with pytest.raises(Unavailable, match="mosquitto is not installed") as refused:
            async with a_broker():
                pass
        assert "apt-get install mosquitto" in refused.value.hint

    @pytest.mark.parametrize("kind", ["auto", "amqtt"])
    async def test_a_broker_that_phalanx_no_longer_has_is_refused_with_what_there_is(self, kind):
        with pytest.raises(UsageError, match=f"--broker {kind} no longer exists") as refused:
            async with open_broker(kind):
                pass
        assert "--broker mosquitto" in refused.value.hint

    async def test_a_kind_of_broker_that_nobody_knows_is_taken_for_a_host_and_that_is_said(self, caplog):
        async with open_broker("mosquito") as broker:
            assert str(broker.url) == "mqtt://mosquito:1883"
        assert "hint: did you mean mosquitto? use mosquitto, or a URL" in caplog.text
        caplog.clear()
        async with open_broker("test.mosquitto.org"):
            assert "hint: use mosquitto, or a URL" in caplog.text
        caplog.clear()
        async with open_broker("mqtt://mosquito"):
            assert not caplog.text
