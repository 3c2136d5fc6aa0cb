"""Flow control towards the gateway: only as many messages are in flight as it processes in a few milliseconds.

Each connection has at most one waiting message, so serving them in order is round-robin. Newcomers have a small window
of their own, are served round-robin by address, and wait for the gateway's answer before their next message. The
gateway reports the time for each message, and newcomers together get a fixed share of its time. So admitted clients do
not wait for handshakes, however slow the machine is.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

from phalanx.config.front import FrontConfig
from phalanx.pace import TokenBucket

from .turns import Turns

US = 1_000_000  # microseconds per second
NEWCOMERS_AT_ONCE_US = 30_000.0  # burst of the gateway's time for newcomers


class Sender(Protocol):
    """Connection that sends messages to the gateway."""

    address: str
    is_admitted: bool
    awaits_answer: bool
    pending: asyncio.Future[None] | None  # done when its message was forwarded or dropped


Who = TypeVar("Who", bound=Sender)


class Window(Generic[Who]):
    """Messages in flight to the gateway, and the queue of those that wait.

    Args:
        pass_on: forwards the message of a connection.
    """

    def __init__(self, limits: FrontConfig, pass_on: Callable[[Who], None], now_s: float) -> None:
        self._limits = limits
        self._pass_on = pass_on
        self._admitted: OrderedDict[Who, None] = OrderedDict()
        self._pace = TokenBucket(limits.newcomers_share * US, NEWCOMERS_AT_ONCE_US, now_s)
        self._newcomers: Turns[Who] = Turns(
            self._go,
            self._settle,
            self._pace,
            waiting_max=limits.connections_max,
            has_room=lambda: self._newcomers_in_flight < self._limits.newcomers_in_flight,
        )
        self._of_newcomers: deque[bool] = deque()  # for each message in flight, in order: a newcomer sent it
        self._newcomers_in_flight = 0

    def go(self, sender: Who) -> bool:
        """Forward a message if it need not wait; return whether it was forwarded."""
        may = sender.is_admitted and not self._admitted and self._has_room()
        if may:
            self._go(sender)
        return may

    async def turn(self, sender: Who) -> None:
        """Wait until a message was forwarded in its turn, or its connection dropped."""
        pending: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        sender.pending = pending
        self._wait(sender)
        await pending

    def taken(self, took_us: Sequence[int]) -> None:
        """Record that the gateway has processed messages, with the time for each."""
        for each_us in took_us:
            if self._of_newcomers.popleft():
                self._newcomers_in_flight -= 1
                self._pace.use(each_us)
        self._run()

    def answered(self, sender: Who) -> None:
        """Record that the gateway has answered or admitted a connection."""
        sender.awaits_answer = False
        if sender.pending:
            self._newcomers.remove(sender.address, sender)
            self._wait(sender)

    def drop(self, sender: Who) -> None:
        """Remove the waiting message of a connection."""
        if sender.pending:
            self._admitted.pop(sender, None)
            self._newcomers.remove(sender.address, sender)
            self._settle(sender)

    def _wait(self, sender: Who) -> None:
        if sender.is_admitted:
            self._admitted[sender] = None
            self._run()
        elif not sender.awaits_answer:
            self._newcomers.add(sender.address, sender)

    def _run(self) -> None:
        while self._admitted and self._has_room():
            sender, _ = self._admitted.popitem(last=False)
            self._go(sender)
        self._newcomers.run()

    def _has_room(self) -> bool:
        admitted = len(self._of_newcomers) - self._newcomers_in_flight
        return admitted < self._limits.in_flight - self._limits.newcomers_in_flight

    def _go(self, sender: Who) -> None:
        self._of_newcomers.append(not sender.is_admitted)
        self._newcomers_in_flight += not sender.is_admitted
        sender.awaits_answer = not sender.is_admitted
        self._pass_on(sender)
        self._settle(sender)

    def _settle(self, sender: Who) -> None:
        pending, sender.pending = sender.pending, None
        if pending and not pending.done():
            pending.set_result(None)
