"""Who a client is counted as, and HTTPS."""

from __future__ import annotations

import socket
import ssl

import aiohttp
import pytest

from front_world import Raw, echoing
from phalanx.config.front import FrontConfig
from phalanx.errors import UsageError
from phalanx.net.front import Front, Opened

pytestmark = pytest.mark.waits


def has_ipv6() -> bool:
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6):
            return True
    except OSError:
        return False


class TestTls:
    async def test_page_and_websocket_over_https(self, pages, tls):
        context = ssl.create_default_context(cafile=str(tls[0]))
        async with echoing(pages, tls=tls) as echo, aiohttp.ClientSession() as session:
            where = f"https://localhost:{echo.front.port}"
            async with session.get(where, ssl=context) as page:
                assert await page.text() == "<p>drive"
            async with session.ws_connect(f"{where}/link", ssl=context) as websocket:
                await websocket.send_bytes(b"hello")
                assert await websocket.receive_bytes(timeout=30) == b"hello"
                echo.front.publish([1], b"x" * 300_000)
                assert await websocket.receive_bytes(timeout=30) == b"x" * 300_000

    async def test_handshakes_that_are_not_finished_are_counted_and_closed(self, pages, tls):
        context = ssl.create_default_context(cafile=str(tls[0]))
        async with echoing(pages, tls=tls, newcomers_max_per_address=5, head_s=300.0) as echo:
            silent = [Raw(echo.front.port, "127.0.0.9") for _ in range(20)]
            await echo.eventually(lambda: sum(each.is_open for each in silent) <= 5)
            async with aiohttp.ClientSession() as session:
                async with session.get(f"https://localhost:{echo.front.port}", ssl=context) as page:
                    assert page.status == 200
            for each in silent:
                each.socket.close()

    @pytest.mark.parametrize("cert", ["missing.pem", "key.pem"])
    async def test_files_that_do_not_fit_are_a_mistake_of_the_user(self, pages, tls, cert):
        files = (tls[0].with_name(cert), tls[1])
        with pytest.raises(UsageError, match="cannot serve HTTPS") as caught:
            async with Front(pages, "x", "127.0.0.1", 0, FrontConfig(), files):
                pass
        assert "PEM" in caught.value.hint


class TestAddresses:
    async def address(self, port: int, address: str, headers: bytes, echo) -> str:
        with Raw(port, address) as client:
            before = len(echo.told)
            (await client.websocket(headers)).say(b"hello")
            await echo.eventually(lambda: any(isinstance(each, Opened) for each in echo.told[before:]))
            return next(each.address for each in reversed(echo.told) if isinstance(each, Opened))

    async def test_behind_a_proxy_the_last_entry_counts(self, pages):
        async with echoing(pages, behind_proxy=True) as echo:
            for headers, counted in (
                (b"X-Forwarded-For: 10.0.0.1\r\n", "10.0.0.1"),
                (b"X-Forwarded-For: 10.0.0.1, 10.0.0.2\r\n", "10.0.0.2"),
                (b"X-Forwarded-For: 10.0.0.1\r\nX-Forwarded-For: 10.0.0.3\r\n", "10.0.0.3"),
                (b"X-Forwarded-For: 2001:db8:1:2:3:4:5:6\r\n", "2001:db8:1:2::/64"),
                (b"X-Forwarded-For: ::ffff:10.0.0.4\r\n", "10.0.0.4"),
                (b"X-Forwarded-For: nonsense\r\n", "127.0.0.7"),
                (b"", "127.0.0.7"),
            ):
                assert await self.address(echo.front.port, "127.0.0.7", headers, echo) == counted, headers

    async def test_else_the_header_is_anybodys(self, pages):
        async with echoing(pages) as echo:
            headers = b"X-Forwarded-For: 10.0.0.1\r\n"
            assert await self.address(echo.front.port, "127.0.0.7", headers, echo) == "127.0.0.7"

    async def test_behind_a_proxy_websockets_are_counted_by_it(self, pages):
        limits = {"newcomers_max_per_address": 3, "first_message_s": 300.0}
        async with echoing(pages, behind_proxy=True, **limits) as echo:
            here = [Raw(echo.front.port) for _ in range(6)]
            for each in here:
                await each.websocket(b"X-Forwarded-For: 10.0.0.1\r\n")
            there = await Raw(echo.front.port).websocket(b"X-Forwarded-For: 10.0.0.2\r\n")
            await echo.eventually(lambda: sum(each.is_open for each in here) == 3)
            assert there.is_open
            for each in (*here, there):
                each.socket.close()

    @pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")
    @pytest.mark.parametrize("host", ["::1", "::"])
    async def test_over_ipv6(self, pages, host):
        async with echoing(pages, host=host) as echo, aiohttp.ClientSession() as session:
            async with session.ws_connect(f"http://[::1]:{echo.front.port}/link") as websocket:
                await websocket.send_bytes(b"hello")
                assert await websocket.receive_bytes(timeout=30) == b"hello"
            assert echo.told[0] == Opened(1, "::/64")
            if host == "::":
                async with session.ws_connect(f"http://127.0.0.1:{echo.front.port}/link") as websocket:
                    await websocket.send_bytes(b"hello")
                    await websocket.receive_bytes(timeout=30)
                assert Opened(2, "127.0.0.1") in echo.told
