"""Which broker to use: mosquitto if it is here, else amqtt if that is, or one that runs elsewhere."""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

from phalanx.errors import Unavailable, UsageError, did_you_mean
from phalanx.link.qrurl import Login

from .broker_url import BrokerUrl, parse_broker_url, websocket_of
from .heard import Heard
from .listeners import Listeners
from .mosquitto import find_mosquitto, mosquitto
from .ports import EVERYWHERE, LOOPBACK, at_a_free_port, free_port
from .private_file import sweep

log = logging.getLogger(__name__)

EMBEDDED = ("auto", "mosquitto", "amqtt")
BROKER_HINT = "apt-get install mosquitto, or pip install '.[amqtt]' in a clone"
AMQTT_LACKS = "which is slower, and speaks MQTT 3.1.1 only"


@dataclass(frozen=True, slots=True)
class RunningBroker:
    """A broker to use."""

    name: str  # mosquitto, amqtt or external
    url: BrokerUrl  # for visitors' programs on this machine
    gateway: BrokerUrl  # for the gateway; the only one who may speak as the swarm, where the broker is ours
    websocket: str  # for browsers, as seen from this machine
    mqtt: int  # protocol version to begin with
    visitors_login: Login | None = None  # for browsers, of a broker elsewhere
    heard: Heard | None = None  # what the gateway shall tell the guard, where the broker is ours


def has_amqtt() -> bool:
    """Whether the extra `amqtt` is installed."""
    return importlib.util.find_spec("amqtt") is not None


@contextlib.asynccontextmanager
async def open_broker(
    kind: str = "auto",
    *,
    login: Login | None = None,
    websocket: str = "",
    visitors_login: Login | None = None,
    ws_host: str = LOOPBACK,
    tcp_port: int = 0,
    ws_port: int = 0,
    root: str = "/qrkey",
) -> AsyncIterator[RunningBroker]:
    """The broker that `kind` asks for: auto, mosquitto, amqtt, or a URL.

    Of a broker elsewhere, `login` is for it and `websocket` its URL for browsers, where `kind` does not tell that;
    `visitors_login` is what they say there, if it asks. One of ours listens for browsers at `ws_host`, loopback unless
    asked; ports of 0 are 1883 and 9001 or any free ones. `root` is the first part of every topic that it lets visitors
    use.

    Raises: UsageError: a bad URL, or what is for a broker elsewhere given for one of ours. Unavailable: ours fails, or
        is not installed.
    """
    sweep()
    if kind not in EMBEDDED:
        url = parse_broker_url(kind, login)
        if "://" not in kind:
            meant = did_you_mean(kind, EMBEDDED) if "." not in kind else ""  # test.mosquitto.org is a host
            log.warning("%r is taken for a host: %s; hint: %s%s, or a URL", kind, url, meant, ", ".join(EMBEDDED))
        yield RunningBroker("external", url, url, for_browsers(websocket) or websocket_of(url), 5, visitors_login)
        return
    if websocket or visitors_login:
        what = "a websocket address" if websocket else "a login of visitors"
        raise UsageError(f"{what} for a broker of our own", "give it with a --broker URL only")
    name = kind if kind != "auto" else "mosquitto" if find_mosquitto() else "amqtt"
    if name == "amqtt" and not has_amqtt():
        raise Unavailable(
            "amqtt is not installed" if kind == name else "neither mosquitto nor amqtt is installed", BROKER_HINT
        )
    if name == "amqtt" != kind:
        log.warning(
            "mosquitto is not installed: the broker is amqtt, %s; hint: %s", AMQTT_LACKS, "apt-get install mosquitto"
        )
    own_login = Login("gateway", secrets.token_hex(16))
    async with contextlib.AsyncExitStack() as stack:
        at, heard = await _start(stack, name, Listeners(tcp_port, 0, ws_host, ws_port, own_login, root))
        visitors = BrokerUrl("mqtt", LOOPBACK, at.visitors_port)
        ws = str(BrokerUrl("ws", LOOPBACK if ws_host in EVERYWHERE else ws_host, at.ws_port, "/mqtt"))
        yield RunningBroker(name, visitors, at.gateway, ws, 4 if name == "amqtt" else 5, heard=heard)


def for_browsers(websocket: str) -> str:
    """A broker's URL for browsers, whole; "" if none is given. Raises: UsageError: not a URL, or not by websocket."""
    if not websocket:
        return ""
    at = parse_broker_url(websocket)
    if not at.websockets:
        raise UsageError(f"browsers cannot use {at}", "a ws:// or wss:// URL")
    return str(at)


async def _start(stack: contextlib.AsyncExitStack, name: str, asked: Listeners) -> tuple[Listeners, Heard]:
    """Return where it listens, and what the gateway shall tell its guard. A port 0 stands for a free one."""

    async def start() -> tuple[Listeners, Heard]:
        port = asked.visitors_port or free_port(1883)
        ws_port = asked.ws_port or free_port(9001, asked.ws_host)
        at = replace(asked, visitors_port=port, gateway_port=free_port(), ws_port=ws_port)
        if name == "mosquitto":
            return at, await stack.enter_async_context(mosquitto(at))
        from .amqtt_broker import amqtt  # noqa: PLC0415 - an extra

        return at, await stack.enter_async_context(amqtt(at))

    return await at_a_free_port(start)
