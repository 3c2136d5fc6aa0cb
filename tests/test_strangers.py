"""What a stranger without the pin sends to the broker of a running gateway: nothing freezes, fills or silences it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import aiomqtt
import pytest

from brokers import a_server, bare_mosquitto, somebody
from commands import a_gateway
from phalanx.cli.terminal import EventLines
from phalanx.link.envelope import encode_envelope, seal
from phalanx.net import QrkeyClient, Server
from phalanx.net.broker import open_broker
from phalanx.net.front.link import frame_head
from phalanx.net.private_file import private_folder
from ports import free_port
from stranger import Stranger, the_process
from waiting import Turns, eventually
from websocket_broker import BrokerEnd

pytestmark = pytest.mark.waits


class TestNothingFreezesTheGateway:
    async def test_a_million_bytes_of_properties_and_a_long_topic_hold_nothing_up(self, tmp_path):
        tcp = free_port()
        with bare_mosquitto(tcp, free_port(), tmp_path) as (start, _):
            start()
            async with Server(f"mqtt://127.0.0.1:{tcp}") as server:
                await server.wait_connected(10)
                request = f"/qrkey/{server.epoch.topic}/request"
                async with Stranger(tcp) as stranger:
                    before_s, turns = time.thread_time(), Turns()
                    await asyncio.to_thread(stranger.publish, request, b"x", b"\x26\x00\x00\x00\x00" * 200_000)
                    command = f"/qrkey/{server.epoch.topic}/command/{'a/' * 150}{'b' * 60_000}"
                    await asyncio.to_thread(stranger.publish, command, b"x", b"")
                    await eventually(lambda: server.rejected == {"too_large": 2}, 60)
                    assert time.thread_time() - before_s < 1
                    assert turns.longest_s < 0.05
                assert server.reconnects == 0

    async def test_a_brokers_frame_full_of_small_packets_holds_nothing_up(self):
        async def broker(reader, writer):
            client, heard = BrokerEnd(), b""
            while data := await reader.read(65536):
                heard += client.read(data)
                writer.write(client.replies)
                client.replies = b""
                if b"MQTT" in heard:
                    writer.write(frame_head(2, 5) + b"\x20\x03\x00\x00\x00")
                while (at := heard.find(b"\x82")) >= 0 and len(heard) > at + 3:  # each subscription is granted
                    writer.write(frame_head(2, 6) + b"\x90\x04" + heard[at + 2 : at + 4] + b"\x00\x00")
                    heard = heard[at + 4 :]
                    asked.append(1)
                heard = b"" if b"MQTT" in heard else heard[-8:]
                if len(asked) == 2 and not told:
                    told.append(1)
                    writer.write(frame_head(9, 2) + b"hm" + frame_head(2, 600_000) + b"\xd0\x00" * 300_000)
                    writer.write(frame_head(2, 7) + b"\x30\x05\x00\x01x\x00y")

        asked, told = [], []
        async with await asyncio.start_server(broker, "127.0.0.1", 0) as there:
            before_s, turns = time.thread_time(), Turns()
            async with Server(f"ws://127.0.0.1:{there.sockets[0].getsockname()[1]}/mqtt") as server:
                await eventually(lambda: sum(server.rejected.values()) == 1, 60)
                assert time.thread_time() - before_s < 4
                assert turns.longest_s < 0.05
                assert not server.reconnects

    async def test_a_packet_longer_than_any_is_skipped_and_the_connection_lives(self, tmp_path):
        tcp = free_port()
        with bare_mosquitto(tcp, free_port(), tmp_path) as (start, _):
            start()
            # By the older protocol nobody can tell a broker how much they read.
            async with Server(f"mqtt://127.0.0.1:{tcp}", mqtt=4) as server:
                server.on_request(0)(lambda request: [1, 2])
                await server.wait_connected(10)
                turns = Turns()
                async with Stranger(tcp, 4) as stranger:
                    request = f"/qrkey/{server.epoch.topic}/request"
                    for size in (3_000_000, 10_000_000):
                        await asyncio.to_thread(stranger.publish, request, b"A" * size)
                await eventually(lambda: server.rejected == {"too_large": 2}, 60)
                assert turns.longest_s < 0.05
                async with QrkeyClient(server.qr(), broker=server.broker) as visitor:
                    assert await visitor.request(0) == [1, 2]
                assert server.reconnects == 0


class TestOurBroker:
    """A mosquitto of ours."""

    async def test_nothing_is_kept_for_who_is_away(self, broker):
        async with a_server(broker) as server:
            await server.wait_connected(10)
            sleeper = Stranger(broker.url.port, 4, name=b"sleeper", clean=False)
            async with sleeper:
                await asyncio.to_thread(sleeper.subscribe, f"/qrkey/{server.epoch.topic}/notify", qos=1)
            await asyncio.sleep(0.5)
            for n in range(5):
                await server.notify(n)
            with contextlib.suppress(aiomqtt.MqttError):  # it takes none that it would have to keep
                async with somebody(broker) as other:
                    await other.publish(f"/qrkey/{server.epoch.topic}/notify", bytes(200), qos=1, timeout=2)
            await asyncio.sleep(0.5)
            async with sleeper:
                sleeper.socket.settimeout(1)
                with pytest.raises(TimeoutError):
                    await asyncio.to_thread(sleeper.socket.recv, 1)


class TestLateness:
    async def test_the_time_for_which_the_gateway_itself_is_held_up_counts_as_waiting(self, broker):
        async with a_server(broker) as server:
            waited = []
            server.on_command("move_raw")(lambda command: waited.append(command.waited_s))
            await server.wait_connected(10)
            topic = f"/qrkey/{server.epoch.topic}/command/0000/AB/0/move_raw"
            async with Stranger(broker.url.port, 4) as visitor:  # with the key: a visitor, but in this very thread
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


class TestTheRest:
    def test_an_absurd_header_is_refused_and_nothing_of_it_told(self):
        with a_gateway("--robots", "2") as (gateway, ready):
            where = urlsplit(ready["page_url"])
            for words in (b"X-Long: " + b"marker" * 2000, b"marker\xff\x00", b"Content-Length: -5marker"):
                with socket.create_connection((where.hostname, where.port), 5) as stranger:
                    stranger.settimeout(5)
                    stranger.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n" + words + b"\r\n\r\n")
                    assert b" 400 " in stranger.recv(300)
            packed = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Encoding: gzip\r\nContent-Length: 12\r\n\r\n"
            with socket.create_connection((where.hostname, where.port), 5) as stranger:
                stranger.sendall(packed + b"marker")
                assert b" 405 " in stranger.recv(300)
                stranger.sendall(b"marker")
            assert gateway.stop() == 0
        assert not [line for line in gateway.err if "marker" in line or "Traceback" in line]

    @pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM])
    def test_a_terminal_that_closes_leaves_nothing_behind(self, number):
        with a_gateway("--robots", "2", qrkey=True) as (gateway, ready):
            pid = the_process(ready["broker_port"])
            folder = Path(Path(f"/proc/{pid}/cmdline").read_text().split("\0")[2]).parent
            assert folder.exists()
            assert gateway.stop(number) == 0
            assert not folder.exists()
            assert not Path(f"/proc/{pid}").exists()

    async def test_what_a_killed_gateway_left_is_swept_and_nothing_else(self, tmp_path, monkeypatch):
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        left, young, elsewhere = (tmp_path / f"phalanx-broker-{name}" for name in ("left", "young", "elsewhere"))
        for folder in (left, young):
            folder.mkdir()
            (folder / ".lock").touch()
        (tmp_path / "precious").mkdir()
        (tmp_path / "precious" / ".lock").touch()
        elsewhere.symlink_to(tmp_path / "precious")
        with private_folder() as alive:
            for folder in (left, alive, tmp_path / "precious"):
                os.utime(folder, (1, 1))
            async with open_broker("mqtt://127.0.0.1:1"):  # whatever broker is used
                assert not left.exists()
                assert young.exists()
                assert alive.exists()
                assert (tmp_path / "precious" / ".lock").exists()

    def test_a_reader_of_events_that_stalls_costs_a_bounded_number_of_bytes(self, monkeypatch):
        reading = threading.Event()
        monkeypatch.setattr("phalanx.cli.terminal.write_line", lambda line: reading.wait(30))
        lines = EventLines(limit_bytes=1_000_000)
        for n in range(1000):
            lines({"event": "command", "n": n, "payload": "x" * 40_000})
        assert lines._waiting.qsize() <= 25, "40 MB otherwise"
        assert lines.lost
        reading.set()
        lines.close(10)
