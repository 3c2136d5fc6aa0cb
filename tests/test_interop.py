"""Interoperability with the packages published with the paper, run unmodified (tests/peers).

Our server with the npm hook, and our client with the PyPI server. Each pair: request and reply, command, notify, and
following a rotation at 6 s / 2 s, by MQTT 5 and 3.1.1.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from brokers import with_an_old_pin
from phalanx.config import LinkConfig
from phalanx.link import Pin, QrUrl
from phalanx.net import ANY, QrkeyClient, Server
from waiting import eventually

pytestmark = [pytest.mark.waits, pytest.mark.peers, pytest.mark.timeout(120)]

HERE = Path(__file__).parent
NPM_PEER = HERE / "peers" / "npm_qrkey" / "dist" / "peer.cjs"
ROTATION = LinkConfig(rotate_s=6.0, overlap_s=2.0)
ONE_ROTATION = LinkConfig(rotate_s=60.0, overlap_s=1.0)
ADDRESS = "DECAFBAD00000001"


class Peer:
    """A child that reads orders and tells events, one JSON object a line."""

    def __init__(self, process: asyncio.subprocess.Process):
        self.process = process
        self.events: list[dict] = []
        self.logged = ""
        self.readers = [asyncio.create_task(self._read()), asyncio.create_task(self._read_log())]

    async def _read(self):
        while line := await self.process.stdout.readline():
            self.events.append(json.loads(line))

    async def _read_log(self):
        while line := await self.process.stderr.readline():
            self.logged += line.decode(errors="replace")

    def order(self, **words):
        self.process.stdin.write((json.dumps(words) + "\n").encode())

    def told(self, kind: str, **words) -> list[dict]:
        return [
            event
            for event in self.events
            if event.get("event") == kind and all(event.get(key) == value for key, value in words.items())
        ]

    async def wait(self, kind: str, count: int = 1, timeout_s: float = 15.0, **words) -> dict:
        def enough():
            assert self.process.returncode is None, self.logged[-2000:]
            return len(self.told(kind, **words)) >= count

        try:
            await eventually(enough, timeout_s)
        except AssertionError as error:
            raise AssertionError(
                f"{error}; no {kind} {words} in {self.events[-5:]}, log {self.logged[-1500:]}"
            ) from None
        return self.told(kind, **words)[count - 1]


@asynccontextmanager
async def a_peer(*command: str, env: dict[str, str] | None = None, cwd: Path = HERE):
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | (env or {}),
        cwd=cwd,
        limit=1 << 24,
        start_new_session=True,
    )
    peer = Peer(process)
    try:
        yield peer
    finally:
        with contextlib.suppress(ProcessLookupError):  # the group: npx is only the first of it
            os.killpg(process.pid, signal.SIGKILL)
        process.stdin.close()
        # To the end of both pipes, or the garbage collector closes them when the event loop is gone.
        await asyncio.gather(*peer.readers, process.wait(), return_exceptions=True)


def published_server(broker, mqtt: int, *arguments: str, **env: str):
    settings = {
        "MQTT_HOST": broker.url.host,
        "MQTT_PORT": str(broker.url.port),
        "MQTT_VERSION": str(mqtt),
        "PIN_CODE_REFRESH_INTERVAL": "6",
        "PIN_CODE_REVOKE_DELAY": "2",
    }
    return a_peer(sys.executable, "peers/pypi_qrkey_server.py", *arguments, env=settings | env)


def published_hook(server: Server, broker, mqtt: int):
    host, port = broker.websocket.split("/")[2].split(":")
    words = {"--pin": server.epoch.pin.digits, "--host": host, "--port": port, "--version": str(mqtt)}
    return a_peer("node", str(NPM_PEER), *(word for pair in words.items() for word in pair))


def an_echo(broker, mqtt: int = 5, config: LinkConfig = ROTATION) -> Server:
    server = Server(broker.url, broker_for_visitors=broker.websocket, mqtt=mqtt, config=config)
    server.heard = []

    @server.on_command(ANY)
    def hear(command):
        server.heard.append((command.address, command.topic.application, command.name, command.payload))

    @server.on_request(0)
    def robots(request):
        return [{"address": ADDRESS, "n": len(server.heard)}]

    return server


def link_to(broker, pin: str, mqtt: int) -> QrUrl:
    return QrUrl(Pin(pin), broker.websocket, "/qrkey", mqtt)


@pytest.mark.parametrize("mqtt", [5, 4])
async def test_our_server_and_the_published_hook(broker, mqtt):
    async with an_echo(broker, mqtt) as server:
        await server.wait_connected(10)
        async with published_hook(server, broker, mqtt) as hook:
            ready = await hook.wait("ready")
            reply_topic = f"/reply/{ready['client_id']}"

            async def a_round(n: int):
                heard = len(server.heard)
                hook.order(do="command", address=ADDRESS, application="0", name="move_raw", payload={"left_y": n})
                await eventually(lambda: len(server.heard) > heard)
                assert server.heard[-1] == (ADDRESS, "0", "move_raw", {"left_y": n})
                hook.order(do="request", request=0)
                answer = {"request": 0, "data": [{"address": ADDRESS, "n": len(server.heard)}]}
                await hook.wait("message", topic=reply_topic, payload=answer)
                await asyncio.sleep(0.05)  # the hook drops messages that come within milliseconds of each other
                await server.notify({"cmd": 2, "n": n})
                await hook.wait("message", topic="/notify", payload={"cmd": 2, "n": n})

            await a_round(1)
            before = server.epoch
            await hook.wait("moved")
            assert server.epoch is not before
            await a_round(2)
            await eventually(lambda: not server.overlapping)
            await a_round(3)
        assert not server.rejected


@pytest.mark.parametrize("mqtt", [5, 4])
async def test_our_python_client_and_the_published_server(broker, mqtt):
    async with published_server(broker, mqtt) as server:
        pin = (await server.wait("ready"))["pin"]
        async with QrkeyClient(link_to(broker, pin, mqtt)) as client:
            notes = client.notifications()

            async def a_round(n: int):
                await client.command(ADDRESS, "move_raw", {"left_y": n})
                topic = f"/command/0000/{ADDRESS}/0/move_raw"
                await server.wait("command", topic=topic, payload={"left_y": n})
                assert await client.request(0) == {"request": 0, "reply": client.client_id}
                server.order(do="notify", payload={"cmd": 2, "n": n})
                assert await asyncio.wait_for(anext(notes), 5) == {"cmd": 2, "n": n}

            await a_round(1)
            await server.wait("rotated")
            await eventually(lambda: client.moves)
            await a_round(2)
            await asyncio.sleep(2.5)  # the overlap ends
            await a_round(3)
            # What was on its way to the epoch that the client left, such as an answer asked for twice, is not for it.
            assert client.rejected.keys() <= {"wrong_topic"}


async def test_a_published_hook_that_slept_is_led_on_by_our_server(broker):
    # Ten seconds to start the hook of node in, and fifty for it to wake up.
    async with with_an_old_pin(an_echo(broker, config=ONE_ROTATION), 50.0) as server:
        await server.wait_connected(10)
        async with published_hook(server, broker, 5) as hook:
            await hook.wait("ready")
            os.kill(hook.process.pid, signal.SIGSTOP)
            assert not server.overlapping
            await eventually(lambda: server.overlapping, 15)
            await eventually(lambda: not server.overlapping)
            os.kill(hook.process.pid, signal.SIGCONT)
            await hook.wait("moved")
            hook.order(do="request", request=0)
            await hook.wait("message", payload={"request": 0, "data": [{"address": ADDRESS, "n": 0}]})
