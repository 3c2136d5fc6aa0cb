"""Who may command: the pure protocol. `Server` and `Client`, which live in `phalanx.io`, are reached here as well."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .client_side import ClientSide
from .keys import Epoch, derive_epoch
from .messages import Command, Request, SharedAnswer
from .pin import BadPin, Pin, new_pin
from .qrurl import BadQrUrl, QrUrl, parse_qr_url
from .server_side import ServerSide

if TYPE_CHECKING:
    from phalanx.io import Client, Server

__all__ = [
    "BadPin",
    "BadQrUrl",
    "Client",
    "ClientSide",
    "Command",
    "Epoch",
    "Pin",
    "QrUrl",
    "Request",
    "Server",
    "ServerSide",
    "SharedAnswer",
    "derive_epoch",
    "new_pin",
    "parse_qr_url",
]


def __getattr__(name: str) -> Any:
    # The one door upwards (ADR 0003): people look for `link.Server`, and the protocol must not import sockets.
    if name in ("Client", "Server"):
        return getattr(import_module("phalanx.io"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
