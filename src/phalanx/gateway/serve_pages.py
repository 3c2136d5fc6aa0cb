"""The two pages over HTTP. The visitors' page is plain files and knows no secret; the operator's asks for a token.

Only `OperatorPages` may answer with a pin, and it listens on loopback only. Both are served beside the gateway's event
loop (`beside`): what holds that up does not hold up an emergency stop, nor a thousand who ask for the page a joystick.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import json
import logging
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from phalanx.errors import PeerError, Unavailable, Unknown, UsageError
from phalanx.io.ports import LOOPBACK

from .missions.desk import TEXT_MAX_BYTES, MissionDesk, parse_profile

PAGES = Path(__file__).parent / "pages"
# A page is some 600 KB: a phone that cannot load it within this cannot drive a robot either.
HANG_UP_AFTER_S = 30.0
CHECK_S = 1.0
FRAMES_WAITING = 100
HEALTHY_S = 1.0  # within which a gateway that is well answers itself
# aiohttp logs a trace for every request that is no HTTP, and quotes it.
_FAULTS = logging.getLogger(f"{__name__}.aiohttp")
_FAULTS.addFilter(lambda record: not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError)))

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
Told = TypeVar("Told")
Site = TypeVar("Site", bound="_Site")

COMMON_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-cache",
}
_BASE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Browsers reach the broker by websocket, wherever it is; the operator's page reaches nothing but its own server.
VISITOR_POLICY = f"{_BASE_POLICY}; img-src 'self' data:; connect-src ws: wss:"
OPERATOR_POLICY = f"{_BASE_POLICY}; img-src 'self' data: blob:; connect-src 'self'"


def pages_are_built() -> bool:
    """Whether the pages were built from web/ (they are not in git)."""
    return all((PAGES / page / "index.html").is_file() for page in ("visitor", "operator"))


class _Site:
    """An HTTP server for one page."""

    port_option = "--port"

    def __init__(self, page: str, policy: str, host: str, port: int, longest: int = 4096) -> None:
        self.host, self.port = host, port
        self._folder = PAGES / page
        # By connection: when it asked last, and what works on the answer.
        self._asked: dict[object, tuple[float, asyncio.Task[Any] | None]] = {}
        headers = COMMON_HEADERS | {"Content-Security-Policy": policy}

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            self._asked[request.protocol] = time.monotonic(), asyncio.current_task()
            refusal = self.refuse(request)
            try:
                response = refusal or await handler(request)
            except web.HTTPException as error:  # aiohttp's way of saying 404
                response = web.Response(status=error.status, text=f"{error.reason}\n")
            except OSError:  # a name longer than any file's
                response = web.Response(status=404, text="Not Found\n")
            for name, value in headers.items():
                response.headers.setdefault(name, value)
            return response

        self.app = web.Application(middlewares=[guard], client_max_size=longest)
        self.app.router.add_get("/", self._index)
        self._add_routes()
        if self._folder.is_dir():
            self.app.router.add_static("/", self._folder)
        self._runner = web.AppRunner(self.app, access_log=None, logger=_FAULTS, shutdown_timeout=0.5)

    def _add_routes(self) -> None:
        """Routes that come before the page's files."""

    def refuse(self, request: web.Request) -> web.Response | None:  # noqa: ARG002
        """An answer to give instead, or None."""
        return None

    async def _index(self, _: web.Request) -> web.StreamResponse:
        index = self._folder / "index.html"
        if not index.is_file():
            return web.Response(status=503, text="The page is not built: run `make setup` in the project's folder.\n")
        return web.FileResponse(index)

    async def __aenter__(self) -> Self:
        await self._runner.setup()
        try:
            await web.TCPSite(self._runner, self.host, self.port).start()
        except OSError as error:
            await self._runner.cleanup()
            is_taken = error.errno == errno.EADDRINUSE
            raise Unavailable(
                f"cannot listen on {self.host} port {self.port}: {error.strerror or error}",
                f"another program has it; choose another with {self.port_option}, or {self.port_option} 0 for any"
                if is_taken
                else "--host is an address of this machine, and below port 1024 only root may listen",
            ) from error
        sockets = self._runner.addresses
        self.port = int(sockets[0][1])
        self._hanging_up = asyncio.create_task(self._hang_up_on_idlers())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._hanging_up.cancel()
        await self._runner.cleanup()

    async def _hang_up_on_idlers(self) -> None:
        """A connection is closed soon after its last request; one that asks nothing, soon after it began.

        aiohttp waits for ever for a first request, for half of one, and for whoever does not read the answer.
        """
        while True:
            await asyncio.sleep(CHECK_S)
            now_s = time.monotonic()
            open_now = self._runner.server.connections if self._runner.server else []
            self._asked = {who: self._asked.get(who, (now_s, None)) for who in open_now}
            idle = [who for who in open_now if now_s - self._asked[who][0] >= HANG_UP_AFTER_S]
            for who in idle:
                if answering := self._asked[who][1]:
                    answering.cancel()
            # Nobody tells a sendfile that its socket is closed: it must have ended before.
            await asyncio.sleep(0)
            for who in idle:
                if who.transport is not None:
                    who.transport.abort()


class VisitorPages(_Site):
    """The page that a QR code opens. Port 0 is any; read it back once entered."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__("visitor", VISITOR_POLICY, host, port)


class OperatorPages(_Site):
    """The operator's page, on loopback, and its data for whoever has the token, as `Authorization: Bearer`.

    Each answer calls `state`; `compromise` has a robot of this address run an attack of this name, or raises Unknown.
    `rotate` makes a new code, or says that it is too soon; `watch` tells all that draws the swarm, until its result is
    called.
    `hold` stops all robots, or lets them go again, in whatever thread this is served; all else is done in the event
    loop in which this is made.
    """

    port_option = "--operator-port"

    def __init__(
        self,
        token: str,
        state: Callable[[], dict[str, Any]],
        compromise: Callable[[str, str], None],
        desk: MissionDesk | None = None,
        hold: Callable[[bool], None] = lambda _: None,
        rotate: Callable[[], Coroutine[Any, Any, bool]] | None = None,
        watch: Callable[[Callable[[dict[str, Any]], None]], Callable[[], None]] = lambda _: lambda: None,
        port: int = 0,
    ) -> None:
        self._gateways = asyncio.get_running_loop()
        self._hold = hold
        self._token = token
        self._state = state
        self._compromise = compromise
        self._desk = desk
        self._rotate = rotate
        self._watch = watch
        # As JSON a text may be twice as long as it is.
        super().__init__("operator", OPERATOR_POLICY, LOOPBACK, port, 2 * TEXT_MAX_BYTES + 1024 if desk else 4096)

    def _add_routes(self) -> None:
        self.app.router.add_get("/healthz", self._tell_health)
        self.app.router.add_get("/api/state", self._tell_state)
        self.app.router.add_post("/api/compromise", self._do_compromise)
        self.app.router.add_get("/api/frames", self._tell_frames)
        if self._rotate:
            self.app.router.add_post("/api/rotate", self._do_rotate)
        self.app.router.add_post("/api/stop", self._do_stop)
        self.app.router.add_post("/api/go", self._do_go)
        if self._desk:
            self.app.router.add_get("/api/mission/world", self._tell_world)
            self.app.router.add_get("/api/mission/job", self._tell_job)
            for name, act in (("read", self._read), ("compile", self._compile), ("send", self._send)):
                self.app.router.add_post(f"/api/mission/{name}", self._asked_with(act))

    def refuse(self, request: web.Request) -> web.Response | None:
        """Refuse a host name that is not ours: a foreign page that rebinds its name to loopback sends its own."""
        name = request.host.rsplit(":", 1)[0]
        if name not in (LOOPBACK, "localhost"):
            return web.json_response({"error": "this page is for this machine only"}, status=403)
        return None

    async def _tell_state(self, request: web.Request) -> web.Response:
        return self._stranger(request) or _answer(await self._at_the_gateway(_soon(self._state)))

    async def _tell_health(self, _: web.Request) -> web.Response:
        """For whoever watches over the gateway; without a token, for it tells nothing else."""
        turns = connected = False
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HEALTHY_S):
                connected = (await self._at_the_gateway(_soon(self._state)))["broker"]["connected"]
                turns = True
        return _answer({"turns": turns, "broker": connected}, 200 if connected else 503)

    async def _tell_frames(self, request: web.Request) -> web.StreamResponse:
        """What draws the swarm, a JSON object a line, until somebody hangs up; the page then asks again."""
        if stranger := self._stranger(request):
            return stranger
        lines: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def put(words: dict[str, Any]) -> None:
            # Whoever reads too slowly begins anew: the robots of a minute ago are no use.
            if lines.qsize() <= FRAMES_WAITING:
                lines.put_nowait(words if lines.qsize() < FRAMES_WAITING else None)

        response = web.StreamResponse(headers=COMMON_HEADERS | {"Content-Type": "application/x-ndjson"})
        end = await self._at_the_gateway(_soon(lambda: self._watch(lambda words: _soon_at(loop, put, words))))
        try:
            await response.prepare(request)
            while (words := await lines.get()) is not None:
                await response.write(json.dumps(words).encode() + b"\n")
        finally:
            _soon_at(self._gateways, end)
        return response

    async def _do_rotate(self, request: web.Request) -> web.Response:
        assert self._rotate is not None, "or there is no such route"
        if stranger := self._stranger(request):
            return stranger
        if await self._at_the_gateway(self._rotate()):
            return _answer({})
        return _answer({"error": "the code has just changed; the one before it has to end first"}, 409)

    async def _do_stop(self, request: web.Request) -> web.Response:
        return self._stranger(request) or self._told(True)

    async def _do_go(self, request: web.Request) -> web.Response:
        return self._stranger(request) or self._told(False)

    def _told(self, held: bool) -> web.Response:
        self._hold(held)
        return _answer({})

    async def _at_the_gateway(self, job: Coroutine[Any, Any, Told]) -> Told:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, self._gateways))

    async def _do_compromise(self, request: web.Request) -> web.Response:
        if stranger := self._stranger(request):
            return stranger
        try:
            words = json.loads(await request.text())
            address, attack = words["address"], words["attack"]
            await self._at_the_gateway(_soon(lambda: self._compromise(str(address), str(attack))))
        except Unknown as error:
            return _answer({"error": str(error)}, 404)
        except (ValueError, KeyError, TypeError, RecursionError):
            return _answer({"error": "an object with 'address' and 'attack'"}, 400)
        return _answer({})

    async def _tell_world(self, request: web.Request) -> web.Response:
        assert self._desk is not None, "or there is no such route"
        return self._stranger(request) or _answer(await self._at_the_gateway(self._desk.world()))

    async def _tell_job(self, request: web.Request) -> web.Response:
        assert self._desk is not None, "or there is no such route"
        return self._stranger(request) or _answer(await self._at_the_gateway(_soon(self._desk.job)))

    def _asked_with(self, act: Callable[[MissionDesk, Any], Coroutine[Any, Any, dict[str, Any]]]) -> Handler:
        """A handler of POSTs: what went wrong is told in a line, with a hint of what to do about it."""

        async def handle(request: web.Request) -> web.Response:
            assert self._desk is not None, "or there is no such route"
            if stranger := self._stranger(request):
                return stranger
            try:
                words = json.loads(await request.text())
                return _answer(await self._at_the_gateway(act(self._desk, words)))
            except (UsageError, Unavailable) as error:
                return _answer({"error": str(error), "hint": error.hint}, 400)
            except PeerError as error:
                return _answer({"error": str(error), "hint": ""}, 409)
            except (ValueError, KeyError, TypeError, RecursionError):
                return _answer({"error": "that is not what this page asks", "hint": "reload the page"}, 400)

        return handle

    @staticmethod
    async def _read(desk: MissionDesk, words: Any) -> dict[str, Any]:
        return await desk.read(_text(words, "mission"))

    @staticmethod
    async def _compile(desk: MissionDesk, words: Any) -> dict[str, Any]:
        desk.compile(_text(words, "mission"), parse_profile(words["profile"]))
        return {}

    @staticmethod
    async def _send(desk: MissionDesk, words: Any) -> dict[str, Any]:
        desk.send(_text(words, "id"))
        return {}

    def _stranger(self, request: web.Request) -> web.Response | None:
        """An answer for whoever has not the token, or comes from another page.

        No cookie carries the token, so that no page but ours can send it; the origin is a second lock.
        """
        given = request.headers.get("Authorization", "").encode(errors="replace")
        if not hmac.compare_digest(given, f"Bearer {self._token}".encode()):
            return _answer({"error": "open the operator link that the gateway printed"}, 401)
        if request.headers.get("Origin", f"http://{request.host}") != f"http://{request.host}":
            return _answer({"error": "not from this page"}, 403)
        return None


def _soon_at(loop: asyncio.AbstractEventLoop, job: Callable[..., None], *words: Any) -> None:
    with contextlib.suppress(RuntimeError):  # it has ended
        loop.call_soon_threadsafe(job, *words)


async def _soon(job: Callable[[], Told]) -> Told:
    return job()


@contextlib.asynccontextmanager
async def beside(pages: Site) -> AsyncIterator[Site]:
    """A page, served by an event loop in a thread of its own while the context lasts."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="pages", daemon=True)
    thread.start()

    async def there(job: Coroutine[Any, Any, Any]) -> None:
        await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, loop))

    try:
        await there(pages.__aenter__())
        try:
            yield pages
        finally:
            await there(pages.__aexit__(None, None, None))
    finally:
        loop.call_soon_threadsafe(loop.stop)
        await asyncio.to_thread(thread.join)
        loop.close()


def _text(words: Any, key: str) -> str:
    text = words[key]
    if not isinstance(text, str):
        raise TypeError(key)
    return text


def _answer(words: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(
        text=json.dumps(words), status=status, content_type="application/json", headers={"Cache-Control": "no-store"}
    )
