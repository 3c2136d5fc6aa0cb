"""What happens on the link, as `--events` prints it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phalanx.io.server import Happening
from phalanx.link import Command, Epoch, Request
from phalanx.link.messages import Rejected


def tell_event(said: Happening, qr_url: Callable[[], str]) -> dict[str, Any] | None:
    """The event in JSON's types; None for what is no event. A rotation has the pin in it."""
    if isinstance(said, Epoch):
        return {"event": "rotation", "pin": said.pin.digits, "topic": said.topic, "qr_url": qr_url()}
    if isinstance(said, Command):
        return {"event": "command", "address": said.address, "name": said.name, "payload": said.payload}
    if isinstance(said, Request):
        return {"event": "request", "request": said.number, "client": said.client_id}
    if isinstance(said, Rejected):
        return {"event": "rejected", "reason": said.reason}
    return None
