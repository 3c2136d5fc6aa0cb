"""The example in deploy/ of a broker of one's own does what it says, in a real mosquitto."""

from __future__ import annotations

import asyncio
import os
import subprocess

import aiomqtt
import pytest

from brokers import bare_mosquitto
from commands import ROOT, a_gateway, run
from phalanx.net.session_client import Client
from ports import free_port

pytestmark = pytest.mark.waits

DEPLOY = ROOT / "deploy"
MINE = "/qrkey/somewhere"


@pytest.fixture
def broker(tmp_path):
    """The example, with files and ports of the test's own: its port and that for browsers."""
    users = tmp_path / "phalanx.passwords"
    subprocess.run(["mosquitto_passwd", "-c", "-b", users, "gateway", "gateway-secret"], check=True)
    text = (DEPLOY / "mosquitto.conf").read_text()
    text = text.replace("/etc/mosquitto/phalanx.passwords", str(users))
    text = text.replace("/etc/mosquitto/phalanx.acl", str(DEPLOY / "mosquitto.acl"))
    head, *listeners = text.split("listener ")
    assert [each.split()[0] for each in listeners] == ["1883", "9001"]
    tcp, ws = free_port(), free_port()
    listening = f"listener {tcp}{listeners[0][4:]}listener {ws} 127.0.0.1{listeners[1][4:]}"
    own = ("user root",) if os.geteuid() == 0 else ()  # or it would become somebody who may not read the test's files
    with bare_mosquitto(free_port(), free_port(), tmp_path, *own, head, listening) as (start, _):
        start()
        yield tcp, ws


async def connected(port: int, name: str | None = None, transport: str = "tcp") -> aiomqtt.Client:
    password = f"{name}-secret" if name else None
    async with asyncio.timeout(10):
        while True:
            client = aiomqtt.Client("127.0.0.1", port, username=name, password=password, transport=transport)
            try:
                return await client.__aenter__()
            except aiomqtt.MqttCodeError as error:
                raise PermissionError from error
            except aiomqtt.MqttError:
                await asyncio.sleep(0.05)


async def heard(client: aiomqtt.Client) -> set[str]:
    """All topics of which it was told until the one with which everything ends."""
    told = set()
    async with asyncio.timeout(10):
        async for message in client.messages:
            told.add(str(message.topic))
            if str(message.topic).endswith("/reply/end"):
                return told
    return told


async def test_visitors_write_requests_and_commands_and_read_notices_and_replies_only(broker):
    tcp, ws = broker
    gateway = await connected(tcp, "gateway")
    visitor, other = await connected(ws, transport="websockets"), await connected(ws, "", "websockets")
    for client in (gateway, visitor, other):
        await client.subscribe("#")
    subs = (
        "request",
        "command/0000/AB/0/move_raw",
        "notify",
        "reply/one",
        "request/x",
        "notify/x",
        "reply/a/b",
        "other",
    )
    for sub in subs:
        await visitor.publish(f"{MINE}/{sub}", "of a visitor")
    await visitor.publish("/elsewhere/t/request", "of a visitor")
    await asyncio.sleep(0.3)
    await gateway.publish(f"{MINE}/reply/end")
    assert await heard(gateway) == {f"{MINE}/{sub}" for sub in (*subs[:2], "reply/end")}
    assert await heard(visitor) == await heard(other) == {f"{MINE}/reply/end"}
    for sub in subs:
        await gateway.publish(f"{MINE}/{sub}", "of the gateway")
    await gateway.publish(f"{MINE}/reply/end")
    assert await heard(other) == {f"{MINE}/{sub}" for sub in ("notify", "reply/one", "reply/end")}


@pytest.mark.parametrize("name", [None, "nobody"])
async def test_nobody_gets_in_at_the_gateways_door_without_its_login(broker, name):
    with pytest.raises(PermissionError):
        await connected(broker[0], name)


async def test_a_gateway_and_a_visitor_meet_there(broker, tmp_path):
    tcp, ws = broker
    (tmp_path / "login").write_text("gateway:gateway-secret\n")
    where = ("--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", f"ws://127.0.0.1:{ws}/mqtt")
    with a_gateway(*where, "--broker-login", str(tmp_path / "login"), qrkey=True) as (up, ready):
        assert not up.err
        async with Client(ready["session_url"]) as client:
            await client.robots()
        drive = run("link", "connect", "-", "--drive", "Ada", "--left", "30", "--for", "0.5", input=ready["qrkey_url"])
        assert drive.returncode == 0, drive.stderr
        assert up.wait_for("command")["name"] == "move_raw"
