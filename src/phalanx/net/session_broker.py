"""Sessions on a broker that nobody trusts: the topics of connections, in and out.

Only lengths are looked at here. Connections take turns, those who knock have one turn together, and each has room for
a few messages only: whoever floods a topic, which others may guess or read, keeps nobody else waiting.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, OrderedDict, deque
from collections.abc import AsyncIterator
from typing import Self

from phalanx.errors import PeerError
from phalanx.link.messages import Ask, Publish, Subscribe, Unsubscribe
from phalanx.link.session.events import Close, Listen, Send
from phalanx.link.session.events import Publish as Update
from phalanx.wire.sessions import RECORD, SIGNED_HELLO, TAG_BYTES

from .broker_url import BrokerUrl
from .connection import Connection
from .front import Received

KNOCKS = 0  # the connection of first messages, which have none yet
ROW_BYTES = 64 * 1024  # of one connection, that may wait to be read; each message takes some more
MORE_BYTES = 64
AT_ONCE_S = 0.01  # for which messages are processed before anything else has its turn
UNSENT_BYTES = 32 * 1024 * 1024  # towards a broker that takes nothing
CLOSE_TIMEOUT_S = 1.0
Told = Send | Update | Listen | Close


class SessionBroker:
    """A server's end. Use as `async with`; functions never block, and topics are below the root.

    Args:
        knocks: topic of first messages.
        max_bytes: plaintext of the longest record of a client.

    Attributes:
        rejected: messages that were dropped unread, by reason.
    """

    def __init__(self, broker: BrokerUrl, root: str, knocks: str, max_bytes: int) -> None:
        self.broker = broker
        self.rejected: Counter[str] = Counter()
        self._root = root
        self._longest = RECORD.size + max_bytes + TAG_BYTES
        self._topics: dict[int, tuple[str, ...]] = {}
        self._of: dict[str, int] = {}  # whose topic it is
        self._rows: OrderedDict[int, deque[bytes]] = OrderedDict()  # unread messages, whose turn it is first
        self._unread_bytes: Counter[int] = Counter()
        self._unsent: deque[Ask] = deque()
        self._unsent_bytes = 0
        self._update: Publish | None = None  # the one that waits
        self._reads, self._sends = asyncio.Event(), asyncio.Event()
        self._asked: set[asyncio.Task[bool]] = set()
        self._tasks: list[asyncio.Task[None]] = []
        self._link = Connection(broker, "sessions", lambda: list(self._of), self._on_message, None, 5, self._dropped)
        self._listen(KNOCKS, (knocks,))

    @property
    def mqtt(self) -> int:
        """Return the version of MQTT that the broker speaks, 5 or 4."""
        return self._link.mqtt

    @property
    def connected(self) -> bool:
        """Return whether the broker is there now."""
        return self._link.connected.is_set()

    @property
    def trouble(self) -> str:
        """Return what the last connection attempt died of; "" while connected."""
        return self._link.trouble

    async def __aenter__(self) -> Self:
        self._tasks = [self._link.start(), asyncio.create_task(self._send())]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in (*self._tasks, *self._asked):
            task.cancel()
        await asyncio.wait(self._tasks, timeout=CLOSE_TIMEOUT_S)  # a broker that hangs must not hold up the end

    async def wait_connected(self, timeout_s: float) -> None:
        """Wait for the broker. Raises: TimeoutError; Unavailable: it refused us."""
        await self._link.wait_connected(timeout_s)

    async def run(self) -> None:
        """Serve until cancelled. Raises: Unavailable: the broker refused us."""
        await asyncio.gather(*self._tasks)

    async def events(self) -> AsyncIterator[Received]:
        """Yield messages, one of each connection in turn; first messages are of connection `KNOCKS`."""
        while True:
            until_s = time.monotonic() + AT_ONCE_S
            while self._rows:
                connection, row = self._rows.popitem(last=False)
                data = row.popleft()
                self._unread_bytes[connection] -= len(data) + MORE_BYTES
                if row:
                    self._rows[connection] = row
                else:
                    del self._unread_bytes[connection]
                yield Received(connection, data)
                if time.monotonic() >= until_s:
                    await asyncio.sleep(0)  # the robots' tick is due as well
                    until_s = time.monotonic() + AT_ONCE_S
            self._reads.clear()
            await self._reads.wait()

    def carry(self, told: Told) -> None:
        """Do what a server of sessions asks for. What is said is lost while the broker is away or takes nothing."""
        match told:
            case Send(_, data, topic):
                self._put(Publish(f"{self._root}/{topic}", data))
            case Update(_, data, topic):
                # Whoever has not taken the last one misses this one: a queue would make every command late.
                update = Publish(f"{self._root}/{topic}", data)
                if self._update is None and self._put(update):
                    self._update = update
            case Listen(connection, topics):
                self._listen(connection, topics)
            case Close(connection) if connection != KNOCKS:
                self._listen(connection, ())

    def _listen(self, connection: int, topics: tuple[str, ...]) -> None:
        """Let these topics be a connection's from now on, and no others."""
        new = tuple(f"{self._root}/{each}" for each in topics)
        before = self._topics.pop(connection, ())
        for topic in before:
            if topic not in new:
                del self._of[topic]
                self._put(Unsubscribe(topic))
        for topic in new:
            self._of[topic] = connection
            if topic not in before:
                self._put(Subscribe(topic))
        if new:
            self._topics[connection] = new
        else:
            self._rows.pop(connection, None)
            self._unread_bytes.pop(connection, None)

    # --- the broker --------------------------------------------------------------------------------------------------

    def _put(self, ask: Ask) -> bool:
        """Ask the broker in its turn; return false if it is away: topics are made good by connecting."""
        size = len(ask.payload) if isinstance(ask, Publish) else 0
        if not self.connected or self._unsent_bytes + size > UNSENT_BYTES:
            return False
        self._unsent_bytes += size
        self._unsent.append(ask)
        self._sends.set()
        return True

    async def _send(self) -> None:
        while True:
            self._sends.clear()
            while self._unsent:
                ask = self._unsent.popleft()
                if isinstance(ask, Publish):
                    self._unsent_bytes -= len(ask.payload)
                    await self._link.send((ask,))
                    if ask is self._update:
                        self._update = None
                    continue
                # Its answer is not waited for: a broker works off what one client asks in that order.
                asked = asyncio.create_task(self._link.send((ask,)))
                self._asked.add(asked)
                asked.add_done_callback(self._asked.discard)
                await asyncio.sleep(0)
            await self._sends.wait()

    async def _on_message(self, topic: str, payload: bytes) -> None:
        connection = self._of.get(topic)
        if connection is None:
            return  # of a connection that is over
        size = len(payload) + MORE_BYTES
        if len(payload) > self._longest:
            self.rejected["too_large"] += 1
        elif connection == KNOCKS and len(payload) != SIGNED_HELLO.size:
            self.rejected["malformed_record"] += 1
        elif self._unread_bytes[connection] + size > ROW_BYTES:
            self.rejected["overrun"] += 1
        else:
            self._unread_bytes[connection] += size
            self._rows.setdefault(connection, deque()).append(payload)
            self._reads.set()

    def _dropped(self, error: PeerError) -> None:
        self.rejected[error.reason] += 1
