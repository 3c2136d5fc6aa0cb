"""Mode qrkey beside sessions: a broker, and one code that all its visitors share. For published pages and programs."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from phalanx.io import Server, parse_broker_url
from phalanx.io.broker import RunningBroker, open_broker
from phalanx.io.broker_url import on_host
from phalanx.io.phones import PhonesDoor, no_way_from, warn_if_phones_are_locked_out
from phalanx.io.server import Happening
from phalanx.link import Request
from phalanx.link.messages import Rejected

from .serving import tell_event

if TYPE_CHECKING:
    from .up import UpOptions

log = logging.getLogger(__name__)

REPORT_S = 1.0
ASK_FOR_PHONES_S = 20.0


class SharedCode:
    """A server of mode qrkey, its broker, and whether phones get through to it.

    Attributes:
        server: the `Link`.
        broker: that it is connected to.
    """

    def __init__(self, options: UpOptions, broker: RunningBroker, server: Server, page_url: str) -> None:
        self.broker, self.server = broker, server
        self._options, self._page_url = options, page_url
        self._door = PhonesDoor(server) if broker.name == "external" else None
        self._no_phone = self._blocked = no_way_from(options.frontend or page_url, server.broker_for_visitors)
        if self._blocked:
            log.warning("%s; hint: a wss:// one, with --broker URL --broker-ws", self._blocked)

    @property
    def qr_url(self) -> str:
        """Return what its QR code says now."""
        qr = self.server.qr()
        return qr.for_foreign_page(self._options.frontend) if self._options.frontend else qr.for_page(self._page_url)

    def ready(self) -> dict[str, Any]:
        """Return what the first event says of it. Has the pin in it."""
        return {
            "qr_url": self.qr_url,
            "pin": self.server.epoch.pin.digits,
            "topic": self.server.epoch.topic,
            "broker_host": self.broker.url.host,
            "broker_port": self.broker.url.port,
            "broker_ws_port": parse_broker_url(self.broker.websocket).port,
        }

    def broker_state(self) -> dict[str, Any]:
        """Return what the operator's page shows of the broker."""
        return {
            "name": self.broker.name,
            "url": str(self.broker.url),
            "connected": self.server.connected,
            "trouble": self.server.trouble,
            "phones": self._no_phone,
        }

    def count(self, what: str) -> int:
        """Return how often that came, but for what we asked ourselves through the phones' door."""
        return max(0, self.server.counters[what] - (self._door.counters[what] if self._door else 0))

    def event(self, said: Happening) -> dict[str, Any] | None:
        """Return what happened, in JSON's types; None for what is nobody's business: pages ask all the time."""
        told = tell_event(said, lambda: self.qr_url)
        if told is None or isinstance(said, Request) or (self._door and self._door.is_knocking(said)):
            return None
        if isinstance(said, Rejected):
            told["count"] = self.server.rejected[said.reason]
        return told

    async def ask_for_phones(self) -> None:
        """Find out why phones do not get through a broker that is not ours; the log says so when that changes."""
        if self._door is None or self._blocked:
            return
        before, self._no_phone = self._no_phone, await warn_if_phones_are_locked_out(self._door, self._no_phone)
        if before and not self._no_phone:
            log.warning("phones get in again")

    async def run(self, say: Callable[[dict[str, Any]], None]) -> None:
        """Serve until cancelled; `say` is told when the broker goes and comes."""
        await asyncio.gather(self.server.run(), self._ask_again_for_phones(), self._report(say))

    async def _ask_again_for_phones(self) -> None:
        asked_at_s, reconnects = time.monotonic(), self.server.reconnects
        while self._door:
            await asyncio.sleep(REPORT_S)
            is_due = time.monotonic() - asked_at_s >= ASK_FOR_PHONES_S or self.server.reconnects != reconnects
            if self.server.connected and is_due:
                reconnects = self.server.reconnects
                await self.ask_for_phones()
                asked_at_s = time.monotonic()

    async def _report(self, say: Callable[[dict[str, Any]], None]) -> None:
        connected = True
        while True:
            await asyncio.sleep(REPORT_S)
            if self.server.connected != connected:
                connected = self.server.connected
                say({"event": "broker", "connected": connected, "trouble": self.server.trouble})


@contextlib.asynccontextmanager
async def shared_code(options: UpOptions, page_url: str, advertised: str, ws_host: str) -> AsyncIterator[SharedCode]:
    """Start a broker of ours or use another; the server is not connected yet. Raises: UsageError, Unavailable."""
    if options.frontend and options.visitors_login:
        host = urlsplit(options.frontend).hostname
        log.warning("links to %s hold no login: pages of the published kind take it from their form alone", host)
    where = open_broker(
        options.broker,
        login=options.login,
        websocket=options.broker_ws,
        visitors_login=options.visitors_login,
        ws_host=ws_host,
        root=options.link.root,
    )
    async with where as broker:
        server = Server(
            broker.gateway,
            config=options.link,
            broker_for_visitors=on_host(broker.websocket, advertised),
            login_for_visitors=broker.visitors_login,
            mqtt=broker.mqtt,
            heard=broker.heard,
        )
        yield SharedCode(options, broker, server, page_url)
