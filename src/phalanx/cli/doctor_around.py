"""Check a gateway's environment for `phalanx doctor`: brokers, pages, ports, and the network."""

from __future__ import annotations

import asyncio
from pathlib import Path

from phalanx.config import LinkConfig
from phalanx.errors import PhalanxError
from phalanx.gateway import pages_are_built
from phalanx.gateway.up import DEFAULT_PORT
from phalanx.net import BrokerUrl, Server, parse_broker_url
from phalanx.net.broker import for_browsers
from phalanx.net.mosquitto import find_mosquitto
from phalanx.net.ports import LOOPBACK, is_free, lan_address

from .credentials import read_login
from .doctor import Finding

CONNECT_S = 3.0


def findings(broker: str | None, broker_ws: str, root: str, broker_login: Path | None) -> list[Finding]:
    """Return the findings, including those of a given broker. Raises: UsageError: the URL or a login is invalid."""
    login = read_login(broker_login) if broker else None
    url = parse_broker_url(broker, login) if broker else None
    found = [_broker(), _pages(), *_ports(), _address()]
    if url:
        server = Server(url, config=LinkConfig(root=root), broker_for_visitors=for_browsers(broker_ws))
        found += asyncio.run(_reach(server, str(url)))
    return found


def _broker() -> Finding:
    path = find_mosquitto()
    return Finding(
        "broker of our own",
        True,
        f"mosquitto at {path}" if path else "not installed: --broker mosquitto needs it",
        "" if path else "run apt-get install mosquitto",
    )


def _pages() -> Finding:
    built = pages_are_built()
    return Finding(
        "pages", built, "built" if built else "not built", "" if built else "run make setup (needs node 20.19 and npm)"
    )


def _ports() -> list[Finding]:
    uses = {DEFAULT_PORT: "visitors' page", 1883: "broker", 9001: "broker, websocket"}
    return [
        Finding(
            f"port {port}",
            True,
            f"free ({use})" if is_free(port) else f"in use ({use}): another port will be used",
        )
        for port, use in uses.items()
    ]


def _address() -> Finding:
    address = lan_address()
    if address == LOOPBACK:
        return Finding(
            "address", True, "no network: only this machine can visit", "connect it, then run phalanx up --host 0.0.0.0"
        )
    return Finding("address", True, f"{address}: phones reach it with phalanx up --host 0.0.0.0")


async def _reach(server: Server, url: str) -> list[Finding]:
    """Return whether the gateway, and phones, can connect to the broker."""
    try:
        async with server:
            await server.wait_connected(CONNECT_S)
            here = Finding("broker", True, f"{url} answers, MQTT {'5' if server.qr().mqtt == 5 else '3.1.1'}")
    except TimeoutError:
        here = Finding("broker", False, f"{url}: {server.trouble or 'no answer'}", "check host, port, firewall and TLS")
    except PhalanxError as error:
        here = Finding("broker", False, str(error), getattr(error, "hint", ""))
    return [here, await _for_phones(parse_broker_url(server.broker_for_visitors))]


async def _for_phones(at: BrokerUrl) -> Finding:
    try:
        async with asyncio.timeout(CONNECT_S):
            _, writer = await asyncio.open_connection(at.host, at.port)
            writer.close()
    except (OSError, UnicodeError, TimeoutError):
        return Finding("broker, for phones", False, f"no answer at {at}, the address for phones", "use --broker-ws")
    return Finding("broker, for phones", True, f"{at} accepts connections")
