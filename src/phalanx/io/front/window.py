"""Whose message is passed to the gateway next: as many are under way as it processes within a few milliseconds.

Each connection has at most one message that waits, so taking turns is serving them in their order. Newcomers wait by
address, and have a small part of the window: however many come from one address, others wait for one of them at most.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from typing import Protocol

from phalanx.config.front import FrontConfig

from .pace import Pace


class Waiting(Protocol):
    """A connection."""

    address: str
    is_admitted: bool
    awaits_answer: bool
    is_closing: bool


class Window:
    """Messages that the gateway has not processed yet, and those that wait for that."""

    def __init__(self, limits: FrontConfig, now_s: float) -> None:
        self._limits = limits
        self._pace = Pace(limits.newcomer_messages_per_s, limits.newcomers_in_flight, now_s)
        self._in_flight = 0
        self._waiting: OrderedDict[Waiting, asyncio.Future[bool]] = OrderedDict()

    async def turn(self, link: Waiting) -> bool:
        """Wait until a message may be passed on; False: its connection is closing."""
        while not link.is_closing and (self._in_flight >= self._limits.in_flight or link.awaits_answer):
            self._waiting[link] = asyncio.get_running_loop().create_future()
            await self._waiting[link]
        return not link.is_closing

    def passed(self, link: Waiting) -> None:
        """Count a message."""
        self._in_flight += 1
        link.awaits_answer = not link.is_admitted

    def taken(self, count: int) -> None:
        """Count messages that the gateway has processed."""
        self._in_flight -= count
        for _ in range(min(count, len(self._waiting))):
            _, turn = self._waiting.popitem(last=False)
            turn.set_result(True)

    def answered(self, link: Waiting) -> None:
        """Let a newcomer go on."""
        link.awaits_answer = False
        if turn := self._waiting.pop(link, None):
            turn.set_result(True)

    def drop(self, link: Waiting) -> None:
        """Forget a connection."""
        if turn := self._waiting.pop(link, None):
            turn.cancel()
