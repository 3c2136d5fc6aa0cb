"""The broker at which visitors are served, as the operator sees it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Protocol

from phalanx.net.broker import RunningBroker
from phalanx.net.broker_url import no_way_from

log = logging.getLogger(__name__)

REPORT_S = 1.0


class Connected(Protocol):
    """A program's connection to a broker."""

    @property
    def connected(self) -> bool:
        """Return whether the broker is there now."""

    @property
    def trouble(self) -> str:
        """Return what the last connection attempt died of; "" while connected."""


class AtBroker:
    """A broker that is used, and how it is.

    Args:
        link: whose connection tells.
        page: that visitors open.
        for_visitors: the broker's URL for them.
    """

    def __init__(self, broker: RunningBroker, link: Connected, page: str, for_visitors: str) -> None:
        self._broker, self._link = broker, link
        self._no_phone = no_way_from(page, for_visitors)
        if self._no_phone:
            log.warning("%s; hint: a wss:// one, with --broker URL --broker-ws", self._no_phone)

    @property
    def connected(self) -> bool:
        """Return whether it is there now."""
        return self._link.connected

    def state(self) -> dict[str, Any]:
        """Return what the operator's page shows of it."""
        return {
            "name": self._broker.name,
            "url": str(self._broker.url),
            "connected": self.connected,
            "trouble": self._link.trouble,
            "phones": self._no_phone,
        }

    async def report(self, say: Callable[[dict[str, Any]], None]) -> None:
        """Tell when it goes and comes, until cancelled."""
        connected = True
        while True:
            await asyncio.sleep(REPORT_S)
            if self.connected != connected:
                connected = self.connected
                say({"event": "broker", "connected": connected, "trouble": self._link.trouble})
