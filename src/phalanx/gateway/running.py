"""A running gateway, as its operator sees it."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.crypto.jwe import encode_base64url
from phalanx.errors import Unknown
from phalanx.link.messages import Rejected
from phalanx.link.session.errors import Busy
from phalanx.net.server import LinkEvent
from phalanx.robot import Swarm
from phalanx.robot.swarm import SteppedSwarm

from . import vocabulary
from .at_broker import BrokerStatus
from .brakes import KeptStop
from .gateway import Gateway
from .links import Link
from .operator_desk import OperatorDesk, refuse_revival
from .projector import Projector, projector_token
from .session_link import EventSink, SessionLink, now
from .shared_code import SharedCode

if TYPE_CHECKING:
    from .up import UpOptions

WORLD_HZ = 50
REPORT_S = 1.0
DIRECT = {"name": "direct", "url": "", "connected": True, "trouble": "", "phones": ""}


class Running:
    """A gateway with its swarm and links.

    Attributes:
        desk: operators' requests about visitors.
        was_held: all robots were stopped when the previous gateway ended.

    Args:
        page_url: address of the visitors' page.
        link_url: address of the websocket for pages on this machine.
        shared: mode qrkey, if it is also served; with a page of its own, its code is the one shown.
        broker: the broker that serves visitors.
        static: the gateway's key, from which the projector's token is derived.
    """

    def __init__(
        self,
        options: UpOptions,
        page_url: str,
        link_url: str,
        link: SessionLink,
        swarm: Swarm,
        say: EventSink,
        shared: SharedCode | None,
        broker: BrokerStatus | None = None,
        *,
        static: X25519PrivateKey,
    ) -> None:
        self.page_url, self._link_url = page_url, link_url
        self.link, self.shared, self._broker = link, shared, broker
        links: list[Link] = [link, *([shared.server] if shared else [])]
        self.gateway = Gateway(swarm, *links, say=say, is_driven=link.is_driven, drivers=link.drivers)
        shields = self.gateway.shields
        revive = shields.revive if shields else refuse_revival
        self.desk = OperatorDesk(link, swarm, self.gateway.brakes, page_url, self.hold, revive)
        self.desk.acts |= {"state": lambda *_: self.state(), "compromise": self._compromise, "where": self._where}
        self.desk.slow["rotate"] = self._rotate
        self._options = options
        self.projector = Projector(self, projector_token(static), options.wifi, unreachable=options.unreachable)
        self._shown = shared if options.frontend else None
        self._loop = asyncio.get_running_loop()
        self._say = say
        self._started_at_s = time.monotonic()
        self._told: Counter[str] = Counter()
        self._kept_stop = KeptStop(options.stop_file)
        self.was_held = self._kept_stop.was_held()
        if self.was_held:
            self.gateway.brakes.hold()
        link.operate = self.desk.operate
        link.say = self._on_session
        if shared:
            shared.server.on_event = self._on_shared

    @property
    def qr_url(self) -> str:
        """Return the content of the current QR code."""
        return self._shown.qr_url if self._shown else self.desk.code_url

    @property
    def connected(self) -> bool:
        """Return whether visitors can be reached: on the direct transport always."""
        return self._broker is None or self._broker.connected

    def health(self) -> dict[str, Any]:
        """Return the state for monitoring."""
        shields = self.gateway.shields
        return {"broker": self.connected, "shields": shields.health(time.monotonic()) if shields else "none"}

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of refused messages, by reason."""
        return self.link.rejected + (self.shared.server.rejected if self.shared else Counter())

    def ready(self, operator_url: str) -> dict[str, Any]:
        """Return the event "ready"."""
        words = {"page_url": self.page_url, "qr_url": self.qr_url, "session_url": self.desk.code_url}
        return {
            "event": "ready",
            **words,
            **(self.shared.ready() if self.shared else {}),
            "operator_url": operator_url,
            "projector_url": f"{operator_url.partition('#')[0]}projector#token={self.projector.token}",
            "unreachable": self._options.unreachable,
        }

    def summary(self) -> dict[str, Any]:
        """Return the numbers of the status line."""
        return {
            "robots": len(self.gateway.swarm.robots()),
            "visitors": len(self._visitors(self.desk.visitors(), time.monotonic())),
            "commands": self._count("commands"),
            "refused": sum(self.rejected.values()),
            "rotates_in_s": self._rotates_in_s(),
            "connected": self.connected,
            "held": self.gateway.brakes.held,
        }

    def state(self) -> dict[str, Any]:
        """Return all data of the operator's page, including the code."""
        now_s, uptime_s = time.time(), time.monotonic()
        shown, config = self._shown, self.link.config
        robots = self.gateway.swarm.robots()
        names = {robot.address: robot.name for robot in robots}
        link = {vocabulary.Status.ACTIVE: "ok", vocabulary.Status.INACTIVE: "quiet", vocabulary.Status.LOST: "lost"}
        drivers = self.gateway.drivers.in_list()
        door, sessions = self.link.server.door, self.desk.visitors()
        return {
            "mode": "qrkey" if shown else "session",
            "held": self.gateway.brakes.held,
            "page_url": self._options.frontend or self.page_url,
            "projector": f"/projector#token={self.projector.token}",
            "qr_url": self.qr_url,
            "qr_svg": self.desk.qr_svg(self.qr_url),
            "rotates_in_s": round(self._rotates_in_s(), 1),
            "rotate_s": shown.server.config.rotate_s if shown else config.code_ms / 1000,
            "overlap_s": shown.server.config.overlap_s if shown else config.code_overlap_ms / 1000,
            "overlapping": shown.server.overlapping if shown else door.overlaps(now().ms),
            "uptime_s": round(uptime_s - self._started_at_s, 1),
            "broker": self._broker.state() if self._broker else DIRECT,
            "visitors": self._visitors(sessions, uptime_s),
            "session": {
                "url": self.desk.code_url,
                "room": door.room,
                "open": not self.link.server.visitors.approval,
                "assign": config.assign,
                "shared_code": self.shared is not None,
                "visitors": sessions,
            },
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
                    "drivers": drivers.get(robot.address, {}).get("drivers", []),
                }
                for robot in robots
            ],
            "shields": self.gateway.shields.state(names.__getitem__) if self.gateway.shields else None,
            "unprotected": self.gateway.unprotected,
            "mission": self.gateway.missions.state() if self.gateway.missions else None,
            "counters": {key: self._count(key) for key in ("commands", "requests", "notifications", "knocks")}
            | {"reconnects": self.shared.server.reconnects if self.shared else 0},
            "rejected": dict(self.rejected),
        }

    def _compromise(self, words: dict[str, Any], _: int) -> None:
        """Compromise a robot. Raises: Unknown: as `ShieldWatch.compromise`, or robots have no shields."""
        if self.gateway.shields is None:
            raise Unknown("these robots do not audit each other: nothing would stop it")
        self.gateway.shields.compromise(str(words.get("address")), str(words.get("attack")))

    def _where(self, *_: object) -> dict[str, Any]:
        """Return the link's address for a page on this machine, and the swarm's public key."""
        return {"link": self._link_url, "static": encode_base64url(self.link.static).decode()}

    def hold(self, held: bool) -> None:
        """Stop every robot regardless of commands and of the link, or let robots move again.

        Thread-safe, and independent of a busy event loop: the event follows later.
        """
        self.gateway.brakes.hold(held)
        self._kept_stop.keep(lambda: self.gateway.brakes.held)  # last: the disk can be slow
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._say, {"event": "held" if held else "released"})

    async def _rotate(self, _: dict[str, Any]) -> dict[str, Any]:
        """Change the shown code now. Raises: Busy: in mode qrkey, while two codes are accepted."""
        self.desk.do("new_code", {})
        if self._shown and not await self._shown.server.rotate():
            raise Busy("the code has just changed; wait until the previous one has expired")
        return {}

    async def run(self) -> None:
        """Step the simulation, send updates and report refusals, until cancelled."""
        work = [self._turn(), self.gateway.run(), self.link.run(), self._report()]
        if self._broker:
            work.append(self._broker.report(self._say))
        if self.shared:
            work.append(self.shared.server.run())
        tasks = [asyncio.ensure_future(job) for job in work]
        try:
            await asyncio.gather(*tasks)  # not a TaskGroup, which would wrap the error in a group
        finally:
            for task in tasks:
                task.cancel()

    def _rotates_in_s(self) -> float:
        return self._shown.server.rotates_in_s if self._shown else self.link.server.door.left_ms(now().ms) / 1000

    def _count(self, what: str) -> int:
        return self.link.counters[what] + (self.shared.count(what) if self.shared else 0)

    def _visitors(self, sessions: list[dict[str, Any]], uptime_s: float) -> list[dict[str, Any]]:
        """Return the connected visitors of all links; `sessions` are those of the desk."""
        here = [
            {"id": each["name"], "last_seen_s": each["silent_s"], "requests": 0, "visitor": each["visitor"]}
            for each in sessions
            if each["present"] and each["role"] != "operate"
        ]
        shared = self.gateway.visitors
        return here + [
            {"id": shared.shown(v.client_id), "last_seen_s": round(uptime_s - v.seen_at_s, 1), "requests": v.requests}
            for v in shared.present(uptime_s)
        ]

    async def _turn(self) -> None:
        before_s = time.monotonic()
        while isinstance(swarm := self.gateway.swarm, SteppedSwarm):  # only simulated robots
            await asyncio.sleep(1 / WORLD_HZ)
            now_s = time.monotonic()
            # Limited, so that robots do not jump through a wall after the machine was suspended.
            swarm.step(min(now_s - before_s, 0.2))
            before_s = now_s

    async def _report(self) -> None:
        while True:
            await asyncio.sleep(REPORT_S)
            if self._options.revive_s is not None and self.gateway.shields:
                self.gateway.shields.revive_after(self._options.revive_s, time.monotonic())
            for reason, count in self.rejected.items():
                if count != self._told[reason]:
                    self._told[reason] = count
                    self._say({"event": "rejected", "reason": reason, "count": count})

    def _on_session(self, event: dict[str, Any]) -> None:
        if event["event"] == "rotation":
            if self._shown:
                return  # another code is on the screen
            event = event | {"qr_url": self.qr_url}
        self._say(event)

    def _on_shared(self, happening: LinkEvent) -> None:
        # The first refusal of each reason is reported at once, later ones as sums: there can be thousands.
        if isinstance(happening, Rejected) and happening.reason in self._told:
            return
        event = self.shared.event(happening) if self.shared else None
        if event is None:
            return
        if isinstance(happening, Rejected):
            self._told[happening.reason] = event["count"]
        if event["event"] == "rotation" and self._shown:
            event["qr_url"] = self.qr_url
        self._say(event)
