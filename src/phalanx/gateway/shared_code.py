"""Mode qrkey beside sessions: a broker, and one code that all its visitors share. For published pages and programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phalanx.link import Command, Epoch
from phalanx.link.messages import Rejected
from phalanx.net import Server, parse_broker_url
from phalanx.net.broker import RunningBroker
from phalanx.net.server import Happening

if TYPE_CHECKING:
    from .up import UpOptions


class SharedCode:
    """A server of mode qrkey and its broker.

    Attributes:
        server: the `Link`.
        broker: that it is connected to.

    Args:
        for_visitors: the broker's URL for browsers.
    """

    def __init__(self, options: UpOptions, broker: RunningBroker, for_visitors: str, page_url: str) -> None:
        self.broker = broker
        self.server = Server(broker.url, config=options.link, broker_for_visitors=for_visitors)
        self._options, self._page_url = options, page_url

    @property
    def qr_url(self) -> str:
        """Return the link of its code: of the published page, or for programs."""
        qr = self.server.qr()
        return qr.for_foreign_page(self._options.frontend) if self._options.frontend else qr.for_page(self._page_url)

    def ready(self) -> dict[str, Any]:
        """Return what the first event says of it. Has the pin in it."""
        return {
            "qrkey_url": self.qr_url,
            "pin": self.server.epoch.pin.digits,
            "topic": self.server.epoch.topic,
            "broker_host": self.broker.url.host,
            "broker_port": self.broker.url.port,
            "broker_ws_port": parse_broker_url(self.broker.websocket).port,
        }

    def count(self, what: str) -> int:
        """Return how often that came."""
        return self.server.counters[what]

    def event(self, said: Happening) -> dict[str, Any] | None:
        """Return what happened, in JSON's types; None for what is nobody's business: pages ask all the time.

        A rotation has the pin in it.
        """
        if isinstance(said, Epoch):
            return {"event": "rotation", "pin": said.pin.digits, "topic": said.topic, "qrkey_url": self.qr_url}
        if isinstance(said, Command):
            return {"event": "command", "address": said.address, "name": said.name, "payload": said.payload}
        if isinstance(said, Rejected):
            return {"event": "rejected", "reason": said.reason, "count": self.server.rejected[said.reason]}
        return None
