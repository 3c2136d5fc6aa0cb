"""Everything that `phalanx up` runs: a broker, a swarm, the link, the pages."""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import secrets
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import segno

from phalanx.config import LinkConfig
from phalanx.errors import Unknown, UsageError
from phalanx.io import Login, Server, parse_broker_url
from phalanx.io.broker import RunningBroker, open_broker
from phalanx.io.broker_url import on_host
from phalanx.io.phones import PhonesDoor, no_way_from, warn_if_phones_are_locked_out
from phalanx.io.ports import EVERYWHERE, LOOPBACK, at_a_free_port, free_port, lan_address
from phalanx.io.seats import allow_files
from phalanx.io.server import Happening
from phalanx.io.site import beside
from phalanx.link import Request
from phalanx.link.messages import Rejected
from phalanx.robot import Swarm
from phalanx.robot.on_mission import OnMission
from phalanx.robot.swarm import Stepped

from . import vocabulary
from .brakes import KeptStop
from .gateway import Gateway
from .missions.desk import MissionDesk
from .serve_pages import OperatorPages, visitors_page
from .serving import for_at_most, tell_event, until_connected

log = logging.getLogger(__name__)

DEFAULT_PORT = 8080
WORLD_HZ = 50
MANY_FILES = 16_384
REPORT_S = 1.0
ASK_FOR_PHONES_S = 20.0

Say = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class UpOptions:
    """What to run. Raises: UsageError: a page is none, or both have one port."""

    broker: str = "auto"  # auto, mosquitto, amqtt or a URL
    broker_ws: str = ""  # websocket URL of a broker elsewhere, where it is not one port further
    login: Login | None = None  # for a broker elsewhere
    visitors_login: Login | None = None  # for phones there; every QR code has it
    host: str = LOOPBACK  # address to listen on for visitors; 0.0.0.0 for every one
    port: int | None = None  # of the visitors' page; None for 8080 or any free one, 0 for any
    # Where visitors find our page, if not at this machine's address: behind a proxy that speaks https, say.
    page_url: str = ""
    frontend: str = ""  # page of the published form to send visitors to, instead of ours
    wait_s: float = 30.0  # for the broker
    operator_port: int = 0  # of the operator's page; 0 for any free one
    operator_token: str = field(default="", repr=False)  # of the operator's page; "" for a new one
    stop_file: Path | None = None  # is there while the operator has stopped all robots: a restart does not free them
    duration_s: float | None = None  # end by itself after so long
    link: LinkConfig = field(default_factory=LinkConfig)  # the link's parameters

    def __post_init__(self) -> None:
        for page in (self.frontend, self.page_url):
            if page and (urlsplit(page).scheme not in ("http", "https") or urlsplit(page).fragment):
                raise UsageError(f"{page!r} is not a page", "an http:// or https:// URL without a fragment")
        if self.port and self.port == self.operator_port:
            raise UsageError(f"port {self.port} for both pages", "--port and --operator-port are two")


class Running:
    """A gateway that is up, as an operator sees it."""

    def __init__(
        self, options: UpOptions, broker: RunningBroker, page_url: str, server: Server, swarm: Swarm, say: Say
    ) -> None:
        self.page_url = page_url
        self.gateway = Gateway(swarm, server, say=say)
        self._options = options
        self._broker = broker
        self.server = server
        self._loop = asyncio.get_running_loop()
        self._say = say
        self._started_at_s = time.monotonic()
        self._told: Counter[str] = Counter()
        self._qr: tuple[str, str] = ("", "")
        self._door = PhonesDoor(server) if broker.name == "external" else None
        self._no_phone = self._blocked = no_way_from(options.frontend or page_url, server.broker_for_visitors)
        if self._blocked:
            log.warning("%s; hint: a wss:// one, with --broker URL --broker-ws", self._blocked)
        self._kept_stop = KeptStop(options.stop_file)
        if self._kept_stop.was_held():
            self.gateway.brakes.hold()
            log.warning("all robots stay stopped, as before this start; hint: go and Enter, or the operator's page")
        server.on_event = self._on_event

    @property
    def qr_url(self) -> str:
        """What the QR code says now."""
        qr = self.server.qr()
        return qr.for_foreign_page(self._options.frontend) if self._options.frontend else qr.for_page(self.page_url)

    def ready(self, operator_url: str) -> dict[str, Any]:
        """The first event."""
        return {
            "event": "ready",
            "page_url": self.page_url,
            "qr_url": self.qr_url,
            "pin": self.server.epoch.pin.digits,
            "topic": self.server.epoch.topic,
            "broker_host": self._broker.url.host,
            "broker_port": self._broker.url.port,
            "broker_ws_port": parse_broker_url(self._broker.websocket).port,
            "operator_url": operator_url,
        }

    def summary(self) -> dict[str, Any]:
        """The numbers of a status line."""
        return {
            "robots": len(self.gateway.swarm.robots()),
            "visitors": len(self.gateway.visitors.present(time.monotonic())),
            "commands": self._count("commands"),
            "refused": sum(self.server.rejected.values()),
            "rotates_in_s": self.server.rotates_in_s,
            "connected": self.server.connected,
            "held": self.gateway.brakes.held,
        }

    def state(self) -> dict[str, Any]:
        """Everything the operator's page shows. Has the pin in it."""
        now_s, uptime_s = time.time(), time.monotonic()
        config, server = self.server.config, self.server
        link = {vocabulary.Status.ACTIVE: "ok", vocabulary.Status.INACTIVE: "quiet", vocabulary.Status.LOST: "lost"}
        robots, here = self.gateway.swarm.robots(), self.gateway.visitors
        names = {robot.address: robot.name for robot in robots}
        return {
            "mode": "qrkey",
            "held": self.gateway.brakes.held,
            "page_url": self._options.frontend or self.page_url,
            "qr_url": self.qr_url,
            "qr_svg": self._qr_svg(),
            "rotates_in_s": round(server.rotates_in_s, 1),
            "rotate_s": config.rotate_s,
            "overlap_s": config.overlap_s,
            "overlapping": server.overlapping,
            "uptime_s": round(uptime_s - self._started_at_s, 1),
            "broker": {
                "name": self._broker.name,
                "url": str(self._broker.url),
                "connected": server.connected,
                "trouble": server.trouble,
                "phones": self._no_phone,
            },
            "visitors": [
                {"id": here.shown(v.client_id), "last_seen_s": round(uptime_s - v.seen_at_s, 1), "requests": v.requests}
                for v in here.present(uptime_s)
            ],
            "robots": [
                {
                    "address": robot.address,
                    "name": robot.name,
                    "status": int(vocabulary.status(robot, now_s)),
                    "mode": int(bool(robot.route)),
                    "battery_v": round(robot.battery_v, 3),
                    "last_seen_s": round(now_s - robot.heard_at_s, 1),
                    "rgb_led": vocabulary.tell_led(robot.led),
                    "link": link[vocabulary.status(robot, now_s)],
                    "drivers": self.gateway.drivers.of(robot.address, uptime_s),
                }
                for robot in robots
            ],
            "shields": self.gateway.shields.state(names.__getitem__) if self.gateway.shields else None,
            "unprotected": self.gateway.unprotected,
            "mission": self.gateway.missions.state() if self.gateway.missions else None,
            "counters": {key: self._count(key) for key in ("commands", "requests", "notifications", "knocks")}
            | {"reconnects": server.reconnects},
            "rejected": dict(server.rejected),
        }

    def compromise(self, address: str, attack: str) -> None:
        """Have a robot lie. Raises: Unknown: see `ShieldWatch.compromise`; or robots have no shields."""
        if self.gateway.shields is None:
            raise Unknown("these robots do not audit each other: nothing would stop it")
        self.gateway.shields.compromise(address, attack)

    def hold(self, held: bool) -> None:
        """Every robot stands still from now on, whatever it is told and whatever the broker does; or may move again.

        For any thread, however busy the event loop is: that hears of it afterwards.
        """
        self.gateway.brakes.hold(held)
        self._kept_stop.keep(lambda: self.gateway.brakes.held)  # last: a disk may take its time
        with contextlib.suppress(RuntimeError):  # it has ended
            self._loop.call_soon_threadsafe(self._say, {"event": "held" if held else "released"})

    async def run(self) -> None:
        """Let the world turn, tell visitors, report refusals, until cancelled."""
        phones = self._ask_again_for_phones()
        work = (self._turn(), self.gateway.run(), self.server.run(), self._report(), phones)
        tasks = [asyncio.ensure_future(job) for job in work]
        try:
            await asyncio.gather(*tasks)  # not a TaskGroup: the one error that ends it should arrive as itself
        finally:
            for task in tasks:
                task.cancel()

    async def ask_for_phones(self) -> None:
        """The page, and the log when it changes, say why phones do not get through a broker that is not ours."""
        if self._door is None or self._blocked:
            return
        before, self._no_phone = self._no_phone, await warn_if_phones_are_locked_out(self._door, self._no_phone)
        if before and not self._no_phone:
            log.warning("phones get in again")

    def _count(self, what: str) -> int:
        """How often that came, but for what we asked ourselves through the phones' door."""
        return max(0, self.server.counters[what] - (self._door.counters[what] if self._door else 0))

    async def _ask_again_for_phones(self) -> None:
        asked_at_s, reconnects = time.monotonic(), self.server.reconnects
        while self._door:
            await asyncio.sleep(REPORT_S)
            is_due = time.monotonic() - asked_at_s >= ASK_FOR_PHONES_S or self.server.reconnects != reconnects
            if self.server.connected and is_due:
                reconnects = self.server.reconnects
                await self.ask_for_phones()
                asked_at_s = time.monotonic()

    def _qr_svg(self) -> str:
        if self._qr[0] != self.qr_url:
            out = io.BytesIO()
            segno.make_qr(self.qr_url, error="m").save(out, kind="svg", xmldecl=False, svgns=True, omitsize=True)
            self._qr = (self.qr_url, out.getvalue().decode())
        return self._qr[1]

    async def _turn(self) -> None:
        before_s = time.monotonic()
        while isinstance(swarm := self.gateway.swarm, Stepped):  # real robots move by themselves
            await asyncio.sleep(1 / WORLD_HZ)
            now_s = time.monotonic()
            # A machine that slept does not hurl its robots through the wall.
            swarm.step(min(now_s - before_s, 0.2))
            before_s = now_s

    async def _report(self) -> None:
        connected = True
        while True:
            await asyncio.sleep(REPORT_S)
            for reason, count in list(self.server.rejected.items()):
                if count != self._told[reason]:
                    self._told[reason] = count
                    self._say({"event": "rejected", "reason": reason, "count": count})
            if self.server.connected != connected:
                connected = self.server.connected
                self._say({"event": "broker", "connected": connected, "trouble": self.server.trouble})

    def _on_event(self, said: Happening) -> None:
        # Of refusals the first of its kind at once; the others are added up, for they may come in thousands.
        if isinstance(said, Rejected) and said.reason in self._told:
            return
        event = tell_event(said, lambda: self.qr_url)
        # Pages ask all the time; and what we say ourselves is nobody's business.
        if event is None or isinstance(said, Request) or (self._door and self._door.is_knocking(said)):
            return
        if isinstance(said, Rejected):
            self._told[said.reason] = event["count"] = self.server.rejected[said.reason]
        self._say(event)


async def up(
    options: UpOptions,
    say: Say,
    started: Callable[[Running], None] = lambda _: None,
    *,
    swarm: Callable[[], Swarm],
) -> None:
    """Run a gateway until cancelled, or for as long as the options say.

    `say` is told every event; the first of a running gateway is "ready", before it perhaps "waiting", and "held" or
    "released". Before the broker is waited for `started` has the gateway, so that it can be stopped. The robots are
    made after all that can be wrong.

    Raises: UsageError, Unavailable: a bad option, a port in use, a broker that refuses us.
    """
    loopback_only = options.host in (LOOPBACK, "localhost")
    advertised = lan_address() if options.host in EVERYWHERE else options.host
    preferred = DEFAULT_PORT if options.operator_port != DEFAULT_PORT else 0
    ws_host = LOOPBACK if loopback_only else options.host
    token = options.operator_token or secrets.token_hex(16)
    allow_files(MANY_FILES)
    if options.frontend and options.visitors_login:
        host = urlsplit(options.frontend).hostname
        log.warning("links to %s hold no login: pages of the published kind take it from their form alone", host)
    async with contextlib.AsyncExitStack() as stack:

        async def serve_page() -> int:
            port = free_port(preferred, options.host) if options.port is None else options.port
            return await stack.enter_async_context(visitors_page(options.host, port))

        page_port = await (at_a_free_port(serve_page) if options.port is None else serve_page())
        broker = await stack.enter_async_context(
            open_broker(
                options.broker,
                login=options.login,
                websocket=options.broker_ws,
                visitors_login=options.visitors_login,
                ws_host=ws_host,
                root=options.link.root,
            )
        )
        page_url = options.page_url or f"http://{f'[{advertised}]' if ':' in advertised else advertised}:{page_port}/"
        server = Server(
            broker.gateway,
            config=options.link,
            broker_for_visitors=on_host(broker.websocket, advertised),
            login_for_visitors=broker.visitors_login,
            mqtt=broker.mqtt,
            heard=broker.heard,
        )
        robots = swarm()
        running = Running(options, broker, page_url, server, robots, say)
        desk = MissionDesk(robots) if isinstance(robots, OnMission) else None
        if desk:
            stack.callback(desk.stop)
        # Before the page that has the button: a stop must not wait until the broker is reached.
        stack.enter_context(running.gateway.brakes)
        operators = OperatorPages(token, running, desk, options.operator_port)
        operator = await stack.enter_async_context(beside(operators))
        started(running)
        await stack.enter_async_context(server)
        await until_connected(server, say, options.wait_s)
        await running.ask_for_phones()
        async with for_at_most(options.duration_s):
            say(running.ready(f"http://{LOOPBACK}:{operator.port}/#token={token}"))
            if running.gateway.brakes.held:
                say({"event": "held"})
            await running.run()
