"""Choice of the broker for mode qrkey: a mosquitto started by phalanx, or an external one."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass

from phalanx.errors import UsageError, did_you_mean
from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl, parse_broker_url, websocket_of
from .mosquitto import mosquitto
from .ports import EVERYWHERE, LOOPBACK, free_port, retry_while_port_taken
from .private_file import sweep

log = logging.getLogger(__name__)

MOSQUITTO = "mosquitto"
GONE = ("auto", "amqtt")


@dataclass(frozen=True, slots=True)
class RunningBroker:
    """A broker to use."""

    name: str  # mosquitto or external
    url: BrokerUrl  # for programs on this machine
    websocket: str  # for browsers, as seen from this machine


def is_ours(kind: str) -> bool:
    """Return whether phalanx is to start the broker. Raises: UsageError: a kind that phalanx no longer has."""
    if kind in GONE:
        hint = f"use --broker {MOSQUITTO} or a URL; phalanx up needs no broker if visitors reach this machine"
        raise UsageError(f"--broker {kind} no longer exists", hint)
    return kind == MOSQUITTO


@contextlib.asynccontextmanager
async def open_broker(
    kind: str,
    *,
    login: Login | None = None,
    websocket: str = "",
    ws_host: str = LOOPBACK,
    tcp_port: int = 0,
    ws_port: int = 0,
) -> AsyncIterator[RunningBroker]:
    """Start mosquitto, or parse the URL of an external broker; yield the broker.

    Args:
        kind: "mosquitto", or the URL of an external broker.
        login: for an external broker.
        websocket: URL of an external broker for browsers, if it does not follow from `kind`.
        ws_host: address on which mosquitto listens for browsers.
        tcp_port, ws_port: ports of mosquitto; 0: 1883 and 9001 if they are free, else any.
    Raises: UsageError: a bad URL, or `websocket` with mosquitto. Unavailable: mosquitto fails, or is not installed.
    """
    sweep()
    if not is_ours(kind):
        url = parse_broker_url(kind, login)
        if "://" not in kind:
            meant = did_you_mean(kind, (MOSQUITTO,)) if "." not in kind else ""  # test.mosquitto.org is a host
            log.warning("%r is used as a host: %s; hint: %suse %s, or a URL", kind, url, meant, MOSQUITTO)
        yield RunningBroker("external", url, for_browsers(websocket) or websocket_of(url))
        return
    if websocket:
        raise UsageError("--broker-ws without an external broker", "use it only with a --broker URL")
    async with contextlib.AsyncExitStack() as stack:

        async def start() -> tuple[int, int]:
            ports = tcp_port or free_port(1883), ws_port or free_port(9001, ws_host)
            await stack.enter_async_context(mosquitto(ports[0], ws_host, ports[1]))
            return ports

        port, at = await retry_while_port_taken(start)
        ws = BrokerUrl("ws", LOOPBACK if ws_host in EVERYWHERE else ws_host, at, "/mqtt")
        yield RunningBroker(MOSQUITTO, BrokerUrl("mqtt", LOOPBACK, port), str(ws))


def for_browsers(websocket: str) -> str:
    """Return a broker's complete URL for browsers, or "". Raises: UsageError: not a URL, or not a websocket."""
    if not websocket:
        return ""
    at = parse_broker_url(websocket)
    if not at.websockets:
        raise UsageError(f"browsers cannot use {at}", "use a ws:// or wss:// URL")
    return str(at)
