"""The visitor of `phalanx link connect`: over a session, or in mode qrkey."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from phalanx.errors import PeerError, Unavailable
from phalanx.link import QrUrl
from phalanx.net import Client, Login, QrkeyClient
from phalanx.net.broker_url import BrokerUrl
from phalanx.net.session_payloads import wheels

DRIVE_EVERY_S = 0.1


@dataclass(frozen=True, slots=True)
class Visitor:
    """A client with the requests that the command needs. Use as `async with`.

    Attributes:
        robots: returns the swarm's list of robots, unchecked.
        drive: drives a robot, given address, application, wheels in percent and seconds, then stops it; returns the
            number of commands sent.
        notifications: yields the messages that the swarm sends to all visitors.
    """

    client: AbstractAsyncContextManager[object]
    robots: Callable[[], Awaitable[Any]]
    drive: Callable[[str, str, tuple[int, int], float], Awaitable[int]]
    notifications: Callable[[], AsyncIterator[Any]]

    async def __aenter__(self) -> None:
        await self.client.__aenter__()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.client.__aexit__(kind, error, trace)


def qrkey_visitor(qr: QrUrl, broker: BrokerUrl | None, login: Login | None, timeout_s: float) -> Visitor:
    """Return a visitor in mode qrkey."""
    client = QrkeyClient(qr, broker=broker, login=login, timeout_s=timeout_s)

    async def robots() -> Any:
        return await client.request(0, timeout_s=timeout_s)

    async def drive(address: str, application: str, wheels_pct: tuple[int, int], for_s: float) -> int:
        sent = 0
        try:
            for _ in range(max(1, round(for_s / DRIVE_EVERY_S))):
                sent += await client.command(address, "move_raw", wheels(*wheels_pct), application)
                await asyncio.sleep(DRIVE_EVERY_S)
        finally:
            await client.command(address, "move_raw", wheels(0, 0), application)
        return sent

    return Visitor(client, robots, drive, client.notifications)


def session_visitor(url: str, name: str, keep: Path | None, timeout_s: float) -> Visitor:
    """Return a visitor with a session. Raises: BadInvitation; UsageError: the file is not a session's."""
    client = Client(url, name=name, secret_file=keep, timeout_s=timeout_s)

    async def robots() -> Any:
        return await client.request("robots")

    async def drive(address: str, _application: str, wheels_pct: tuple[int, int], for_s: float) -> int:
        before = client.commands
        await client.drive(address, *wheels_pct, for_s=max(DRIVE_EVERY_S, for_s))
        return client.commands - before

    return Visitor(client, robots, drive, client.updates)


@contextlib.contextmanager
def refusals_for_people() -> Iterator[None]:
    """Turn refusals by the swarm into one-line errors. Raises: Unavailable."""
    try:
        yield
    except PeerError as error:
        raise Unavailable(str(error), "if the code or ticket has expired, ask for a new one") from error
