"""The link's protocol in mode qrkey, without I/O; also exports `Server`, `QrkeyClient` and `Client` of phalanx.net."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phalanx.loading import loaded_when_used

from .client_side import ClientSide
from .messages import Command, Request, SharedAnswer
from .pin import BadPin, Epoch, Pin, derive_epoch, new_pin
from .qrurl import BadQrUrl, QrUrl, parse_qr_url
from .server_side import ServerSide

if TYPE_CHECKING:
    from phalanx.net import Client, QrkeyClient, Server

__all__ = [
    "BadPin",
    "BadQrUrl",
    "Client",
    "ClientSide",
    "Command",
    "Epoch",
    "Pin",
    "QrUrl",
    "QrkeyClient",
    "Request",
    "Server",
    "ServerSide",
    "SharedAnswer",
    "derive_epoch",
    "new_pin",
    "parse_qr_url",
]


# The only import from a higher layer (ADR 0003), and a lazy one: the protocol must not import sockets.
__getattr__ = loaded_when_used(__name__, dict.fromkeys(("Client", "QrkeyClient", "Server"), ".net"))
