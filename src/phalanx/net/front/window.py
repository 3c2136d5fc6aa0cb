"""Whose message is passed to the gateway next: as many are under way as it processes within a few milliseconds.

A connection has at most one message that waits, so that serving them in their order is taking turns. Newcomers have a
small window of their own, take turns by address, and each waits for the gateway's answer before its next message.
The gateway tells how long each took, and all of newcomers together get a share of its time: those who are in do not
wait for handshakes, however slow the machine is.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

from phalanx.config.front import FrontConfig
from phalanx.pace import Pace

from .turns import Turns

US = 1_000_000  # in a second
NEWCOMERS_AT_ONCE_US = 30_000.0  # of the gateway's time, when it had none lately


class Sender(Protocol):
    """A connection."""

    address: str
    is_admitted: bool
    awaits_answer: bool
    pending: asyncio.Future[None] | None  # done when its message waits no longer


Who = TypeVar("Who", bound=Sender)


class Window(Generic[Who]):
    """Messages that the gateway has not processed yet, and those that wait for that.

    Args:
        pass_on: passes on the message of a connection.
    """

    def __init__(self, limits: FrontConfig, pass_on: Callable[[Who], None], now_s: float) -> None:
        self._limits = limits
        self._pass_on = pass_on
        self._admitted: OrderedDict[Who, None] = OrderedDict()
        self._pace = Pace(limits.newcomers_share * US, NEWCOMERS_AT_ONCE_US, now_s)
        self._newcomers: Turns[Who] = Turns(
            self._go,
            self._settle,
            self._pace,
            waiting_max=limits.connections_max,
            has_room=lambda: self._newcomers_in_flight < self._limits.newcomers_in_flight,
        )
        self._of_newcomers: deque[bool] = deque()  # messages under way, in their order
        self._newcomers_in_flight = 0

    def go(self, sender: Who) -> bool:
        """Pass on a message if nothing keeps it waiting; return whether it was."""
        may = sender.is_admitted and not self._admitted and self._has_room()
        if may:
            self._go(sender)
        return may

    async def turn(self, sender: Who) -> None:
        """Pass on a message in its turn, unless the connection is dropped meanwhile."""
        pending: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        sender.pending = pending
        self._wait(sender)
        await pending

    def taken(self, took_us: Sequence[int]) -> None:
        """Note that the gateway has processed messages, and how long it took for each."""
        for each_us in took_us:
            if self._of_newcomers.popleft():
                self._newcomers_in_flight -= 1
                self._pace.use(each_us)
        self._run()

    def answered(self, sender: Who) -> None:
        """Note that the gateway has answered a connection, or has admitted it."""
        sender.awaits_answer = False
        if sender.pending:
            self._newcomers.remove(sender.address, sender)
            self._wait(sender)

    def drop(self, sender: Who) -> None:
        """Let a connection wait no longer."""
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
