"""Mode qrkey beside sessions: a broker, and one code that all its visitors share. For published pages and programs."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Any

from phalanx.io import Server, parse_broker_url
from phalanx.io.broker import RunningBroker, open_broker
from phalanx.io.broker_url import no_way_from, on_host
from phalanx.io.server import Happening
from phalanx.link import Command, Epoch
from phalanx.link.messages import Rejected

if TYPE_CHECKING:
    from .up import UpOptions

log = logging.getLogger(__name__)

REPORT_S = 1.0


class SharedCode:
    """A server of mode qrkey and its broker.

    Attributes:
        server: the `Link`.
        broker: that it is connected to.
    """

    def __init__(self, options: UpOptions, broker: RunningBroker, server: Server, page_url: str) -> None:
        self.broker, self.server = broker, server
        self._options, self._page_url = options, page_url
        self._no_phone = no_way_from(options.frontend or page_url, server.broker_for_visitors)
        if self._no_phone:
            log.warning("%s; hint: a wss:// one, with --broker URL --broker-ws", self._no_phone)

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
        """Return how often that came."""
        return self.server.counters[what]

    def event(self, said: Happening) -> dict[str, Any] | None:
        """Return what happened, in JSON's types; None for what is nobody's business: pages ask all the time.

        A rotation has the pin in it.
        """
        if isinstance(said, Epoch):
            return {"event": "rotation", "pin": said.pin.digits, "topic": said.topic, "qr_url": self.qr_url}
        if isinstance(said, Command):
            return {"event": "command", "address": said.address, "name": said.name, "payload": said.payload}
        if isinstance(said, Rejected):
            return {"event": "rejected", "reason": said.reason, "count": self.server.rejected[said.reason]}
        return None

    async def run(self, say: Callable[[dict[str, Any]], None]) -> None:
        """Serve until cancelled; `say` is told when the broker goes and comes."""
        await asyncio.gather(self.server.run(), self._report(say))

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
    where = open_broker(options.broker, login=options.login, websocket=options.broker_ws, ws_host=ws_host)
    async with where as broker:
        for_visitors = on_host(broker.websocket, advertised)
        server = Server(broker.url, config=options.link, broker_for_visitors=for_visitors)
        yield SharedCode(options, broker, server, page_url)
