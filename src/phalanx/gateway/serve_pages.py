"""The operator's page on this machine: its stop, and tickets for the link, for whoever has the token.

The stop waits neither for a transport nor for the gateway's event loop. All else the page does as a client of the link,
as on a tablet, where the front end serves it.
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
UPDATES_WAITING = 100  # of a projector; then it begins anew
REQUEST_BYTES = 32 * 1024  # of a mission, as JSON
HEALTHY_S, HEALTH_FOR_S = 1.0, 0.2  # within which a gateway that is well answers itself; for how long that is true

Told = TypeVar("Told")

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; connect-src 'self'"
)
VIEW_POLICY = _POLICY
# They reach the gateway by websocket or by a broker, wherever it is; 'self' has the swarm's key.
PAGE_POLICY = f"{_POLICY} ws: wss:"


def pages_are_built(*pages: str) -> bool:
    """Whether these pages, or those of a gateway, were built from web/ (they are not in git)."""
    return all((PAGES / page / "index.html").is_file() for page in pages or ("visitor", "operator"))


class OperatorPages(Site):
    """The operator's page, on loopback, and its requests for whoever has the token, as `Authorization: Bearer`.

    `hold` of what is `running` is called in whatever thread this is served; all else in the event loop in which this is
    made.
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
        """For whoever watches over the gateway; without a token, for it tells nothing else."""
        if _is_foreign(request):
            return _answer({"error": "not from this page"}, 403)
        # However many ask: the loop that drives robots is asked one question at a time, and a few in a second.
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
        """Answer what the projector shows beside the swarm."""
        return self._stranger(request) or _answer(await self._at_the_gateway(_soon(self._running.projector.state)))

    async def _tell_frames(self, request: web.Request) -> web.StreamResponse:
        """Send state updates of the swarm, a JSON object a line, until the projector hangs up; it then asks again."""
        if stranger := self._stranger(request):
            return stranger
        lines: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def put(words: dict[str, Any]) -> None:
            # Whoever reads too slowly begins anew: the robots of a minute ago are no use.
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
        """Answer an operator's request (docs/spec/vocabulary.md#over-a-session), or say in a line what is wrong."""
        if stranger := self._stranger(request):
            return stranger
        try:
            words = json.loads(await request.read())  # JSON is UTF-8, whatever charset is said
            return _answer(await self._at_the_gateway(self._running.desk.ask(request.match_info["request"], words)))
        except (UsageError, Unavailable) as error:
            return _answer({"error": str(error), "hint": error.hint}, 400)
        except PeerError as error:
            return _answer({"error": str(error), "hint": ""}, 409)
        except (ValueError, RecursionError):
            return _answer({"error": "that is not what this page asks", "hint": "reload the page"}, 400)

    async def _do_hold(self, request: web.Request) -> web.Response:
        if stranger := self._stranger(request):
            return stranger
        self._running.hold(request.path == "/api/stop")
        return _answer({})

    async def _at_the_gateway(self, job: Coroutine[Any, Any, Told]) -> Told:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, self._gateways))

    def _stranger(self, request: web.Request) -> web.Response | None:
        """Return a refusal for whoever has not the token, which no cookie carries, or comes from another page."""
        given = request.headers.get("Authorization", "").encode(errors="replace")
        # The projector's token opens what the projector shows, and nothing else.
        token = self._running.projector.token if request.path.startswith("/api/projector") else self._token
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


def _answer(words: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(
        text=json.dumps(words), status=status, content_type="application/json", headers={"Cache-Control": "no-store"}
    )
