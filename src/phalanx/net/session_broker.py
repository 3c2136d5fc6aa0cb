"""Transport of sessions over an untrusted broker: topics and queues of the connections.

Only the lengths of messages are checked here. Connections are served round-robin, with all first messages as one
connection, and each has a short queue. So a flood on one topic does not delay other connections.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, OrderedDict, deque
from collections.abc import AsyncIterator
from typing import Self

from phalanx.errors import PeerError
from phalanx.link.messages import Ask, Publish, Subscribe, Unsubscribe
from phalanx.link.session.events import Close, Send, SetConnectionTopics
from phalanx.link.session.events import Publish as Update
from phalanx.wire.sessions import RECORD, SIGNED_HELLO, TAG_BYTES

from .broker_url import BrokerUrl
from .connection import Connection
from .front import Received

HELLO_CONNECTION = 0  # number of the shared connection of first messages
ROW_BYTES = 64 * 1024  # limit of one connection's queue
MORE_BYTES = 64  # overhead of a queued message
AT_ONCE_S = 0.01  # longest time for messages before other tasks of the event loop run
UNSENT_BYTES = 32 * 1024 * 1024  # limit of the queue to a broker that does not read
CLOSE_TIMEOUT_S = 1.0
BrokerOutput = Send | Update | SetConnectionTopics | Close


class SessionBroker:
    """Server's end of the transport. Use as `async with`; methods never block. Topics in arguments lack the root.

    Args:
        knocks: topic of first messages.
        max_bytes: plaintext of the longest record of a client.

    Attributes:
        rejected: number of messages dropped unread, by reason.
    """

    def __init__(self, broker: BrokerUrl, root: str, knocks: str, max_bytes: int) -> None:
        self.broker = broker
        self.rejected: Counter[str] = Counter()
        self._root = root
        self._longest = RECORD.size + max_bytes + TAG_BYTES
        self._topics: dict[int, tuple[str, ...]] = {}
        self._of: dict[str, int] = {}  # connection by topic
        self._rows: OrderedDict[int, deque[bytes]] = OrderedDict()  # unread messages, next connection first
        self._unread_bytes: Counter[int] = Counter()
        self._unsent: deque[Ask] = deque()
        self._unsent_bytes = 0
        self._update: Publish | None = None  # the update in the queue
        self._reads, self._sends = asyncio.Event(), asyncio.Event()
        self._asked: set[asyncio.Task[bool]] = set()
        self._tasks: list[asyncio.Task[None]] = []
        self._link = Connection(broker, "sessions", lambda: list(self._of), self._on_message, None, 5, self._dropped)
        self._listen(HELLO_CONNECTION, (knocks,))

    @property
    def mqtt(self) -> int:
        """Return the MQTT version of the connection, 5 or 4."""
        return self._link.mqtt

    @property
    def connected(self) -> bool:
        """Return whether the broker is connected now."""
        return self._link.connected.is_set()

    @property
    def trouble(self) -> str:
        """Return the error of the last connection attempt; "" while connected."""
        return self._link.trouble

    async def __aenter__(self) -> Self:
        self._tasks = [self._link.start(), asyncio.create_task(self._send())]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in (*self._tasks, *self._asked):
            task.cancel()
        await asyncio.wait(self._tasks, timeout=CLOSE_TIMEOUT_S)  # a hanging broker must not block the exit

    async def wait_connected(self, timeout_s: float) -> None:
        """Wait for the broker. Raises: TimeoutError; Unavailable: it refused the connection."""
        await self._link.wait_connected(timeout_s)

    async def run(self) -> None:
        """Serve until cancelled. Raises: Unavailable: the broker refused the connection."""
        await asyncio.gather(*self._tasks)

    async def events(self) -> AsyncIterator[Received]:
        """Yield messages, round-robin over the connections; first messages have the connection `HELLO_CONNECTION`."""
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
                    await asyncio.sleep(0)  # lets other tasks run, such as the robots' tick
                    until_s = time.monotonic() + AT_ONCE_S
            self._reads.clear()
            await self._reads.wait()

    def carry(self, event: BrokerOutput) -> None:
        """Carry out an event of `SessionServer`. Messages are lost while the broker is unreachable or does not read."""
        match event:
            case Send(_, data, topic):
                self._put(Publish(f"{self._root}/{topic}", data))
            case Update(_, data, topic):
                # Skipped while the last update is still queued: a backlog would make every command late.
                update = Publish(f"{self._root}/{topic}", data)
                if self._update is None and self._put(update):
                    self._update = update
            case SetConnectionTopics(connection, topics):
                self._listen(connection, topics)
            case Close(connection) if connection != HELLO_CONNECTION:
                self._listen(connection, ())

    def _listen(self, connection: int, topics: tuple[str, ...]) -> None:
        """Set the topics of a connection to exactly these."""
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
        """Queue a request to the broker; return false if it is unreachable. Reconnecting subscribes to all topics."""
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
                # Not awaited: a broker processes the requests of one client in order.
                asked = asyncio.create_task(self._link.send((ask,)))
                self._asked.add(asked)
                asked.add_done_callback(self._asked.discard)
                await asyncio.sleep(0)
            await self._sends.wait()

    async def _on_message(self, topic: str, payload: bytes) -> None:
        connection = self._of.get(topic)
        if connection is None:
            return  # of a closed connection
        size = len(payload) + MORE_BYTES
        if len(payload) > self._longest:
            self.rejected["too_large"] += 1
        elif connection == HELLO_CONNECTION and len(payload) != SIGNED_HELLO.size:
            self.rejected["malformed_record"] += 1
        elif self._unread_bytes[connection] + size > ROW_BYTES:
            self.rejected["overrun"] += 1
        else:
            self._unread_bytes[connection] += size
            self._rows.setdefault(connection, deque()).append(payload)
            self._reads.set()

    def _dropped(self, error: PeerError) -> None:
        self.rejected[error.reason] += 1
