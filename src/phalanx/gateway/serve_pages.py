"""The operator's page on this machine: the emergency stop and requests, for clients with the token.

The stop waits neither for a transport nor for the gateway's event loop. For everything else the page is a client of
the link, as on a tablet.
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
from phalanx.net.site import COMMON_HEADERS, Site

if TYPE_CHECKING:
    from .running import Running

PAGES = Path(__file__).parent / "pages"
OPERATORS = 200  # connections
UPDATES_WAITING = 100  # for a projector; beyond, its stream is restarted
REQUEST_BYTES = 32 * 1024  # for a mission as JSON
HEALTHY_S, HEALTH_FOR_S = 1.0, 0.2  # time limit of a healthy gateway; how long an answer is reused

Told = TypeVar("Told")

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; connect-src 'self'"
)
VIEW_POLICY = _POLICY
# Pages connect to the gateway's websocket or to any broker; 'self' serves the swarm's key.
PAGE_POLICY = f"{_POLICY} ws: wss:"


def pages_are_built(*pages: str) -> bool:
    """Return whether these pages, or those of a gateway, were built from web/ (they are not in git)."""
    return all((PAGES / page / "index.html").is_file() for page in pages or ("visitor", "operator"))


class OperatorPages(Site):
    """The operator's page on loopback, and its requests, authorised by the token as `Authorization: Bearer`.

    `running.hold` is called in the thread that serves the page; everything else in the event loop of the constructor.
    """

    port_option = "--operator-port"

    def __init__(self, token: str, running: Running, port: int = 0) -> None:
        self._gateways = asyncio.get_running_loop()
        self._token = token
        self._running = running
        self._asking: asyncio.Future[dict[str, Any]] | None = None
        self._asked_at_s = 0.0
        super().__init__(PAGES / "operator", PAGE_POLICY, port, connections=OPERATORS, longest=REQUEST_BYTES)

    def _add_routes(self) -> None:
        routes = self.app.router
        routes.add_get("/healthz", self._tell_health)
        routes.add_get("/projector", self._show_projector)
        routes.add_get("/api/projector", self._tell_projector)
        routes.add_get("/api/projector/frames", self._tell_frames)
        routes.add_post("/api/stop", self._do_hold)
        routes.add_post("/api/go", self._do_hold)
        routes.add_post("/api/link/{request}", self._do_ask)

    async def _show_projector(self, _: web.Request) -> web.StreamResponse:
        page = PAGES / "operator" / "projector.html"
        return web.FileResponse(page) if page.is_file() else web.Response(status=503, text="The page is not built.\n")

    async def _tell_health(self, request: web.Request) -> web.Response:
        """Answer a health check. It needs no token, as it reveals nothing else."""
        if _is_foreign(request):
            return _answer({"error": "not from this page"}, 403)
        # Limited to one query of the gateway's loop at a time and a few per second, however many clients ask.
        now_s = time.monotonic()
        if self._asking is None or (self._asking.done() and now_s - self._asked_at_s >= HEALTH_FOR_S):
            self._asking = asyncio.ensure_future(self._at_the_gateway(_soon(self._running.health)))
            self._asked_at_s = now_s
        told: dict[str, Any] = {"turns": False, "broker": False, "shields": "not working"}
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HEALTHY_S):
                told = {"turns": True, **await asyncio.shield(self._asking)}
        is_well = told["broker"] and told["shields"] != "not working"
        return _answer(told, 200 if is_well else 503)

    async def _tell_projector(self, request: web.Request) -> web.Response:
        """Answer the data of the projector's page, except the swarm's state."""
        return self._refusal(request) or _answer(await self._at_the_gateway(_soon(self._running.projector.state)))

    async def _tell_frames(self, request: web.Request) -> web.StreamResponse:
        """Stream updates of the swarm, one JSON object per line, until the projector disconnects or lags behind."""
        if refusal := self._refusal(request):
            return refusal
        lines: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def put(words: dict[str, Any]) -> None:
            # The stream of a slow reader ends: it reconnects, as old updates are useless.
            if lines.qsize() <= UPDATES_WAITING:
                lines.put_nowait(words if lines.qsize() < UPDATES_WAITING else None)

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

    async def _do_ask(self, request: web.Request) -> web.StreamResponse:
        """Answer an operator's request (docs/spec/vocabulary.md#over-a-session), or an error in one line."""
        if refusal := self._refusal(request):
            return refusal
        try:
            words = json.loads(await request.read())  # JSON is UTF-8, whatever charset the header names
            return _answer(await self._at_the_gateway(self._running.desk.ask(request.match_info["request"], words)))
        except (UsageError, Unavailable) as error:
            return _answer({"error": str(error), "hint": error.hint}, 400)
        except PeerError as error:
            return _answer({"error": str(error), "hint": ""}, 409)
        except (ValueError, RecursionError):
            return _answer({"error": "invalid request", "hint": "reload the page"}, 400)

    async def _do_hold(self, request: web.Request) -> web.Response:
        if refusal := self._refusal(request):
            return refusal
        self._running.hold(request.path == "/api/stop")
        return _answer({})

    async def _at_the_gateway(self, job: Coroutine[Any, Any, Told]) -> Told:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, self._gateways))

    def _refusal(self, request: web.Request) -> web.Response | None:
        """Return a refusal if the token is wrong (no cookie carries it), or if another page sent the request."""
        given = request.headers.get("Authorization", "").encode(errors="replace")
        # The projector's token is valid for the projector's data only.
        token = self._running.projector.token if request.path.startswith("/api/projector") else self._token
        if not hmac.compare_digest(given, f"Bearer {token}".encode()):
            return _answer({"error": "open the operator link that the gateway printed"}, 401)
        if _is_foreign(request):
            return _answer({"error": "not from this page"}, 403)
        self.know(request)
        return None


def _is_foreign(request: web.Request) -> bool:
    """Return whether another site's page sent the request, also as an image or script without an origin."""
    own = f"http://{request.host}"
    site = request.headers.get("Sec-Fetch-Site", "same-origin")
    return request.headers.get("Origin", own) != own or site not in ("same-origin", "none")


def _soon_at(loop: asyncio.AbstractEventLoop, job: Callable[..., None], *words: Any) -> None:
    with contextlib.suppress(RuntimeError):  # the loop has ended
        loop.call_soon_threadsafe(job, *words)


async def _soon(job: Callable[[], Told]) -> Told:
    return job()


def _answer(words: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(
        text=json.dumps(words), status=status, content_type="application/json", headers={"Cache-Control": "no-store"}
    )
