"""The pages over HTTP: what they serve, to whom, and on whom they hang up."""

from __future__ import annotations

import asyncio
import gc
import json
import re
import resource
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import pytest

from phalanx.errors import Unavailable
from phalanx.gateway.serve_pages import PAGES
from phalanx.gateway.shields import ShieldWatch
from phalanx.gateway.up import UpOptions, up
from phalanx.net.site import serve_in_thread
from phalanx.robot.swarm import Shield
from phalanx.world import Dotbots
from ports import free_port
from served_pages import a_page, operator_pages
from waiting import eventually

pytestmark = pytest.mark.waits

IDLERS = """
import resource, socket, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (2048, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
crowd = [socket.create_connection(("127.0.0.1", int(sys.argv[1]))) for _ in range(1000)]
print("all there", flush=True)
time.sleep(60)
"""


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _is_hung_up(one: socket.socket) -> bool:
    one.setblocking(False)
    try:
        return one.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


@pytest.fixture
async def operator():
    async with operator_pages("t0ken" * 6, lambda: {"pin": "314159"}) as pages:
        yield pages


class TestPages:
    async def test_the_visitors_page_is_served_under_a_strict_policy(self):
        async with a_page() as pages, aiohttp.ClientSession() as http:
            async with http.get(f"http://127.0.0.1:{pages.port}/") as answer:
                assert answer.status == 200
                policy = answer.headers["Content-Security-Policy"]
                assert "script-src 'self'" in policy
                assert "unsafe" not in policy
                assert answer.headers["Referrer-Policy"] == "no-referrer"
                assert "<script" in await answer.text()
            for path in (
                "/api/link/state",
                "/../pyproject.toml",
                "/assets/../../../up.py",
                "/assets/",
                "/%2e%2e/up.py",
            ):
                async with http.get(f"http://127.0.0.1:{pages.port}{path}") as answer:
                    assert answer.status in (403, 404), path

    async def test_a_phone_on_a_slow_network_gets_the_script_packed_and_who_cannot_unpack_gets_it_plain(self):
        async with a_page() as pages, aiohttp.ClientSession(auto_decompress=False) as http:
            page = f"http://127.0.0.1:{pages.port}/"
            async with http.get(page) as answer:
                script = re.search(r'src="\./(assets/[^"]+\.js)"', await answer.text())[1]
            sizes = {}
            for taken in ("gzip, deflate, br", "identity"):
                async with http.get(page + script, headers={"Accept-Encoding": taken}) as answer:
                    assert "javascript" in answer.headers["Content-Type"]
                    sizes[answer.headers.get("Content-Encoding")] = len(await answer.read())
            assert sizes["gzip"] < 0.5 * sizes[None]

    @pytest.mark.parametrize(
        "headers",
        [
            {},
            {"Authorization": ""},
            {"Authorization": "Bearer"},
            {"Authorization": "Bearer wrong"},
            {"Authorization": "t0ken" * 6},
            {"Authorization": "Bearer " + "t0ken" * 5},
            {"Authorization": "bearer " + "t0ken" * 6},
            {"Authorization": "Bearer tökén"},
        ],
    )
    async def test_nothing_secret_is_reachable_without_the_token(self, operator, headers):
        async with aiohttp.ClientSession() as http:
            for path in ("/api/link/state", "/api/stop", "/", f"/api/link/state?token={'t0ken' * 6}"):
                method = "GET" if path == "/" else "POST"
                async with http.request(method, f"http://127.0.0.1:{operator.port}{path}", headers=headers) as answer:
                    assert answer.status == (200 if path == "/" else 401)
                    assert "314159" not in await answer.text()
                    assert "Access-Control-Allow-Origin" not in answer.headers

    async def test_with_the_token_it_answers(self, operator):
        headers = {"Authorization": "Bearer " + "t0ken" * 6}
        async with aiohttp.ClientSession() as http:
            async with http.post(
                f"http://127.0.0.1:{operator.port}/api/link/state", json={}, headers=headers
            ) as answer:
                assert await answer.json() == {"pin": "314159"}
                assert answer.headers["Cache-Control"] == "no-store"

    @pytest.mark.parametrize(
        ("words", "kind"),
        [
            (b'{"address": 1, "attack": 2}', "text/plain; charset=no-such"),
            (b"\xff", "application/json"),
            (b"[" * 3000, "application/json"),
            (b"null", "application/json"),
        ],
    )
    async def test_words_of_any_charset_are_read_or_refused_in_a_line(self, operator, words, kind):
        headers = {"Authorization": "Bearer " + "t0ken" * 6, "Content-Type": kind}
        url = f"http://127.0.0.1:{operator.port}/api/link/compromise"
        async with aiohttp.ClientSession() as http, http.post(url, data=words, headers=headers) as answer:
            assert answer.status == (200 if b"address" in words else 409 if words == b"null" else 400)
            assert (await answer.json()).get("hint", "reload the page") in ("reload the page", "")

    async def test_whoever_ends_us_while_a_page_begins_is_told_nothing(self, caplog):
        class Slow:
            begun, ended = False, False

            async def __aenter__(self):
                self.begun = True
                try:
                    await asyncio.sleep(30)
                finally:
                    self.ended = True

        async def serve():
            async with serve_in_thread(pages):
                pass

        pages = Slow()
        for begin in (lambda: asyncio.sleep(0), lambda: eventually(lambda: pages.begun)):
            serving = asyncio.ensure_future(serve())
            await begin()
            serving.cancel()
            await asyncio.wait([serving])
            gc.collect()
            assert pages.begun == pages.ended
            assert not caplog.records

    async def test_anybody_here_may_ask_whether_it_is_well_and_is_told_nothing_else(self):
        state, asked = {"broker": True, "shields": "working"}, []

        def health():
            asked.append(1)
            return dict(state)

        def secrets():
            raise AssertionError("it takes the loop that drives robots too long to tell all")

        pages = operator_pages("t0ken" * 6, secrets, health=health)
        async with serve_in_thread(pages), aiohttp.ClientSession() as http:
            url = f"http://127.0.0.1:{pages.port}/healthz"

            async def well(**headers):
                async with http.get(url, headers=headers) as answer:
                    return answer.status, await answer.json()

            assert await well() == (200, {"turns": True, "broker": True, "shields": "working"})
            for broker, shields, code in ((False, "working", 503), (True, "not working", 503), (True, "none", 200)):
                state |= {"broker": broker, "shields": shields}
                await asyncio.sleep(0.3)
                assert await well() == (code, {"turns": True, **state})
            for _ in range(100):
                await well()
            assert len(asked) < 30, "whoever asks and asks does not reach the gateway's loop each time"
            before = len(asked)
            await asyncio.sleep(0.3)
            # A fetch of a foreign page's names its origin; its images and scripts only that they are from elsewhere.
            for headers in ({"Origin": "https://evil.example"}, {"Sec-Fetch-Site": "cross-site"}):
                assert (await well(**headers))[0] == 403
            assert len(asked) == before

            def ask():
                with pytest.raises(urllib.error.HTTPError) as told:
                    urllib.request.urlopen(url, timeout=10)
                return told.value.code, json.loads(told.value.read())

            await asyncio.sleep(0.3)
            asking = asyncio.get_running_loop().run_in_executor(None, ask)
            time.sleep(2)  # the gateway's loop does not turn
            assert await asking == (503, {"turns": False, "broker": False, "shields": "not working"})

    def test_shields_work_while_a_robot_has_the_tokens_that_it_needs(self):
        shown: list[Shield] = []
        swarm = SimpleNamespace(shields=lambda: shown, new_audits=list, unchecked="")

        def shield(*left_s: float, stopped: bool = False) -> Shield:
            vouchers = tuple((f"R{i}", each) for i, each in enumerate(left_s, 2))
            return Shield(address="R1", needed=2, full_s=10.0, vouchers=vouchers, safe_mode=stopped, attack="")

        def health(at_s: float, *now: Shield) -> str:
            shown[:] = now
            watch.news(lambda _: 1, at_s)
            return watch.health(at_s)

        watch = ShieldWatch(swarm, lambda _: None)
        assert health(0.0) == "not working", "no robot was heard"
        assert health(1.0, shield(9.0)) == "not working"
        assert health(2.0, shield(9.0, 3.0)) == "working"
        swarm.unchecked = "the gateway's trusted nodes are gone"
        assert health(4.0) == "working", "its tokens are still good"
        assert health(6.0) == "not working"
        assert health(7.0, shield(9.0, 9.0, stopped=True)) == "not working"
        assert ShieldWatch(swarm, lambda _: None).health(8.0) == "none", "nobody ever checked tokens"

    async def test_a_foreign_name_for_loopback_is_turned_away(self, operator):
        headers = {"Authorization": "Bearer " + "t0ken" * 6, "Host": f"evil.example:{operator.port}"}
        async with aiohttp.ClientSession() as http:
            async with http.post(
                f"http://127.0.0.1:{operator.port}/api/link/state", json={}, headers=headers
            ) as answer:
                assert answer.status == 403
                assert "314159" not in await answer.text()

    async def test_idle_connections_are_hung_up_on_and_others_served_meanwhile(self, monkeypatch):
        monkeypatch.setattr("phalanx.net.site.HANG_UP_AFTER_S", 2.0)
        monkeypatch.setattr("phalanx.net.site.CHECK_S", 0.1)
        async with a_page() as pages, aiohttp.ClientSession() as http:

            async def visit() -> int:
                async with http.get(f"http://127.0.0.1:{pages.port}/") as answer:
                    await answer.read()
                    return answer.status

            idlers = [await asyncio.open_connection("127.0.0.1", pages.port) for _ in range(200)]
            for _, writer in idlers[:100]:
                writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")  # and never the empty line
            began, visits = time.monotonic(), 0
            while not all(reader.at_eof() or reader.exception() for reader, _ in idlers):
                assert await visit() == 200
                visits += 1
                assert time.monotonic() - began < 15
                await asyncio.sleep(0.1)
            assert visits > 5
            assert await visit() == 200
            assert len(http.connector._conns) == 1, "who goes on asking on one connection keeps it"
            for _, writer in idlers:
                writer.close()

    async def test_a_reader_that_stalls_does_not_keep_its_connection(self, monkeypatch):
        monkeypatch.setattr("phalanx.net.site.HANG_UP_AFTER_S", 1.0)
        monkeypatch.setattr("phalanx.net.site.CHECK_S", 0.1)
        async with a_page() as pages:
            script = next((PAGES / "visitor" / "assets").glob("*.js")).name
            _, writer = await asyncio.open_connection("127.0.0.1", pages.port, limit=1024)
            asked = f"GET /assets/{script} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
            writer.write(asked * 100)  # more than the sockets between us hold
            await eventually(lambda: pages._runner.server.connections)
            await eventually(lambda: not pages._runner.server.connections)
            writer.close()

    async def test_more_than_fit_leave_room_for_whoever_comes_and_for_the_gateways_own_files(self):
        before = open_files()
        async with a_page(connections=50) as pages, aiohttp.ClientSession() as http:
            crowd = [socket.create_connection(("127.0.0.1", pages.port)) for _ in range(60)]
            elsewhere = socket.create_connection(("127.0.0.1", pages.port), source_address=("127.0.0.2", 0))
            for _ in range(500):  # by one address, and silent
                crowd.append(await asyncio.to_thread(socket.create_connection, ("127.0.0.1", pages.port)))
            await eventually(lambda: open_files() - before - len(crowd) < 60)
            async with http.get(f"http://127.0.0.1:{pages.port}/") as answer:
                assert answer.status == 200
            elsewhere.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            elsewhere.settimeout(5)
            assert b" 200 " in await asyncio.to_thread(elsewhere.recv, 100), "pushed out by others"
            hung_up = sum(_is_hung_up(one) for one in crowd)
            assert hung_up >= len(crowd) - 50
            for one in (*crowd, elsewhere):
                one.close()

    async def test_who_has_the_token_keeps_its_seat_however_many_come_without(self, monkeypatch):
        monkeypatch.setattr("phalanx.gateway.serve_pages.OPERATORS", 20)
        asked = b"%s HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer " + b"t0ken" * 6 + b"\r\n\r\n"

        async def a_line(operator, said: bytes) -> bytes:
            reading, writing = operator
            writing.write(said)
            return await asyncio.wait_for(reading.readline(), 10)

        held: list[bool] = []
        async with operator_pages("t0ken" * 6, hold=held.append) as pages:
            operator = await asyncio.open_connection("127.0.0.1", pages.port)
            assert b" 200 " in await a_line(operator, asked % b"POST /api/go")
            crowd = []
            for _ in range(60):
                stranger = await asyncio.open_connection("127.0.0.1", pages.port)
                assert b" 200 " in await a_line(stranger, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                crowd.append(stranger)
            operator[1].write(asked % b"POST /api/stop")
            await eventually(lambda: held == [False, True])
            for _, writing in (operator, *crowd):
                writing.close()

    async def test_where_few_files_may_be_open_fewer_connections_are_let_in(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (400, hard))
        try:
            async with a_page() as pages:
                crowd = subprocess.Popen((sys.executable, "-c", IDLERS, str(pages.port)), stdout=subprocess.PIPE)
                assert await asyncio.to_thread(crowd.stdout.readline) == b"all there\n"
                await eventually(lambda: len(pages._runner.server.connections) <= 50)
                with Path("/dev/null").open():  # there is a file left for us
                    pass
                crowd.kill()
                crowd.communicate()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))

    @pytest.mark.parametrize(
        ("page", "websocket", "is_told"),
        [
            ("https://swarm.example/", "ws://192.168.1.7:9001/mqtt", True),
            ("https://swarm.example/", "wss://swarm.example/mqtt", False),
            ("http://192.168.1.7:8080/", "ws://192.168.1.7:9001/mqtt", False),
            ("https://swarm.example/", "ws://127.0.0.1:9001/mqtt", False),
        ],
    )
    async def test_a_page_by_https_whose_broker_no_browser_will_reach_is_said(self, page, websocket, is_told, caplog):
        where = f"mqtt://127.0.0.1:{free_port()}"
        options = UpOptions(qrkey=True, broker=where, broker_ws=websocket, port=0, wait_s=0.1, page_url=page)
        with pytest.raises(Unavailable):
            await up(options, lambda _: None, swarm=lambda: Dotbots(1, 1, time.time))
        told = f"browsers do not let an https page such as {page} reach {websocket}; hint: use a wss:// address"
        assert (told in caplog.text) == is_told

    async def test_who_asks_for_files_and_hangs_up_leaves_no_trace_in_the_log(self, caplog):
        async with a_page() as pages:
            for _ in range(30):
                _, writer = await asyncio.open_connection("127.0.0.1", pages.port)
                writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 3000)
                await asyncio.sleep(0.01)
                writer.transport.abort()
            await eventually(lambda: not pages._runner.server.connections)
        assert not [record for record in caplog.records if record.exc_info]

    async def test_a_port_in_use_is_one_clear_error(self, operator):
        with pytest.raises(Unavailable, match=f"cannot listen on 127.0.0.1 port {operator.port}") as taken:
            async with operator_pages("t0ken" * 6, port=operator.port):
                pass
        assert str(taken.value).endswith(f"port {operator.port}: Address already in use")
        assert "another program uses it" in taken.value.hint
        with pytest.raises(Unavailable, match=r"cannot listen on 999\.1\.1\.1") as nowhere:
            async with a_page(0, "999.1.1.1"):
                pass
        assert "use an address of this machine" in nowhere.value.hint
