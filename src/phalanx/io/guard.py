"""The guard: a process that visitors of a broker of ours come to, and that passes on to it what visitors send.

mosquitto keeps what it is given: sessions that sleep, subscriptions, news for readers that stall, connections that say
nothing. Here each visitor may have a little of everything, and all of them together a fixed amount; whoever takes the
most is hung up on first. The control loop lives in another process, and is held up by nothing of it.

Started by `guarding.py`: `python -m phalanx.io.guard SOCKET TCP WEBSOCKETS`, the path of the broker's socket and the
numbers of two that listen.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
import time
from functools import partial
from typing import cast

from phalanx.errors import PeerError

from .files import allow_files
from .pace import Pace
from .seats import Seats, place_of
from .visitor_packets import PUBLISH, NotForVisitorsError, VisitorPackets
from .websocket import BINARY, NoWebsocketError, Websocket, frame_head

VISITORS = 1000
FILES_EACH, FILES_APART = 2, 64
MANY_FILES = 4096
HELLO_S = 5.0  # from a connection to its CONNECT
# What waits for one visitor and for all: two lists of a thousand robots on their way to a slow phone; many of them.
WAITING_BYTES, WAITING_IN_ALL_BYTES = 3 * 1024 * 1024, 64 * 1024 * 1024
STALLED_S = 20.0
IN_LINE = 8  # between their CONNECT and its answer: of more at once the broker loses some
TURN_PACKETS = 64  # of one visitor, before others have their turn
FULL_BYTES = 64 * 1024  # what waits for the broker
# Packets a second, at once after a silence and at first, of one visitor; and of all who said much lately or have just
# come, and of all others: a phone that drives sends 25. More is dropped, and so is what waited, while more is said than
# is heard: it would be a command that comes late.
PACE, HOUSE_PACE = (400.0, 800.0, 200.0), (2500.0, 2500.0)
LATE_S = 0.3
CHECK_S = 0.25
DROPPED = 2000  # of one visitor between two checks, who is then hung up on
# What is work to us is a read, and so many bytes. While we cannot keep up, those go who made the most between two
# checks, if it was more than four phones make.
BYTES_A_UNIT, LOUD = 64, 200


class House(Seats["Visitor"]):
    """Who is here, and what waits for them."""

    def __init__(self, broker: str, most: int) -> None:
        super().__init__(most)
        self.broker = broker
        self.waiting_bytes = 0
        self.line = asyncio.Semaphore(IN_LINE)
        self._busy_pace, self._rested_pace = Pace(*HOUSE_PACE), Pace(*HOUSE_PACE)
        self._dropped_at_s = -LATE_S
        # Turns of the loop: what we read in one may have come when the one before began.
        self._began_s: float | None = None
        self._before_s: float | None = None

    def hears(self, visitor: Visitor, packet: bytes) -> bool:
        """Whether one more packet of a visitor is passed on.

        Raises: NotForVisitorsError.
        """
        now_s = time.monotonic()
        if not visitor.pace.may(now_s):
            visitor.dropped += 1
            if visitor.dropped > DROPPED:
                raise NotForVisitorsError("more than anybody has to say")
            return False
        if not (self._rested_pace if visitor.pace.is_rested else self._busy_pace).may(now_s):
            self._dropped_at_s = now_s
            return False
        waited_s = self._waited_s(now_s)
        is_flooded = now_s - self._dropped_at_s < LATE_S + waited_s
        return not (is_flooded and packet[0] & 0xF0 == PUBLISH and waited_s > LATE_S)

    def _waited_s(self, now_s: float) -> float:
        """How long what is read now may have waited."""
        return now_s - (self._before_s or self._began_s or now_s)

    def has_work(self) -> None:
        """Somebody said something in this turn of the loop."""
        if self._began_s is None:
            self._began_s = time.monotonic()
            asyncio.get_running_loop().call_soon(self._next_turn)

    def _next_turn(self) -> None:
        self._before_s, self._began_s = self._began_s, None
        asyncio.get_running_loop().call_soon(self._after_next)

    def _after_next(self) -> None:
        if self._began_s is None:  # nobody said anything in between
            self._before_s = None

    def quiet(self) -> None:
        """Hang up on those who make the most work, until half of it is gone."""
        work = sum(visitor.work for visitor in self)
        aim = work / 2
        for visitor in sorted(self, key=lambda each: each.work, reverse=True):
            if work <= aim or visitor.work < LOUD:
                return
            work -= visitor.work
            visitor.leave()

    def make_room(self) -> None:
        """Hang up on those who let the most lie unread, until what waits is a part of what may."""
        waits = sorted(self, key=Visitor.waiting_bytes, reverse=True)
        self.waiting_bytes = sum(map(Visitor.waiting_bytes, waits))
        if self.waiting_bytes > WAITING_IN_ALL_BYTES:
            for visitor in waits:
                if self.waiting_bytes <= WAITING_IN_ALL_BYTES // 2:
                    return
                self.waiting_bytes -= visitor.waiting_bytes()
                visitor.leave()

    async def watch(self) -> None:
        """Hang up on who says nothing at first or reads nothing, until cancelled."""
        while True:
            due_s = time.monotonic() + CHECK_S
            await asyncio.sleep(CHECK_S)
            now_s = time.monotonic()
            for visitor in [v for v in self if v.is_overdue(now_s)]:
                visitor.leave()
            self.make_room()
            if now_s - due_s > LATE_S / 2 or now_s - self._dropped_at_s < CHECK_S:
                self.quiet()
            for visitor in self:
                visitor.work = visitor.dropped = 0


class Visitor(asyncio.Protocol):
    """One connection, and beside it one to the broker."""

    def __init__(self, house: House, *, browser: bool) -> None:
        self.place = ""
        self.pace = Pace(*PACE)
        self.work = self.dropped = 0  # since the last check
        self.heard_at_s = self._came_at_s = time.monotonic()
        self._house = house
        self._websocket = Websocket() if browser else None
        self._packets = VisitorPackets()
        self._broker: asyncio.WriteTransport | None = None
        self._asking: asyncio.Task[None] | None = None
        self._is_held_up = self._has_turn = self._has_left = self._is_over = self._in_line = False
        self._read_all_at_s = self._came_at_s

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """It came."""
        self._transport = cast("asyncio.Transport", transport)
        self._transport.set_write_buffer_limits(high=2 * WAITING_BYTES)
        with contextlib.suppress(OSError):
            transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.place = place_of((transport.get_extra_info("peername") or ("",))[0])
        self._house.take(self)

    def data_received(self, data: bytes) -> None:
        """It said something."""
        self.heard_at_s = time.monotonic()
        self.work += 1 + len(data) // BYTES_A_UNIT
        self._house.has_work()
        if self._packets.connected:
            self._house.heard(self)
        try:
            if self._websocket is not None:
                data = self._websocket.read(data)
                self._transport.write(self._websocket.replies)
                self._websocket.replies = b""
                if self.waiting_bytes() > WAITING_BYTES:
                    raise NoWebsocketError("asks and does not read")
            self._packets.add(data)
        except PeerError as error:
            self._transport.write(error.answer if isinstance(error, NoWebsocketError) else b"")
            self._transport.close()
            return
        if self._websocket is not None and self._websocket.closed:
            self._transport.close()
        elif not self._has_turn:
            self._pass_on()

    def _pass_on(self) -> None:
        """So many packets; the others when all who wait have had their turn."""
        self._has_turn = False
        if self._is_held_up:
            return
        self._house.has_work()
        try:
            for _ in range(TURN_PACKETS):
                packet = self._packets.next()
                if packet is None:
                    self._heard_out()
                    return
                if self._broker is None or self._house.hears(self, packet):
                    self._tell_broker(packet)
                if self._is_held_up:
                    break
        except PeerError:
            self.leave()
            return
        self._transport.pause_reading()
        if not self._is_held_up:
            self._has_turn = True
            asyncio.get_running_loop().call_soon(self._pass_on)

    def _heard_out(self) -> None:
        if not self._has_left:
            self._transport.resume_reading()
        elif self._broker is not None:
            self._broker.close()

    def _tell_broker(self, packet: bytes) -> None:
        if self._is_over:
            return
        if self._broker is not None:
            self._broker.write(packet)
        else:  # the first is its CONNECT
            self._house.heard(self)
            self._is_held_up = True
            self._asking = asyncio.create_task(self._ask(packet))

    async def _ask(self, hello: bytes) -> None:
        loop = asyncio.get_running_loop()
        await self._house.line.acquire()
        self._in_line = True
        try:
            self._broker, _ = await loop.create_unix_connection(lambda: Broker(self), self._house.broker)
        except OSError:  # it starts again, say
            self._is_answered()
            self._transport.close()
            return
        self._broker.set_write_buffer_limits(high=FULL_BYTES)
        self._broker.write(hello)
        self.go_on()

    def _is_answered(self) -> None:
        if self._in_line:
            self._in_line = False
            self._house.line.release()

    def hold_up(self) -> None:
        """The broker does not keep up."""
        self._is_held_up = True
        if not self._has_left:
            self._transport.pause_reading()

    def go_on(self) -> None:
        """It does again."""
        self._is_held_up = False
        self._pass_on()

    def tell(self, data: bytes) -> None:
        """The broker said something. Nothing of it waits in the broker, which could be filled so."""
        self._is_answered()
        before = self.waiting_bytes()
        if self._websocket is not None:
            self._transport.write(frame_head(BINARY, len(data)) + data)
        else:
            self._transport.write(data)
        waiting = self.waiting_bytes()
        self._house.waiting_bytes += waiting - before
        if waiting > WAITING_BYTES:
            self.leave()
        elif self._house.waiting_bytes > WAITING_IN_ALL_BYTES:
            self._house.make_room()

    def waiting_bytes(self) -> int:
        """What it has not read yet."""
        return self._transport.get_write_buffer_size()

    def is_overdue(self, now_s: float) -> bool:
        """Whether it should have said or read something by now."""
        if not self.waiting_bytes():
            self._read_all_at_s = now_s
        is_silent = not self._packets.connected and now_s - self._came_at_s > HELLO_S
        return is_silent or now_s - self._read_all_at_s > STALLED_S

    def say_goodbye(self) -> None:
        """The broker has hung up: so do we, when all is said."""
        self._is_over = True
        self._is_answered()
        self._transport.close()

    def leave(self) -> None:
        """Hang up at once."""
        if not self._has_left:  # asyncio complains of whoever hangs up on one that has gone
            self._transport.abort()
        self._house.gone(self)
        self._packets = VisitorPackets()  # nothing of it is passed on any more
        self._is_answered()
        if self._asking is not None:
            self._asking.cancel()  # or the broker would have a visitor that is not there
        if self._broker is not None and not self._is_over:
            self._broker.abort()

    def connection_lost(self, error: Exception | None) -> None:  # noqa: ARG002
        """It has gone; what it said last is passed on."""
        self._house.gone(self)
        self._has_left = True
        if self._packets.connected and not self._has_turn:
            self._pass_on()


class Broker(asyncio.Protocol):
    """The broker's end of a visitor's connection."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor

    def data_received(self, data: bytes) -> None:
        """For the visitor."""
        self._visitor.tell(data)

    def pause_writing(self) -> None:
        """It does not keep up."""
        self._visitor.hold_up()

    def resume_writing(self) -> None:
        """It does again."""
        self._visitor.go_on()

    def connection_lost(self, error: Exception | None) -> None:  # noqa: ARG002
        """It has hung up."""
        self._visitor.say_goodbye()


async def guard(broker: str, tcp: socket.socket, websockets: socket.socket) -> None:
    """Let visitors in until SIGTERM."""
    house = House(broker, min(VISITORS, (allow_files(MANY_FILES) - FILES_APART) // FILES_EACH))
    loop = asyncio.get_running_loop()
    over = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, over.set)
    for listening, browser in ((tcp, False), (websockets, True)):
        await loop.create_server(partial(Visitor, house, browser=browser), sock=listening, backlog=1024)
    watching = asyncio.create_task(house.watch())
    await over.wait()
    watching.cancel()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends us when the last word is out
    asyncio.run(guard(sys.argv[1], *(socket.socket(fileno=int(number)) for number in sys.argv[2:4])))
