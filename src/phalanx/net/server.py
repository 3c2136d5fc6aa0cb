"""The server's end of the link: a program's robots, commanded through a broker that nobody trusts.

Use it as `phalanx.link.Server`.
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
Happening = Command | Request | Knock | Rejected | Epoch
ANY: Literal["*"] = "*"
CLOSE_TIMEOUT_S = 1.0


class Server:
    """Robots behind the link. Use as `async with`; handlers may be plain functions or coroutines.

    A handler that cannot make sense of a payload raises a `PeerError` (such as `BadPayload`): counted, survived.

    Args:
        broker: mqtt://, mqtts://, ws:// or wss:// URL, or a parsed one.
        config: the link's parameters.
        login: for a broker that asks for one.
        broker_for_visitors: websocket URL that browsers use; derived from `broker` if that is one.
        pin: the first pin; a fresh one unless given.
        mqtt: protocol version to try first, 5 or 4.
        clock: seconds since 1970; for tests.
    Raises: UsageError: a bad URL. On entering or waiting, Unavailable: the broker refused the login.
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
        self.on_event: Callable[[Happening], None] = lambda _: None
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
        """Decorate the handler of command `name`, or of every other one with `ANY`; it takes a `Command`."""
        if not isinstance(name, str):
            raise UsageError("on_command takes the command's name", '@server.on_command("move_raw")')

        def register(handler: CommandHandler) -> CommandHandler:
            self._commands[name] = handler
            return handler

        return register

    def on_request(self, number: int | Literal["*"]) -> Callable[[RequestHandler], RequestHandler]:
        """Decorate the handler of request `number`, or of every other one with `ANY`.

        It takes a `Request` and returns the answer's data, or a `SharedAnswer` for all who ask at about this time.
        """
        if not (isinstance(number, int) or number == ANY):
            raise UsageError("on_request takes the request's number", "@server.on_request(0)")

        def register(handler: RequestHandler) -> RequestHandler:
            self._requests[number] = handler
            return handler

        return register

    @property
    def epoch(self) -> Epoch:
        """The current pin, topic and key."""
        return self._side.epoch

    @property
    def overlapping(self) -> bool:
        """Whether two pins are accepted just now."""
        return len(self._side.live_epochs()) == 2

    @property
    def rotates_in_s(self) -> float:
        """Seconds until the next pin; the whole time before the first connect: nobody can have scanned this one."""
        if not self._reached.is_set():
            return self.config.rotate_s
        return max(0.0, self._side.rotated_at_s + self.config.rotate_s - time.monotonic())

    @property
    def rejected(self) -> Counter[str]:
        """Refused messages by reason."""
        return self._side.rejected + Counter(overrun=self._link.overruns if self._link else 0)

    is_published = True

    @property
    def answer_bytes(self) -> int:
        """Return the longest answer, as JSON, that a client reads."""
        return self.config.max_to_client_bytes

    @property
    def connected(self) -> bool:
        """Whether the broker is there now."""
        return self._link is not None and self._link.connected.is_set()

    @property
    def trouble(self) -> str:
        """What the last connection attempt died of; "" while connected."""
        return self._link.trouble if self._link else ""

    @property
    def reconnects(self) -> int:
        """How often the broker came back."""
        return self._link.reconnects if self._link else 0

    def qr(self) -> QrUrl:
        """What a QR code says now; it changes at every rotation. Source: docs/spec/link.md."""
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
        # A broker that hangs must not hold up the end.
        await asyncio.wait(self._tasks, timeout=CLOSE_TIMEOUT_S)

    async def wait_connected(self, timeout_s: float | None = None) -> None:
        """Wait for the broker. Raises: UsageError: not entered. TimeoutError; Unavailable: it refused us."""
        await self._entered().wait_connected(timeout_s)

    async def run(self) -> None:
        """Serve until cancelled. Raises: UsageError, Unavailable: as `wait_connected`."""
        self._entered()
        await asyncio.gather(*self._tasks)

    async def notify(self, payload: Any) -> bool:
        """Tell every visitor; one encryption (two in an overlap) whatever their number. False if the broker is away.

        Raises: UsageError: not entered; not JSON, or more than a client reads.
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
            raise UsageError("the server is not entered", "async with server: …")
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
        """A new pin now, as at any rotation; False in an overlap, and before the broker was reached."""
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
        said = self._side.receive(topic, token, self._clock(), time.monotonic())
        if not isinstance(said, Request):
            await self._deal_with(said)
            return
        try:
            self._answers.ask((said.client_id, said.number), said.size, said)
        except PeerError as error:
            self._report(self._side.reject(error))

    async def _deal_with(self, said: Command | Request | Knock | Rejected) -> None:
        try:
            said = await self._handle(said)
        except PeerError as error:
            said = self._side.reject(error)
        if isinstance(said, Rejected):
            log.debug("refused a message: %s", said.reason)
        self._report(said)

    def _report(self, said: Happening) -> None:
        try:
            self.on_event(said)
        except Exception as error:  # noqa: BLE001  # whatever it is:
            # what a peer says must not end the receive loop by way of whoever watches it.
            log.error("on_event failed: %s", fault(error))  # noqa: TRY400  # no trace: see fault

    async def _handle(self, said: Command | Request | Knock | Rejected) -> Command | Request | Knock | Rejected:
        if isinstance(said, Command):
            handler = self._commands.get(said.name) or self._commands.get(ANY)
            if handler is None:
                raise Unknown(f"no command {said.name!r}")
            await call_handler(handler, replace(said, waited_s=self._link.waited_s if self._link else 0.0))
            self.counters["commands"] += 1
        elif isinstance(said, Request):
            answer = self._requests.get(said.number) or self._requests.get(ANY)
            if answer is None:
                raise Unknown(f"no request {said.number}")
            await self._answer(said, await call_handler(answer, said))
            self.counters["requests"] += 1
        elif isinstance(said, Knock):
            self.counters["knocks"] += 1
            await self._do(said.asks)
        return said

    async def _answer(self, request: Request, data: Any) -> None:
        try:
            asks = self._side.reply(request, data, self._clock())
        except UsageError as error:
            log.error("request %d: the answer cannot be sent: %s", request.number, error)  # noqa: TRY400
            raise HandlerFailed(str(error)) from error
        await self._do(asks)


async def call_handler(handler: Callable[[Any], Any], said: Command | Request) -> Any:
    """Call a handler, which may be a coroutine. Raises: PeerError; HandlerFailed for whatever else goes wrong there."""
    try:
        result = handler(said)
        return await result if inspect.isawaitable(result) else result
    except PeerError:
        raise
    except Exception as error:
        raise handler_failed(handler, error) from error


def handler_failed(handler: Callable[[Any], Any], error: Exception) -> HandlerFailed:
    """Log what went wrong in a handler, and return what it counts as."""
    log.error("handler %s failed: %s", getattr(handler, "__qualname__", "?"), fault(error))  # no trace: see fault
    return HandlerFailed(type(error).__name__)


def fault(error: Exception) -> str:
    """Type and place of a fault of this program. Not its message: it may quote a visitor (a KeyError says the key)."""
    ours, *theirs = ((frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__))
    # The handler's own innermost line says more than that of the library it called.
    path, line = next((at for at in reversed(theirs) if at[0] == theirs[0][0]), ours)
    return f"{type(error).__name__} at {path}:{line}"
