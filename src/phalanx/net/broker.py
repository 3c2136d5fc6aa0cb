"""Which broker to use for mode qrkey: a mosquitto of ours, or one that runs elsewhere."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass

from phalanx.errors import UsageError, did_you_mean
from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl, parse_broker_url, websocket_of
from .mosquitto import mosquitto
from .ports import EVERYWHERE, LOOPBACK, at_a_free_port, free_port
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
    """Return whether a broker of ours is asked for. Raises: UsageError: one that phalanx no longer has."""
    if kind in GONE:
        hint = f"--broker {MOSQUITTO}, or a URL; phalanx up needs none: visitors reach this machine itself"
        raise UsageError(f"there is no --broker {kind} any more", hint)
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
    """Yield the broker that `kind` asks for: mosquitto, which is started, or a URL.

    Of a broker elsewhere, `login` is for it and `websocket` its URL for browsers, where `kind` does not tell that. Ours
    listens for browsers at `ws_host`, loopback unless asked; ports of 0 are 1883 and 9001 or any free ones.

    Raises: UsageError: a bad URL, or what is for a broker elsewhere given for ours. Unavailable: ours fails, or is not
        installed.
    """
    sweep()
    if not is_ours(kind):
        url = parse_broker_url(kind, login)
        if "://" not in kind:
            meant = did_you_mean(kind, (MOSQUITTO,)) if "." not in kind else ""  # test.mosquitto.org is a host
            log.warning("%r is taken for a host: %s; hint: %s%s, or a URL", kind, url, meant, MOSQUITTO)
        yield RunningBroker("external", url, for_browsers(websocket) or websocket_of(url))
        return
    if websocket:
        raise UsageError("a websocket address for a broker of our own", "give it with a --broker URL only")
    async with contextlib.AsyncExitStack() as stack:

        async def start() -> tuple[int, int]:
            ports = tcp_port or free_port(1883), ws_port or free_port(9001, ws_host)
            await stack.enter_async_context(mosquitto(ports[0], ws_host, ports[1]))
            return ports

        port, at = await at_a_free_port(start)
        ws = BrokerUrl("ws", LOOPBACK if ws_host in EVERYWHERE else ws_host, at, "/mqtt")
        yield RunningBroker(MOSQUITTO, BrokerUrl("mqtt", LOOPBACK, port), str(ws))


def for_browsers(websocket: str) -> str:
    """Return a broker's URL for browsers, whole, or "". Raises: UsageError: not a URL, or not by websocket."""
    if not websocket:
        return ""
    at = parse_broker_url(websocket)
    if not at.websockets:
        raise UsageError(f"browsers cannot use {at}", "a ws:// or wss:// URL")
    return str(at)
