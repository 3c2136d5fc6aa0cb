"""Mode qrkey beside sessions, for published pages and programs: a broker, and one code shared by all visitors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phalanx.link import Command, Epoch
from phalanx.link.messages import Rejected
from phalanx.net import Server, parse_broker_url
from phalanx.net.broker import RunningBroker
from phalanx.net.server import LinkEvent

if TYPE_CHECKING:
    from .up import UpOptions


class SharedCode:
    """A server of mode qrkey and its broker.

    Attributes:
        server: the `Link`.
        broker: the broker that it uses.

    Args:
        for_visitors: the broker's URL for browsers.
    """

    def __init__(self, options: UpOptions, broker: RunningBroker, for_visitors: str, page_url: str) -> None:
        self.broker = broker
        self.server = Server(broker.url, config=options.link, broker_for_visitors=for_visitors)
        self._options, self._page_url = options, page_url

    @property
    def qr_url(self) -> str:
        """Return the link of its code: for the published page, or for programs."""
        qr = self.server.qr()
        return qr.for_foreign_page(self._options.frontend) if self._options.frontend else qr.for_page(self._page_url)

    def ready(self) -> dict[str, Any]:
        """Return its fields of the event "ready", including the pin."""
        return {
            "qrkey_url": self.qr_url,
            "pin": self.server.epoch.pin.digits,
            "topic": self.server.epoch.topic,
            "broker_host": self.broker.url.host,
            "broker_port": self.broker.url.port,
            "broker_ws_port": parse_broker_url(self.broker.websocket).port,
        }

    def count(self, what: str) -> int:
        """Return the value of a counter."""
        return self.server.counters[what]

    def event(self, event: LinkEvent) -> dict[str, Any] | None:
        """Return an event as JSON-ready types, or None for events not reported, such as requests.

        A rotation includes the pin.
        """
        if isinstance(event, Epoch):
            return {"event": "rotation", "pin": event.pin.digits, "topic": event.topic, "qrkey_url": self.qr_url}
        if isinstance(event, Command):
            return {"event": "command", "address": event.address, "name": event.name, "payload": event.payload}
        if isinstance(event, Rejected):
            return {"event": "rejected", "reason": event.reason, "count": self.server.rejected[event.reason]}
        return None
