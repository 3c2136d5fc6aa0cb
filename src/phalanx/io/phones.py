"""Whether phones get in and through at a broker that is not ours: asked through their own door, as a phone asks.

An access control that drops what a phone says or is told does so without a word, and a SUBACK grants what never comes:
only what arrives tells.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
from collections import Counter
from collections.abc import Awaitable
from typing import Any
from urllib.parse import urlsplit

from phalanx.errors import Unavailable
from phalanx.link.messages import Command, Request
from phalanx.link.topics import CommandTopic

from .broker_url import parse_broker_url
from .client import Client
from .connection import LoginRefused
from .ports import LOOPBACK
from .server import Server

log = logging.getLogger(__name__)

CONNECT_S = ARRIVE_S = 2.0
# Words of no vocabulary: no page asks that, and no robot is called so.
NUMBER, COMMAND = -1, CommandTopic("phones", "0", "door")
ACL_HINT = (
    "see its access control: below {root}/+/ phones write request and command/# and read notify and reply/+,"
    " the gateway the other way round"
)


class PhonesDoor:
    """Asks a server a question of its own through the door to which its link sends phones."""

    def __init__(self, server: Server) -> None:
        self.counters: Counter[str] = Counter()  # what in the server's own is of this
        self._server = server
        self._knocker = ""
        self._obeyed = asyncio.Event()
        self._came: set[str] = set()
        server.on_request(NUMBER)(self._asked)
        server.on_command(COMMAND.name)(self._told)

    async def trouble(self) -> tuple[str, str]:
        """Return why phones do not get in, or what is lost on the way, and a hint; two empty texts if all is well."""
        qr = self._server.qr()
        at = parse_broker_url(qr.broker, qr.login)
        unread = self._server.rejected["overrun"]
        try:
            async with asyncio.timeout(CONNECT_S):
                _, writer = await asyncio.open_connection(at.host, at.port)
                writer.close()
        except (socket.gaierror, UnicodeError):
            return f"there is no {at.host} for this machine, where phones will look for the broker", "--broker-ws"
        except (OSError, TimeoutError) as error:
            if getattr(error, "errno", 0) in (errno.EMFILE, errno.ENFILE):
                return f"whether phones get in is not known: {os.strerror(error.errno or 0).lower()}", "ulimit -n"
            return f"nothing listens at {at}, where phones will look for the broker", "--broker-ws"
        try:
            async with Client(qr, broker=at, config=self._server.config, timeout_s=CONNECT_S) as client:
                lost = await self._lost(client) if self._server.connected else ""
        except LoginRefused as error:
            if qr.login:
                return f"phones are locked out: {error} of visitors", "name or password in --visitors-login is wrong"
            return f"phones are locked out: {error}", "--visitors-login, or a way in without one, to our topics only"
        except Unavailable as error:
            hint = "--broker-ws" if isinstance(error.__cause__, TimeoutError) else error.hint
            return f"phones are locked out: {error}", hint
        if lost and self._server.rejected["overrun"] > unread:  # ours was among it, perhaps: no access control's fault
            return (
                f"whether phones get through is not known: {at} passes on more than can be read",
                "stop who floods it",
            )
        return (f"phones get into {at}, but {lost}", ACL_HINT.format(root=qr.root)) if lost else ("", "")

    async def _lost(self, client: Client) -> str:
        """What does not arrive; one after the other, for some brokers hang up on whoever says what they may not."""
        self._knocker = client.client_id
        self._came = set()
        self._obeyed.clear()
        await self._server.notify({"door": self._knocker})
        if await _comes(anext(client.notifications())):
            self._came.add("notify")
        if await _comes(client.request(NUMBER, timeout_s=ARRIVE_S)) or "request" not in self._came:
            self._came.add("reply/+")  # an answer to what was not heard is not missed
        await client.command(COMMAND.address, COMMAND.name, self._knocker, COMMAND.application, at_once=True)
        await _comes(self._obeyed.wait())
        if not self._server.connected:
            return ""
        halves = (
            self._nothing("of theirs on {} reaches the gateway", "request", "command/#"),
            self._nothing("on {} reaches them", "notify", "reply/+"),
        )
        return ", and ".join(filter(None, halves))

    def is_knocking(self, said: object) -> bool:
        """Whether we said this ourselves, through the phones' door."""
        if isinstance(said, Request):
            return said.number == NUMBER and said.client_id == self._knocker
        return isinstance(said, Command) and said.topic == COMMAND and said.payload == self._knocker

    def _nothing(self, what: str, *subs: str) -> str:
        lost = [f"{self._server.config.root}/+/{sub}" for sub in subs if sub not in self._came]
        return f"nothing {what.format(' or '.join(lost))}" if lost else ""

    def _asked(self, request: Request) -> None:
        if self.is_knocking(request):
            self.counters["requests"] += 1
            self._came.add("request")

    def _told(self, command: Command) -> None:
        if self.is_knocking(command):
            self.counters["commands"] += 1
            self._came.add("command/#")
            self._obeyed.set()


def no_way_from(page: str, websocket: str) -> str:
    """Why browsers do not let this page reach the broker, or "". Source: W3C, Mixed Content."""
    is_here = urlsplit(websocket).hostname in ("localhost", LOOPBACK, "::1")  # which they trust
    if is_here or not (page.startswith("https://") and websocket.startswith("ws://")):
        return ""
    return f"browsers let no page by https, such as {page.partition('?')[0]}, reach {websocket}"


async def _comes(what: Awaitable[Any]) -> bool:
    try:
        async with asyncio.timeout(ARRIVE_S):
            await what
    except (TimeoutError, Unavailable):
        return False
    return True


async def warn_if_phones_are_locked_out(door: PhonesDoor, known: str = "") -> str:
    """Why phones do not get in or through, or "": the log says it too, unless it is `known`."""
    trouble, hint = await door.trouble()
    if trouble not in ("", known):
        log.warning("%s; hint: %s", trouble, hint)
    return trouble
