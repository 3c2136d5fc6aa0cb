"""The broker that serves visitors, and its state on the operator's page."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Protocol

from phalanx.net.broker import RunningBroker
from phalanx.net.broker_url import mixed_content_error

log = logging.getLogger(__name__)

REPORT_S = 1.0


class Connected(Protocol):
    """A connection to a broker."""

    @property
    def connected(self) -> bool:
        """Return whether the broker is connected now."""

    @property
    def trouble(self) -> str:
        """Return why the last connection attempt failed; "" while connected."""


class BrokerStatus:
    """A broker in use, with the state of its connection.

    Args:
        link: the connection to the broker.
        page: the page that visitors open.
        for_visitors: the broker's URL for visitors.
    """

    def __init__(self, broker: RunningBroker, link: Connected, page: str, for_visitors: str) -> None:
        self._broker, self._link = broker, link
        self._no_phone = mixed_content_error(page, for_visitors)
        if self._no_phone:
            log.warning("%s; hint: use a wss:// address, with --broker URL --broker-ws", self._no_phone)

    @property
    def connected(self) -> bool:
        """Return whether the broker is connected now."""
        return self._link.connected

    def state(self) -> dict[str, Any]:
        """Return the broker's state for the operator's page."""
        return {
            "name": self._broker.name,
            "url": str(self._broker.url),
            "connected": self.connected,
            "trouble": self._link.trouble,
            "phones": self._no_phone,
        }

    async def report(self, say: Callable[[dict[str, Any]], None]) -> None:
        """Emit an event when the connection is lost or restored, until cancelled."""
        connected = True
        while True:
            await asyncio.sleep(REPORT_S)
            if self.connected != connected:
                connected = self.connected
                say({"event": "broker", "connected": connected, "trouble": self._link.trouble})
