"""The two pages over HTTP. The visitors' page is plain files and knows no secret; the operator's asks for a token.

Only `OperatorPages` may answer with a pin, and it listens on loopback only.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from aiohttp import web

from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.net.site import COMMON_HEADERS, Handler, Site

from .missions.desk import TEXT_MAX_BYTES, MissionDesk, parse_profile

if TYPE_CHECKING:
    from .projector import Projector
    from .running import Running

PAGES = Path(__file__).parent / "pages"
OPERATORS = 200  # connections
FRAMES_WAITING = 100
HEALTHY_S, HEALTH_FOR_S = 1.0, 0.2  # within which a gateway that is well answers itself; for how long that is true

Told = TypeVar("Told")

_BASE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Visitors reach the gateway by websocket, and in mode qrkey a broker, wherever it is; 'self' has the swarm's key.
VISITOR_POLICY = f"{_BASE_POLICY}; img-src 'self' data:; connect-src 'self' ws: wss:"
OPERATOR_POLICY = f"{_BASE_POLICY}; img-src 'self' data: blob:; connect-src 'self'"


def pages_are_built(*pages: str) -> bool:
    """Whether these pages, or those of a gateway, were built from web/ (they are not in git)."""
    return all((PAGES / page / "index.html").is_file() for page in pages or ("visitor", "operator"))


class OperatorPages(Site):
    """The operator's page, on loopback, and its data for whoever has the token, as `Authorization: Bearer`.

    `hold` of what is `running` is called in whatever thread this is served; all else in the event loop in which this is
    made.
    """

    port_option = "--operator-port"

    def __init__(
        self,
        token: str,
        running: Running,
        desk: MissionDesk | None = None,
        port: int = 0,
        projector: Projector | None = None,
    ) -> None:
        self._gateways = asyncio.get_running_loop()
        self._token = token
        self._running = running
        self._projector = projector
        self._desk = desk
        self._asking: asyncio.Future[bool] | None = None
        self._asked_at_s = 0.0
        # As JSON a text may be twice as long as it is.
        longest = 2 * TEXT_MAX_BYTES + 1024 if desk else 4096
        super().__init__(PAGES / "operator", OPERATOR_POLICY, port, connections=OPERATORS, longest=longest)

    def _add_routes(self) -> None:
        routes = self.app.router
        routes.add_get("/healthz", self._tell_health)
        routes.add_get("/api/state", self._told(lambda: _soon(self._running.state)))
        routes.add_get("/api/frames", self._tell_frames)
        if projector := self._projector:
            routes.add_get("/projector", self._show_projector)
            routes.add_get("/api/projector/frames", self._tell_frames)
            routes.add_get("/api/projector", self._told(lambda: _soon(projector.state)))
        routes.add_post("/api/compromise", self._asked_with(self._do_compromise, refused=404))
        routes.add_post("/api/stop", self._do_hold)
        routes.add_post("/api/go", self._do_hold)
        routes.add_post("/api/rotate", self._do_rotate)
        routes.add_post("/api/link/{request}", self._do_with_visitors)
        if desk := self._desk:
            routes.add_get("/api/mission/world", self._told(desk.world))
            routes.add_get("/api/mission/job", self._told(lambda: _soon(desk.job)))
            routes.add_post("/api/mission/read", self._asked_with(lambda words: desk.read(_text(words, "mission"))))
            routes.add_post("/api/mission/compile", self._asked_with(self._do_compile))
            routes.add_post(
                "/api/mission/send", self._asked_with(lambda words: _soon(lambda: desk.send(_text(words, "id"))))
            )

    def _told(self, tell: Callable[[], Coroutine[Any, Any, dict[str, Any]]]) -> Handler:
        """Return a handler of GETs, answered by the gateway."""

        async def handle(request: web.Request) -> web.Response:
            return self._stranger(request) or _answer(await self._at_the_gateway(tell()))

        return handle

    def _asked_with(
        self, act: Callable[[Any], Coroutine[Any, Any, dict[str, Any] | None]], *, refused: int = 409
    ) -> Handler:
        """Return a handler of POSTs: it says in a line what went wrong, with a hint of what to do about it."""

        async def handle(request: web.Request) -> web.Response:
            if stranger := self._stranger(request):
                return stranger
            try:
                words = json.loads(await request.read())  # JSON is UTF-8, whatever charset is said
                done = await self._at_the_gateway(act(words))
                return _answer(done or {})
            except (UsageError, Unavailable) as error:
                return _answer({"error": str(error), "hint": error.hint}, 400)
            except PeerError as error:
                return _answer({"error": str(error), "hint": ""}, refused)
            except (ValueError, KeyError, TypeError, RecursionError):
                return _answer({"error": "that is not what this page asks", "hint": "reload the page"}, 400)

        return handle

    async def _show_projector(self, _: web.Request) -> web.StreamResponse:
        page = PAGES / "operator" / "projector.html"
        return web.FileResponse(page) if page.is_file() else web.Response(status=503, text="The page is not built.\n")

    async def _tell_health(self, request: web.Request) -> web.Response:
        """For whoever watches over the gateway; without a token, for it tells nothing else."""
        if _is_foreign(request):
            return _answer({"error": "not from this page"}, 403)
        # However many ask: the loop that drives robots is asked one question at a time, and a few in a second.
        now_s = time.monotonic()
        if self._asking is None or (self._asking.done() and now_s - self._asked_at_s >= HEALTH_FOR_S):
            self._asking = asyncio.ensure_future(self._at_the_gateway(_soon(lambda: self._running.connected)))
            self._asked_at_s = now_s
        turns = connected = False
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HEALTHY_S):
                connected = await asyncio.shield(self._asking)
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
        watch = self._running.gateway.watch
        end = await self._at_the_gateway(_soon(lambda: watch(lambda words: _soon_at(loop, put, words))))
        try:
            await response.prepare(request)
            while (words := await lines.get()) is not None:
                await response.write(json.dumps(words).encode() + b"\n")
        finally:
            _soon_at(self._gateways, end)
        return response

    async def _do_with_visitors(self, request: web.Request) -> web.StreamResponse:
        """Do what operators do with visitors, invitations and robots (docs/spec/vocabulary.md#over-a-session)."""
        name = request.match_info["request"]

        async def act(words: Any) -> dict[str, Any]:
            return self._running.desk.do(name, words)

        return await self._asked_with(act)(request)

    async def _do_rotate(self, request: web.Request) -> web.Response:
        if stranger := self._stranger(request):
            return stranger
        if await self._at_the_gateway(self._running.rotate()):
            return _answer({})
        return _answer({"error": "the code has just changed; the one before it has to end first"}, 409)

    async def _do_hold(self, request: web.Request) -> web.Response:
        if stranger := self._stranger(request):
            return stranger
        self._running.hold(request.path == "/api/stop")
        return _answer({})

    async def _at_the_gateway(self, job: Coroutine[Any, Any, Told]) -> Told:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, self._gateways))

    async def _do_compromise(self, words: Any) -> None:
        self._running.compromise(str(words["address"]), str(words["attack"]))

    async def _do_compile(self, words: Any) -> None:
        assert self._desk is not None, "or there is no such route"
        self._desk.compile(_text(words, "mission"), parse_profile(words["profile"]))

    def _stranger(self, request: web.Request) -> web.Response | None:
        """Return a refusal for whoever has not the token, which no cookie carries, or comes from another page."""
        given = request.headers.get("Authorization", "").encode(errors="replace")
        # The projector's token opens what the projector shows, and nothing else.
        is_shown = self._projector is not None and request.path.startswith("/api/projector")
        token = self._projector.token if self._projector and is_shown else self._token
        if not hmac.compare_digest(given, f"Bearer {token}".encode()):
            return _answer({"error": "open the operator link that the gateway printed"}, 401)
        if _is_foreign(request):
            return _answer({"error": "not from this page"}, 403)
        self.know(request)
        return None


def _is_foreign(request: web.Request) -> bool:
    """Whether a page of somebody else's asks; an image or a script of such a page, which names no origin, too."""
    own = f"http://{request.host}"
    site = request.headers.get("Sec-Fetch-Site", "same-origin")
    return request.headers.get("Origin", own) != own or site not in ("same-origin", "none")


def _soon_at(loop: asyncio.AbstractEventLoop, job: Callable[..., None], *words: Any) -> None:
    with contextlib.suppress(RuntimeError):  # it has ended
        loop.call_soon_threadsafe(job, *words)


async def _soon(job: Callable[[], Told]) -> Told:
    return job()


def _text(words: Any, key: str) -> str:
    text = words[key]
    if not isinstance(text, str):
        raise TypeError(key)
    return text


def _answer(words: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(
        text=json.dumps(words), status=status, content_type="application/json", headers={"Cache-Control": "no-store"}
    )
