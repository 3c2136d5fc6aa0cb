"""The front end as a real process: page, websocket, and what the gateway is told of it."""

from __future__ import annotations

import asyncio
import contextlib

import aiohttp
import pytest

from phalanx.config.front import FrontConfig
from phalanx.io.front import Closed, Front, Opened, Received

pytestmark = pytest.mark.waits


@pytest.fixture
def pages(tmp_path):
    folder = tmp_path / "pages"
    folder.mkdir()
    (folder / "index.html").write_text("<p>drive")
    return folder


class Echo:
    """A gateway that answers each message with it, and notes what it is told."""

    def __init__(self, front: Front) -> None:
        self.front, self.told = front, []

    async def run(self) -> None:
        async for event in self.front.events():
            self.told.append(event)
            if isinstance(event, Received):
                self.front.admitted(event.connection)
                self.front.send(event.connection, event.data)


@contextlib.asynccontextmanager
async def echoing(pages, limits=None, **more):
    async with Front(pages, "default-src 'self'", "127.0.0.1", 0, limits or FrontConfig(), **more) as front:
        echo = Echo(front)
        running = asyncio.create_task(echo.run())
        try:
            yield echo
        finally:
            running.cancel()


def url(front, path="/"):
    return f"http://127.0.0.1:{front.port}{path}"


async def test_page_and_websocket_on_one_port(pages):
    async with echoing(pages) as echo, aiohttp.ClientSession() as session:
        async with session.get(url(echo.front)) as page:
            assert await page.text() == "<p>drive"
            assert page.headers["Content-Security-Policy"] == "default-src 'self'"
        async with session.ws_connect(url(echo.front, "/link")) as websocket:
            for n in range(100):
                data = bytes([n]) * (1 + 10 * n)
                await websocket.send_bytes(data)
                assert await websocket.receive_bytes(timeout=10) == data
        while not isinstance(echo.told[-1], Closed):
            await asyncio.sleep(0.01)
        assert echo.told[0] == Opened(1, "127.0.0.1")
        assert echo.told[-1] == Closed(1)
        assert len(echo.told) == 102


async def test_an_update_reaches_those_it_is_for_and_a_close_follows_what_was_sent(pages):
    async with echoing(pages) as echo, aiohttp.ClientSession() as session:
        sockets = [await session.ws_connect(url(echo.front, "/link")) for _ in range(3)]
        for websocket in sockets:
            await websocket.send_bytes(b"hello")
            assert await websocket.receive_bytes(timeout=10) == b"hello"
        echo.front.publish([1, 3, 99], b"update")
        for websocket in sockets:
            await websocket.send_bytes(b"more")
        assert [await sockets[n].receive_bytes(timeout=10) for n in (0, 2)] == [b"update"] * 2
        assert await sockets[1].receive_bytes(timeout=10) == b"more"
        echo.front.send(2, b"x" * 100_000)
        echo.front.close(2, "removed")
        echo.front.send(2, b"too late")
        assert await sockets[1].receive_bytes(timeout=10) == b"x" * 100_000
        end = await sockets[1].receive(timeout=10)
        assert (end.type, end.data, end.extra) == (aiohttp.WSMsgType.CLOSE, 1000, "removed")
        while Closed(2) not in echo.told:
            await asyncio.sleep(0.01)
