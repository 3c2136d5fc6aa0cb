"""Look at what is around a gateway, for `phalanx doctor`: brokers, pages, ports, and the network."""

from __future__ import annotations

import asyncio
from pathlib import Path

from phalanx.config import LinkConfig
from phalanx.errors import PhalanxError
from phalanx.gateway import pages_are_built
from phalanx.gateway.up import DEFAULT_PORT
from phalanx.io import Server, parse_broker_url
from phalanx.io.broker import AMQTT_LACKS, BROKER_HINT, for_browsers, has_amqtt
from phalanx.io.mosquitto import find_mosquitto
from phalanx.io.phones import PhonesDoor
from phalanx.io.ports import LOOPBACK, is_free, lan_address

from .credentials import read_login, visitors_login_in
from .doctor import Finding


def findings(
    broker: str | None, broker_ws: str, root: str, broker_login: Path | None, visitors_login: Path | None
) -> list[Finding]:
    """Return what was found, also of a broker that is named. Raises: UsageError: the URL or a login is wrong."""
    login = read_login(broker_login) if broker else None
    url = parse_broker_url(broker, login) if broker else None
    visitors = visitors_login_in(visitors_login, login)
    found = [_broker(), _pages(), *_ports(), _address()]
    if url:
        config = LinkConfig(root=root)
        websocket = for_browsers(broker_ws)
        server = Server(url, config=config, broker_for_visitors=websocket, login_for_visitors=visitors)
        found += asyncio.run(_reach(server, str(url)))
    return found


def _broker() -> Finding:
    path = find_mosquitto()
    if path:
        return Finding("embedded broker", True, f"mosquitto at {path}")
    if has_amqtt():
        return Finding("embedded broker", True, f"amqtt, {AMQTT_LACKS}", "apt-get install mosquitto")
    return Finding("embedded broker", False, "none: phalanx up needs --broker URL", BROKER_HINT)


def _pages() -> Finding:
    built = pages_are_built()
    return Finding(
        "pages", built, "built" if built else "not built", "" if built else "make setup (needs node 20.19 and npm)"
    )


def _ports() -> list[Finding]:
    uses = {DEFAULT_PORT: "visitors' page", 1883: "broker", 9001: "broker, websocket"}
    return [
        Finding(
            f"port {port}",
            True,
            f"free ({use})" if is_free(port) else f"in use ({use}): another one will be taken",
        )
        for port, use in uses.items()
    ]


def _address() -> Finding:
    address = lan_address()
    if address == LOOPBACK:
        return Finding(
            "address", True, "no network: only this machine can visit", "connect it, then phalanx up --host 0.0.0.0"
        )
    return Finding("address", True, f"{address}: phones reach it with phalanx up --host 0.0.0.0")


async def _reach(server: Server, url: str) -> list[Finding]:
    """The broker for the gateway, and for phones; what they say is answered, if the gateway is in."""
    door = PhonesDoor(server)
    try:
        async with server:
            await server.wait_connected(3)
            here = Finding("broker", True, f"{url} answers, MQTT {'5' if server.qr().mqtt == 5 else '3.1.1'}")
            return [here, await _phones(server, door)]
    except TimeoutError:
        here = Finding(
            "broker", False, f"{url}: {server.trouble or 'no answer'}", "check host, port, firewall, TLS or not"
        )
    except PhalanxError as error:
        here = Finding("broker", False, str(error), getattr(error, "hint", ""))
    return [here, await _phones(server, door)]


async def _phones(server: Server, door: PhonesDoor) -> Finding:
    trouble, hint = await door.trouble()
    through = "what they say and are told gets through" if server.connected else "what gets through was not tried"
    well = f"{server.broker_for_visitors} lets them in; {through}"
    return Finding("broker, for phones", not trouble, trouble or well, hint)
