"""amqtt in a process of its own, an extra: the broker for machines without mosquitto. Slower, and MQTT 3.1.1 only.

Visitors come by way of the guard, as to mosquitto. Started as `python -m phalanx.io.amqtt_broker PARENT FOLDER`: whose
child it is, and where it reads how to listen.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
import os
import sys
from collections.abc import AsyncIterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from amqtt.adapters import StreamReaderAdapter, StreamWriterAdapter
from amqtt.broker import Broker
from amqtt.contexts import Action, BrokerConfig, ListenerConfig, ListenerType
from amqtt.errors import BrokerError

from phalanx.link.qrurl import Login

from .children import a_python_child, end_with, kept
from .guarding import guarded
from .heard import Heard
from .listeners import Listeners
from .mosquitto import serves, until_it_serves
from .ports import LOOPBACK
from .private_file import private_folder
from .seats import a_share

VISITORS, GUARD = "visitors", "the guard"  # the listener for whom the guard lets in, and the address that all have
PROGRAMS = 200  # connections at the gateway's own door
HOW = "listeners.json"  # the gateway's login is in it


class _CappedBroker(Broker):  # type: ignore[misc]  # amqtt is not typed
    """amqtt that keeps nothing for who is away, and lets visitors do little.

    As it comes it sends retained messages to clients that never subscribed.
    """

    def __init__(self, config: BrokerConfig, at: Listeners) -> None:
        super().__init__(config)
        self._at = at

    async def _authenticate(self, session: Any, _: Any) -> bool:
        login = self._at.login
        if session.remote_address == GUARD:
            return bool(session.username != login.username)
        said = session.username or "", session.password or ""
        return all(map(_is, said, (login.username, login.password)))

    async def add_subscription(self, subscription: tuple[str, int], session: Any) -> int:
        """At QoS 0: nothing waits for who does not answer."""
        code: int = await super().add_subscription((subscription[0], 0), session)
        return code

    async def _topic_filtering(self, session: Any, topic: str, action: Action) -> bool:
        if session.username == self._at.login.username or action is Action.SUBSCRIBE:
            return True
        return self._at.may_write(topic) if action is Action.PUBLISH else self._at.may_read(topic)

    async def retain_message(self, *_: Any, **__: Any) -> None:
        """Retain nothing."""


def _is(said: str, known: str) -> bool:
    return hmac.compare_digest(said.encode(), known.encode())


class _Unnamed(StreamWriterAdapter):  # type: ignore[misc]  # amqtt is not typed
    """Of a connection by a socket's path, whose other end has no address."""

    def get_peer_info(self) -> tuple[str, int]:
        """Something, or amqtt hangs up."""
        return GUARD, 0


@contextlib.asynccontextmanager
async def amqtt(at: Listeners) -> AsyncIterator[Heard]:
    """A running amqtt, for as long as the context lasts; yields what the gateway shall tell the guard before it.

    Raises: Unavailable: it does not start (a port taken, say).
    """
    with private_folder() as folder:
        (folder / HOW).touch(mode=0o600)
        (folder / HOW).write_text(json.dumps(asdict(at)))
        child = partial(a_python_child, "phalanx.io.amqtt_broker", str(folder))
        async with (
            guarded(
                at, folder / VISITORS, folder
            ) as heard,  # first: where a port is taken, amqtt is started for nothing
            kept("amqtt", child, partial(serves, at.gateway), partial(until_it_serves, "amqtt", at.gateway)),
        ):
            yield heard


async def serve(at: Listeners, folder: Path) -> None:
    """Be the broker, until cancelled.

    Raises: BrokerError, OSError: it cannot listen there.
    """
    door = {"bind": f"{LOOPBACK}:{at.gateway_port}", "max_connections": a_share(PROGRAMS, 2)}
    listeners = {
        "default": ListenerConfig(type=ListenerType.TCP, **door),  # a name that amqtt insists on
        VISITORS: ListenerConfig(type=ListenerType.EXTERNAL),
    }
    plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
    broker = _CappedBroker(BrokerConfig(listeners=listeners, plugins=plugins), at)

    async def come(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):  # gone before its answer: asyncio would print a trace
            await broker.external_connected(StreamReaderAdapter(reader), _Unnamed(writer), VISITORS)

    await broker.start()
    async with await asyncio.start_unix_server(come, folder / VISITORS):
        await asyncio.Event().wait()


def _main() -> None:
    parent, folder = sys.argv[1:]
    end_with(int(parent))
    # It reports every packet as information, and every client that leaves as a warning with a trace.
    for name in ("amqtt", "transitions"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    words = json.loads((Path(folder) / HOW).read_text())
    try:
        asyncio.run(serve(Listeners(**words | {"login": Login(**words["login"])}), Path(folder)))
    except (BrokerError, OSError) as error:
        cause = error.__cause__ or error
        sys.exit(os.strerror(cause.errno) if isinstance(cause, OSError) and cause.errno else str(error))


if __name__ == "__main__":
    _main()
