"""Run the parts of `phalanx up`: a swarm, the front end, sessions, the pages, and a broker if requested."""

from __future__ import annotations

import contextlib
import logging
import secrets
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from phalanx.config import LinkConfig
from phalanx.config.front import FrontConfig
from phalanx.config.session import Assign, SessionConfig
from phalanx.crypto.jwe import encode_base64url
from phalanx.errors import UsageError
from phalanx.link.session.secret import hello_topic
from phalanx.net import Login
from phalanx.net.broker import RunningBroker, open_broker
from phalanx.net.broker_url import on_host
from phalanx.net.front import Front
from phalanx.net.ports import EVERYWHERE, LOOPBACK, free_port, lan_address, retry_while_port_taken
from phalanx.net.seats import raise_file_limit
from phalanx.net.session_broker import SessionBroker
from phalanx.net.session_store import LinkKeys
from phalanx.net.site import serve_in_thread
from phalanx.robot import Swarm
from phalanx.robot.on_mission import OnMission
from phalanx.wire.sessions import LINK_PATH

from .at_broker import BrokerStatus
from .missions.desk import MissionDesk, requests_of
from .projector import Wifi
from .running import Running
from .serve_pages import PAGE_POLICY, PAGES, OperatorPages
from .serving import for_at_most, until_connected
from .session_link import EventSink, SessionLink
from .shared_code import SharedCode
from .shields import check_revivable
from .state_folder import StoredState, open_state

log = logging.getLogger(__name__)

DEFAULT_PORT = 8080
MANY_FILES = 16_384
RESUME_S = 8 * 3600
RESUME_PLAIN_S = 3600  # shorter on plain http: another machine may get this address later


@dataclass(frozen=True, slots=True, kw_only=True)
class UpOptions:
    """Options of a gateway. Raises: UsageError: incompatible options."""

    host: str = LOOPBACK  # address to listen on for visitors; 0.0.0.0: all interfaces
    port: int | None = None  # of the visitors' page and its websocket; None for 8080 or any free one, 0 for any
    # Address of the visitors' page, if it is not this machine's, such as that of an https proxy.
    page_url: str = ""
    tls: tuple[Path, Path] | None = None  # certificate and key, to serve https
    behind_proxy: bool = False  # take visitors' addresses from X-Forwarded-For
    assign: Assign = "free"  # who drives which robot
    turn_s: float = 120.0  # length of a turn with one-each, while others wait
    state: Path | None = None  # folder of visitors, tickets and the trail; None: in memory
    state_is_optional: bool = False  # keep state in memory if that folder is unavailable
    wifi: Wifi | None = None  # network that phones join first
    operator_port: int = 0  # of the operator's page; 0 for any free one
    operator_token: str = field(default="", repr=False)  # of the operator's page; "" for a new one
    stop_file: Path | None = None  # exists while all robots are stopped: a restart keeps them stopped
    revive_s: float | None = None  # restart stopped simulated robots after this time
    duration_s: float | None = None  # end after this time
    # --- a broker ---
    broker: str = ""  # for visitors who cannot reach this machine: mosquitto or a URL
    broker_ws: str = ""  # websocket URL of an external broker, if not at the next port
    login: Login | None = None  # for an external broker
    wait_s: float = 30.0  # for the broker
    qrkey: bool = False  # also serve published pages and programs there
    frontend: str = ""  # published page to which the code leads, instead of ours
    link: LinkConfig = field(default_factory=LinkConfig)  # the parameters of mode qrkey; root: of sessions as well

    def __post_init__(self) -> None:
        for page in (self.frontend, self.page_url):
            if page and (urlsplit(page).scheme not in ("http", "https") or urlsplit(page).fragment):
                raise UsageError(f"{page!r} is not a page", "use an http:// or https:// URL without a fragment")
        if self.port and self.port == self.operator_port:
            raise UsageError(f"port {self.port} for both pages", "use different ones for --port and --operator-port")
        if self.qrkey and not self.broker:
            raise UsageError("--qrkey without a broker", "add --broker URL, or --broker mosquitto")
        if self.qrkey and self.assign != "free":
            raise UsageError(f"--assign {self.assign} with --qrkey", "leave one out: its visitors are anonymous")

    def session_config(self, broker: str = "") -> SessionConfig:
        """Return the parameters of sessions, with a broker's URL for visitors if there is one."""
        is_safe = self.tls is not None or urlsplit(self.page_url).scheme == "https"
        return SessionConfig(
            root=self.link.root if broker else "",
            broker=broker,
            assign=self.assign,
            turn_ms=round(self.turn_s * 1000),
            resume_s=RESUME_S if is_safe else RESUME_PLAIN_S,
        )

    def page_at(self, port: int) -> str:
        """Return the address of the visitors' page, given its port."""
        if self.page_url:
            return self.page_url
        return self._at(self.advertised, port)

    def link_at(self, port: int) -> str:
        """Return the websocket's address for a page on this machine: without the proxy, unless with a certificate."""
        here = LOOPBACK if self.host in EVERYWHERE else self.host
        page = self.page_at(port) if self.tls else self._at(here, port)
        return f"ws{page.removeprefix('http').rstrip('/')}{LINK_PATH}"

    def _at(self, host: str, port: int) -> str:
        return f"http{'s' if self.tls else ''}://{f'[{host}]' if ':' in host else host}:{port}/"

    @property
    def unreachable(self) -> str:
        """Return why phones cannot reach this machine although they should; "" if they can."""
        if self.page_url or self.broker or self.host not in EVERYWHERE or self.advertised != LOOPBACK:
            return ""
        return "This machine has no network connection: phones cannot reach it."

    @property
    def advertised(self) -> str:
        """Return this machine's address for visitors."""
        return lan_address() if self.host in EVERYWHERE else self.host


async def up(
    options: UpOptions,
    say: EventSink,
    started: Callable[[Running], None] = lambda _: None,
    *,
    swarm: Callable[[], Swarm],
) -> None:
    """Run a gateway until cancelled, or for the duration in the options.

    `say` receives every event: perhaps "waiting", then "ready", then others, such as "held" and "released". `started`
    receives the gateway before it waits for a broker, so that robots can be stopped. `swarm` is called after all
    checks.

    Raises: UsageError, Unavailable: an invalid option, a port or folder in use, a broker that refuses us.
    """
    token = options.operator_token or secrets.token_hex(16)
    raise_file_limit(MANY_FILES)
    async with contextlib.AsyncExitStack() as stack:
        kept: StoredState = stack.enter_context(open_state(options.state, is_optional=options.state_is_optional))
        front = await _front(options, stack, kept.keys)
        page_url = options.page_at(front.port)
        shared: SharedCode | None = None
        sessions: SessionBroker | None = None
        at: BrokerStatus | None = None
        config = options.session_config()
        if options.broker:
            broker = await stack.enter_async_context(_broker(options))
            for_visitors = on_host(broker.websocket, options.advertised)
            config = options.session_config(for_visitors)
            knocks = hello_topic(kept.keys.static.public_key())
            sessions = SessionBroker(broker.url, config.root, knocks, config.max_to_server_bytes)
            at = BrokerStatus(broker, sessions, options.frontend or page_url, for_visitors)
            shared = SharedCode(options, broker, for_visitors, page_url) if options.qrkey else None
        robots = swarm()
        if options.revive_s is not None:
            try:
                check_revivable(robots)
            except UsageError as error:
                raise UsageError(f"--revive: {error}", error.hint) from error
        link = SessionLink(
            front,
            kept.store,
            kept.keys,
            lambda: [robot.address for robot in robots.robots()],
            kept.trail,
            config,
            broker=sessions,
        )
        link_url, static = options.link_at(front.port), kept.keys.static
        running = Running(options, page_url, link_url, link, robots, say, shared, at, static=static)
        if running.was_held:
            log.warning("all robots stay stopped, as before this start; hint: go and Enter, or the operator's page")
        desk = MissionDesk(robots) if isinstance(robots, OnMission) else None
        if desk:
            stack.callback(desk.stop)
        # Before the page with the button: a stop must not wait for the broker.
        stack.enter_context(running.gateway.brakes)
        if desk:
            running.desk.slow |= requests_of(desk)
        operators = OperatorPages(token, running, options.operator_port)
        operator = await stack.enter_async_context(serve_in_thread(operators))
        operator_url = f"http://{LOOPBACK}:{operator.port}/#token={token}"
        stack.enter_context(kept.publish_operator_url(operator_url))
        started(running)
        for server in (sessions, shared.server if shared else None):
            if server:
                await stack.enter_async_context(server)
                await until_connected(server, say, options.wait_s)
        stack.push_async_callback(link.close)
        async with for_at_most(options.duration_s):
            say(running.ready(operator_url))
            if running.gateway.brakes.held:
                say({"event": "held"})
            await running.run()


def _broker(options: UpOptions) -> AbstractAsyncContextManager[RunningBroker]:
    """Start our own broker, or use an external one. Raises, when entered: UsageError, Unavailable."""
    host = LOOPBACK if options.host == "localhost" else options.host
    return open_broker(options.broker, login=options.login, websocket=options.broker_ws, ws_host=host)


async def _front(options: UpOptions, stack: contextlib.AsyncExitStack, keys: LinkKeys) -> Front:
    """Start the front end. Raises: PortTaken, Unavailable."""
    preferred = DEFAULT_PORT if options.operator_port != DEFAULT_PORT else 0

    async def start() -> Front:
        port = free_port(preferred, options.host) if options.port is None else options.port
        pages = PAGES / "visitor"
        front = Front(
            pages,
            PAGE_POLICY,
            options.host,
            port,
            FrontConfig(),
            options.tls,
            options.behind_proxy,
            encode_base64url(keys.static.public_key().public_bytes_raw()).decode(),
            PAGES / "operator",
        )
        return await stack.enter_async_context(front)

    return await (retry_while_port_taken(start) if options.port is None else start())
