"""A visitor of a broker of ours: one connection to the guard, and beside it one to the broker."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import select
import socket
import termios
import time
from typing import cast

from phalanx.errors import PeerError

from .broker_end import Broker, connected
from .heads import NEW_WORDS, Proof, Standing
from .house import House
from .pace import Pace
from .questions import Held
from .turns import TURN
from .visitor_packets import PINGREQ, PUBLISH, SUBSCRIBE, UNSUBSCRIBE, VisitorPackets, is_question
from .websocket import BINARY, NoWebsocketError, Websocket, frame_head

HELLO_S = 5.0  # from a connection to its CONNECT
# What waits for it: two lists of a thousand robots on their way to a slow phone.
WAITING_BYTES = 3 * 1024 * 1024
STALLED_S = 20.0
MORE_BYTES = 4096  # whoever said more is heard before more of it is read
# What one may say a second, and at once: packets, their `WORD_BYTES`, and websocket's frames, of which published phones
# send six for each packet. More waits; and what waited here is dropped, if it may be a command that comes late.
PACE = (400.0, 400.0)
LATE_S = 0.3
# And what little is, without the frames: a phone that drives sends 25.
LITTLE = (50.0, 60.0, 10.0)
WORD_BYTES = 512  # a long message takes a gateway as long as so many short ones: 48 KiB of JSON up to 6.4 ms
FEW = 100  # of what it may say at once
MUCH = 8  # words that each packet is of a turn, which is passed on of who said much
ASKING = 4  # words that a SUBSCRIBE is, or an UNSUBSCRIBE: the broker has more to do for it, and a phone says few
PINGS_APART_S = 0.5  # more PINGREQs are dropped: nobody's keepalive is below 1 s
LET_IN_S = 0.0002  # processor time, after its turn
FULL_BYTES = 64 * 1024  # what waits for the broker


class Visitor(asyncio.BufferedProtocol):
    """It comes as a connection that was accepted, and nothing else yet; whatever it wants of us is done in turns."""

    def __init__(self, house: House, connection: socket.socket, place: str, *, browser: bool) -> None:
        self.place, self.standing = place, Standing.NEW
        self.pace, self._little = Pace(*PACE), Pace(*LITTLE)
        self.answers: frozenset[bytes] = frozenset()  # that it reads
        self.loud_checks = 0  # so often in a row it said too much
        self.waits_since_s: float | None = None  # since when not all that it said is heard
        self.heard_at_s = self._came_at_s = self._read_all_at_s = time.monotonic()
        self._pinged_at_s = 0.0
        self._paused_at_s: float | None = None
        self._next: tuple[bytes, int] | None = None  # a packet that is much to say, and its words
        self._house, self._connection = house, connection
        self._transport: asyncio.Transport
        self._websocket = Websocket() if browser else None
        self._packets = VisitorPackets(os.urandom(8).hex().encode())
        self._proof, self._new_words = Proof(), NEW_WORDS
        self.held = Held()
        self._said = self._hello = b""
        self._broker: asyncio.WriteTransport | None = None
        self._task: asyncio.Task[None] | None = None
        self._is_here = self._in_line = self._is_over = self._has_left = False
        self._waits = self._has_packets = self._is_held_up = False
        house.take(self)
        if not self._has_left:
            house.wants(self)

    def turn(self, now_s: float) -> float:
        """It is let in, or a part of what it said is heard; how much there is to do for it later."""
        if self._waits:
            self._listen(now_s)
        elif self._task is None and _has_gone(self._connection):
            self.leave()
        elif self._task is None:
            self._task = asyncio.create_task(self._let_in())
            return LET_IN_S
        return 0.0

    async def _let_in(self) -> None:
        await asyncio.get_running_loop().connect_accepted_socket(lambda: self, self._connection)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """It is in."""
        self._transport = cast("asyncio.Transport", transport)
        self._is_here = True
        if self._has_left:
            self._transport.abort()
            return
        self._came_at_s = time.monotonic()
        self._little.wait_s(self._came_at_s)  # it is silent from now on
        self._transport.set_write_buffer_limits(high=2 * WAITING_BYTES)
        with contextlib.suppress(OSError):
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002
        """One for all: only one is read at a time."""
        return self._house.buffer

    def buffer_updated(self, nbytes: int) -> None:
        """It said something."""
        self.hear(bytes(self._house.buffer[:nbytes]))

    def hear(self, data: bytes) -> None:
        """It said something, and waits for a turn."""
        self.heard_at_s = time.monotonic()
        self._said += data
        self._house.waits(len(data))
        if len(self._said) > MORE_BYTES and self._paused_at_s is None:
            self._paused_at_s = self.heard_at_s
            self._transport.pause_reading()
        if self._waits:
            return
        self._waits = True
        self.waits_since_s = self.waits_since_s or self.heard_at_s
        if not self._is_held_up:
            self._house.wants(self)

    def _listen(self, now_s: float) -> None:
        try:
            is_all = self._hear(now_s)
        except NoWebsocketError as error:
            self._transport.write(error.answer)
            self._waits = False
            self._transport.close()
        except PeerError:
            self.leave()
        else:
            if is_all:
                self._heard_out()
            elif not self._is_held_up:
                self._wait(self.pace.wait_s(now_s))

    def _hear(self, now_s: float) -> bool:
        """Pass on so many words; whether that is all that it said. Raises: PeerError."""
        if not self._has_packets:
            self._read()
        self._has_packets = True
        is_much = self.says_much(now_s)
        left, each, may_say = TURN, MUCH if is_much else 1, self._house.words
        while not self._is_held_up:
            packet, words = self._next or self._cut()
            self._next = None
            if packet is None:
                self._has_packets = False
                return not (self._said or (self._websocket and self._websocket.has_more))
            if self._broker is None:  # the first is its CONNECT
                self._hello, self._is_held_up = packet, True
                self._house.line.asks(self)
            elif min(left, may_say) <= 0 or (words > 1 and not is_much and self._little.wait_s(now_s, words)):
                self._next = packet, words  # when it is its turn again, or that of who says much
                return False
            elif self._pass_on(packet, words, now_s):
                left -= max(words, each)
                may_say -= words
            else:
                left -= 1
        return False

    def _cut(self) -> tuple[bytes | None, int]:
        """The next packet, if it is there, and its words."""
        packet = self._packets.next()
        return packet, words_of(packet) if packet else 1

    def says_much(self, now_s: float) -> bool:
        """Whether it said more than a phone lately."""
        return self._little.wait_s(now_s, self._next[1] if self._next else 1) > 0.0

    def is_behind(self, now_s: float) -> bool:
        """Whether it has not been heard out for so long that its commands come late."""
        return self.waits_since_s is not None and now_s - self.waits_since_s > LATE_S

    def says_too_much(self, now_s: float) -> bool:
        """Whether it said most of what it may."""
        return self.pace.wait_s(now_s, FEW) > 0.0

    def _wait(self, pause_s: float = 0.0) -> None:
        """For another turn."""
        if pause_s:
            asyncio.get_running_loop().call_later(pause_s, self._wait)
        elif self._waits:
            self._house.wants(self)

    def _read(self) -> None:
        said, self._said = self._said, b""
        if self._websocket is not None:
            said = self._websocket.read(said)
            self.pace.said(self._websocket.frames)
            if self._websocket.replies and not self._has_left:
                self._transport.write(self._websocket.replies)
            self._websocket.replies = b""
            if self.waiting_bytes() > WAITING_BYTES:
                raise NoWebsocketError("asks and does not read")
        self._packets.add(said)

    def _pass_on(self, packet: bytes, words: int, now_s: float) -> bool:
        """Whether it was passed on."""
        assert self._broker is not None
        if self._broker.is_closing():  # asyncio complains of whoever says more, in the operator's log
            return False
        kind = packet[0]
        if kind in (SUBSCRIBE, UNSUBSCRIBE):
            self._house.readers.reads(self, self._packets.answers)
        self.pace.said(words)
        self._little.said(words)
        self._new_words -= words
        if self.standing is Standing.NEW and self._new_words < 0:
            self.standing = Standing.STRANGER
        if kind & 0xF0 == PUBLISH:
            if is_question(packet):
                self._house.questions.hold(self, packet)
                return False
            if self.is_behind(now_s):
                self._house.drops()
                return False
            self._house.passes_on(words)
        elif kind == PINGREQ:
            if now_s - self._pinged_at_s < PINGS_APART_S:
                return False
            self._pinged_at_s = now_s
        self._broker.write(packet)
        self._house.heard(self, speaks=kind & 0xF0 == PUBLISH)
        return True

    def ask_swarm(self, question: bytes) -> None:
        """A question of its own that was held aside is passed on, if the broker keeps up."""
        if self._broker and not (self._is_held_up or self._broker.is_closing()):
            self._house.passes_aside(words_of(question))
            self._broker.write(question)
            self._house.heard(self, speaks=True)

    def _heard_out(self) -> None:
        self._waits = False
        self.waits_since_s = self._paused_at_s if self._paused_at_s and self._has_unread() else None
        self._paused_at_s = None
        if self._has_left:
            self._end()
        elif self._websocket is not None and self._websocket.closed:
            self._transport.close()
        else:
            self._transport.resume_reading()

    def _has_unread(self) -> bool:
        """Whether there is more in the socket, which may have come as soon as nothing was read any more."""
        return not self._has_left and fcntl.ioctl(self._connection, termios.FIONREAD, bytes(4)) != bytes(4)

    def ask(self) -> None:
        """It is the next in line."""
        self._in_line = True
        self._task = asyncio.create_task(self._ask())

    async def _ask(self) -> None:
        try:
            connection = await connected(self._house.broker)
            loop = asyncio.get_running_loop()
            self._broker, _ = await loop.create_unix_connection(lambda: Broker(self), sock=connection)
        except OSError:  # it starts again, say
            self.leave()
            return
        self._broker.set_write_buffer_limits(high=FULL_BYTES)
        self._broker.write(self._hello)
        self._house.heard(self)
        self.go_on()

    def _is_answered(self) -> None:
        if self._in_line:
            self._in_line = False
            self._house.line.answered()

    def loses(self, name: bytes) -> None:
        """Another one reads the answers on this topic now."""
        self.answers -= {name}
        goodbye = self._packets.without(name)
        if self._broker and not self._broker.is_closing():
            self._broker.write(goodbye)

    def hold_up(self) -> None:
        """The broker does not keep up."""
        self._is_held_up = True

    def go_on(self) -> None:
        """It does again."""
        self._is_held_up = False
        self._wait()

    def tell(self, data: bytes) -> None:
        """The broker said something. Nothing of it waits in the broker, which could be filled so."""
        self._is_answered()
        if self._has_left:
            return
        if self.standing < Standing.PROVED and (shown := self._proof.of(data, self.answers)):
            self._house.shows(self, shown)
        before = self.waiting_bytes()
        if self._websocket is not None:
            data = frame_head(BINARY, len(data)) + data
        self._transport.write(data)
        waiting = self.waiting_bytes()
        if waiting > WAITING_BYTES:
            self.leave()
        self._house.waits(waiting - before)

    def waiting_bytes(self) -> int:
        """What it has not read yet."""
        return self._transport.get_write_buffer_size() if self._is_here else 0

    def kept_bytes(self) -> int:
        """What we keep of it and for it: what it has not read, and what we have not heard or cannot hear yet."""
        frames = self._websocket.unread_bytes if self._websocket else 0
        return self.waiting_bytes() + frames + len(self._said) + len(self._packets)

    def is_overdue(self, now_s: float) -> bool:
        """Whether it should have said or read something by now."""
        if not self.waiting_bytes():
            self._read_all_at_s = now_s
        is_silent = now_s - self._came_at_s > HELLO_S and not self._packets.connected
        return is_silent or now_s - self._read_all_at_s > STALLED_S

    def say_goodbye(self) -> None:
        """The broker has hung up: so do we, when all is said."""
        self._is_over = True
        self._is_answered()
        if self._has_left:
            self.leave()
        self._transport.close()

    def leave(self) -> None:
        """Hang up at once; nothing of it is passed on any more."""
        if not self._is_here:
            if self._task is None:
                self._connection.close()
        elif not self._has_left:  # asyncio complains of whoever hangs up on one that has gone
            self._transport.abort()
        self._has_left = True
        self._waits = False
        self._house.forget(self)
        self._is_answered()
        if self._is_here and self._task is not None:
            self._task.cancel()  # or the broker would have a visitor that is not there
        if self._broker is not None and not self._is_over:
            self._broker.abort()

    def connection_lost(self, error: Exception | None) -> None:  # noqa: ARG002
        """It has gone; what it said last is passed on, if the broker knows it."""
        self._has_left = True
        if self._broker is None or self._is_over:
            self.leave()
        elif not self._waits:
            self._end()

    def _end(self) -> None:
        """All is said."""
        assert self._broker is not None
        self._broker.close()
        self._house.forget(self)


def words_of(packet: bytes) -> int:
    """As how many words it counts."""
    return ASKING if packet[0] in (SUBSCRIBE, UNSUBSCRIBE) else 1 + len(packet) // WORD_BYTES


def _has_gone(connection: socket.socket) -> bool:
    """Whether it has hung up, even if there is something of it to read."""
    asking = select.poll()
    asking.register(connection, select.POLLRDHUP)
    return bool(asking.poll(0))
