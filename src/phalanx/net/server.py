"""Server of the link in mode qrkey: exposes a program's robots through an untrusted broker.

Exported as `phalanx.link.Server`.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
import os
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, Self, TypeVar

from phalanx.config import LinkConfig
from phalanx.errors import HandlerFailed, PeerError, Unknown, UsageError
from phalanx.link.messages import Ask, Command, Knock, Rejected, Request
from phalanx.link.pin import Epoch, Pin
from phalanx.link.qrurl import Login, QrUrl
from phalanx.link.server_side import ServerSide

from .answers import Answers
from .broker_url import BrokerUrl, parse_broker_url, websocket_of
from .connection import Connection
from .incoming import STALE_S

log = logging.getLogger(__name__)

CommandHandler = TypeVar("CommandHandler", bound=Callable[[Command], Any])
RequestHandler = TypeVar("RequestHandler", bound=Callable[[Request], Any])
LinkEvent = Command | Request | Knock | Rejected | Epoch
ANY: Literal["*"] = "*"
CLOSE_TIMEOUT_S = 1.0


class Server:
    """Server with handlers for commands and requests. Use as `async with`; handlers may be functions or coroutines.

    A handler raises a `PeerError` (such as `BadPayload`) for an invalid payload; the server counts it and goes on.

    Args:
        broker: mqtt://, mqtts://, ws:// or wss:// URL, or a parsed one.
        config: parameters of the protocol.
        login: login for a broker that requires one.
        broker_for_visitors: websocket URL for browsers; derived from `broker` by default.
        pin: the first pin; random by default.
        mqtt: protocol version to try first, 5 or 4.
        clock: returns seconds since 1970; for tests.
    Raises: UsageError: a bad URL. On waiting or running, Unavailable: the broker refused the login.
    Source: Qrkey §III.
    """

    def __init__(
        self,
        broker: str | BrokerUrl = "mqtt://127.0.0.1:1883",
        *,
        config: LinkConfig | None = None,
        login: Login | None = None,
        broker_for_visitors: str = "",
        pin: Pin | None = None,
        mqtt: int = 5,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.config = config or LinkConfig()
        self.broker = parse_broker_url(broker, login) if isinstance(broker, str) else broker
        self.broker_for_visitors = broker_for_visitors or websocket_of(self.broker)
        self.counters: Counter[str] = Counter()
        self.on_event: Callable[[LinkEvent], None] = lambda _: None
        self._clock = clock
        self._side = ServerSide(self.config, os.urandom, time.monotonic(), pin)
        self._commands: dict[str, Callable[[Command], Any]] = {}
        self._requests: dict[int | str, Callable[[Request], Any]] = {}
        self._link: Connection | None = None
        self._answers = Answers[Request](self._deal_with)
        self._mqtt = mqtt
        self._tasks: list[asyncio.Task[None]] = []
        self._reached = asyncio.Event()
        self._sooner = asyncio.Event()

    def on_command(self, name: str) -> Callable[[CommandHandler], CommandHandler]:
        """Register a handler for command `name`, or with `ANY` for all others; it takes a `Command`. A decorator."""
        if not isinstance(name, str):
            raise UsageError("on_command takes the command's name", 'use it as @server.on_command("move_raw")')

        def register(handler: CommandHandler) -> CommandHandler:
            self._commands[name] = handler
            return handler

        return register

    def on_request(self, number: int | Literal["*"]) -> Callable[[RequestHandler], RequestHandler]:
        """Register a handler for request `number`, or with `ANY` for all others. A decorator.

        It takes a `Request` and returns the answer's data, or a `SharedAnswer` for all requests at about this time.
        """
        if not (isinstance(number, int) or number == ANY):
            raise UsageError("on_request takes the request's number", "use it as @server.on_request(0)")

        def register(handler: RequestHandler) -> RequestHandler:
            self._requests[number] = handler
            return handler

        return register

    @property
    def epoch(self) -> Epoch:
        """Return the current pin, topic and key."""
        return self._side.epoch

    @property
    def overlapping(self) -> bool:
        """Return whether two pins are accepted now."""
        return len(self._side.live_epochs()) == 2

    @property
    def rotates_in_s(self) -> float:
        """Return the seconds until the next pin; before the first connect the full period, as nobody has this pin."""
        if not self._reached.is_set():
            return self.config.rotate_s
        return max(0.0, self._side.rotated_at_s + self.config.rotate_s - time.monotonic())

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of refused messages, by reason."""
        return self._side.rejected + Counter(overrun=self._link.overruns if self._link else 0)

    is_published = True

    @property
    def answer_bytes(self) -> int:
        """Return the longest answer, as JSON, that clients accept."""
        return self.config.max_to_client_bytes

    @property
    def connected(self) -> bool:
        """Return whether the broker is connected now."""
        return self._link is not None and self._link.connected.is_set()

    @property
    def trouble(self) -> str:
        """Return the error of the last connection attempt; "" while connected."""
        return self._link.trouble if self._link else ""

    @property
    def reconnects(self) -> int:
        """Return the number of reconnects."""
        return self._link.reconnects if self._link else 0

    def qr(self) -> QrUrl:
        """Return the content of the current QR code; it changes at every rotation. Source: docs/spec/link.md."""
        mqtt = self._link.mqtt if self._link else self._mqtt
        return QrUrl(self._side.epoch.pin, self.broker_for_visitors, self.config.root, mqtt)

    async def __aenter__(self) -> Self:
        self._link = Connection(
            self.broker,
            "server",
            self._side.subscriptions,
            self._on_message,
            self._on_connect,
            self._mqtt,
            self._on_dropped,
            STALE_S,
        )
        self._tasks = [self._link.start(), *map(asyncio.create_task, (self._rotate(), self._answers.run()))]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        # A hanging broker must not block the exit.
        await asyncio.wait(self._tasks, timeout=CLOSE_TIMEOUT_S)

    async def wait_connected(self, timeout_s: float | None = None) -> None:
        """Wait for the broker. Raises: UsageError: not entered; TimeoutError; Unavailable: it refused the login."""
        await self._entered().wait_connected(timeout_s)

    async def run(self) -> None:
        """Serve until cancelled. Raises: UsageError, Unavailable: as `wait_connected`."""
        self._entered()
        await asyncio.gather(*self._tasks)

    async def notify(self, payload: Any) -> bool:
        """Send a notification to all visitors, encrypted once (twice in an overlap); return false if it was not sent.

        Raises: UsageError: not entered; not JSON, or longer than clients accept.
        Source: Qrkey §III.
        """
        link = self._entered()
        if not link.connected.is_set():
            return False
        sent = await link.send(self._side.notify(payload, self._clock()))
        self.counters["notifications"] += sent
        return sent

    def _entered(self) -> Connection:
        if self._link is None:
            raise UsageError("the server is not entered", "use it as `async with server:`")
        return self._link

    async def _on_connect(self, again: bool) -> None:
        if again:
            await self._do(self._side.reconnected(time.monotonic()))
        else:
            self._side.restart_clock(time.monotonic())
            self._reached.set()

    def _on_dropped(self, error: PeerError) -> None:
        self._report(self._side.reject(error))

    async def rotate(self) -> bool:
        """Rotate the pin now; return false in an overlap, or before the first connection to the broker."""
        return self._reached.is_set() and await self._advance(self._side.rotate)

    async def _rotate(self) -> None:
        await self._reached.wait()
        while True:
            self._sooner.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(max(0.01, self._side.next_due_s() - time.monotonic())):
                    await self._sooner.wait()
            await self._advance(self._side.advance)

    async def _advance(self, step: Callable[[float], tuple[Ask, ...]]) -> bool:
        before = self._side.epoch
        await self._do(step(time.monotonic()))
        if self._side.epoch is before:
            return False
        log.info("a new pin; the old one is accepted for %g s more", self.config.overlap_s)
        self._report(self._side.epoch)
        self._sooner.set()
        return True

    async def _do(self, asks: tuple[Ask, ...]) -> None:
        if self._link is not None and asks:
            await self._link.send(asks)

    async def _on_message(self, topic: str, token: bytes) -> None:
        event = self._side.receive(topic, token, self._clock(), time.monotonic())
        if not isinstance(event, Request):
            await self._deal_with(event)
            return
        try:
            self._answers.ask((event.client_id, event.number), event.size, event)
        except PeerError as error:
            self._report(self._side.reject(error))

    async def _deal_with(self, event: Command | Request | Knock | Rejected) -> None:
        try:
            event = await self._handle(event)
        except PeerError as error:
            event = self._side.reject(error)
        if isinstance(event, Rejected):
            log.debug("refused a message: %s", event.reason)
        self._report(event)

    def _report(self, event: LinkEvent) -> None:
        try:
            self.on_event(event)
        except Exception as error:  # noqa: BLE001  # any error:
            # a peer's message must not end the receive loop through a fault in on_event.
            log.error("on_event failed: %s", fault(error))  # noqa: TRY400  # no traceback: see fault

    async def _handle(self, event: Command | Request | Knock | Rejected) -> Command | Request | Knock | Rejected:
        if isinstance(event, Command):
            handler = self._commands.get(event.name) or self._commands.get(ANY)
            if handler is None:
                raise Unknown(f"no command {event.name!r}")
            await call_handler(handler, replace(event, waited_s=self._link.waited_s if self._link else 0.0))
            self.counters["commands"] += 1
        elif isinstance(event, Request):
            answer = self._requests.get(event.number) or self._requests.get(ANY)
            if answer is None:
                raise Unknown(f"no request {event.number}")
            await self._answer(event, await call_handler(answer, event))
            self.counters["requests"] += 1
        elif isinstance(event, Knock):
            self.counters["knocks"] += 1
            await self._do(event.asks)
        return event

    async def _answer(self, request: Request, data: Any) -> None:
        try:
            asks = self._side.reply(request, data, self._clock())
        except UsageError as error:
            log.error("request %d: the answer cannot be sent: %s", request.number, error)  # noqa: TRY400
            raise HandlerFailed(str(error)) from error
        await self._do(asks)


async def call_handler(handler: Callable[[Any], Any], event: Command | Request) -> Any:
    """Call a handler, which may be a coroutine. Raises: PeerError; HandlerFailed: any other error in the handler."""
    try:
        result = handler(event)
        return await result if inspect.isawaitable(result) else result
    except PeerError:
        raise
    except Exception as error:
        raise handler_failed(handler, error) from error


def handler_failed(handler: Callable[[Any], Any], error: Exception) -> HandlerFailed:
    """Log the error of a handler, and return it as a HandlerFailed."""
    log.error("handler %s failed: %s", getattr(handler, "__qualname__", "?"), fault(error))  # no traceback: see fault
    return HandlerFailed(type(error).__name__)


def fault(error: Exception) -> str:
    """Return type and place of an error, without its message, which may contain a visitor's data (as in a KeyError)."""
    ours, *theirs = ((frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__))
    # The innermost line in the handler's own file is more useful than one in a library.
    path, line = next((at for at in reversed(theirs) if at[0] == theirs[0][0]), ours)
    return f"{type(error).__name__} at {path}:{line}"
