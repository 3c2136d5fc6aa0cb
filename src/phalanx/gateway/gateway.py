"""The gateway: passes commands from links to the swarm, and the swarm's state to every visitor."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from phalanx.errors import Late, Unknown, UsageError
from phalanx.link import Command, Request, SharedAnswer
from phalanx.link.session.errors import Busy
from phalanx.robot import Robot, Swarm
from phalanx.robot.on_mission import OnMission
from phalanx.robot.swarm import AuditedSwarm, RouteLimited, WorkingSwarm

from . import vocabulary
from .brakes import EXPIRES_S, Brakes
from .frames import StateUpdates, Tick
from .links import Link
from .missions.watch import MissionWatch, WorkWatch
from .shields import ShieldWatch
from .visitors import Drivers, Visitors
from .vocabulary import Notice

log = logging.getLogger(__name__)

TICK_S = 0.1
# Published pages receive one robot per notification, at most this many per tick, in turn. They drop messages that
# arrive within milliseconds of each other (measured: 50 at once, 3 delivered; 5 ms apart, all).
UPDATES_PER_TICK = 2
APART_S = 0.01
RELOAD_EVERY_S = 120.0
LIST_FOR_S = 0.1
OLDER_ANSWER_BYTES = 48 * 1024  # what mosquitto 2.0 sends a browser in about a second
TRAIL_POINTS, TRAIL_POINTS_IN_ALL = 30, 3000
ROUTE_POINTS_IN_ALL = 3000
LATE_S = 1.0


class Gateway:
    """Serves one swarm over links, to which it adds its handlers.

    Args:
        say: receives events of shields and missions.
        is_driven: returns whether a visitor with a session has the robot: others must not command it.
        drivers: returns the names of those visitors, by robot.
    """

    def __init__(
        self,
        swarm: Swarm,
        *links: Link,
        say: Callable[[dict[str, Any]], None] = lambda _: None,
        is_driven: Callable[[str], bool] = lambda _: False,
        drivers: Callable[[], Mapping[str, str]] = dict,
    ) -> None:
        self._is_driven = is_driven
        self._links = links
        self._answer_bytes = min((link.answer_bytes for link in links), default=0)
        self.visitors = Visitors()
        self.drivers = Drivers(drivers)
        self._routes_by_code: set[str] = set()  # robots
        self._watchers: list[Callable[[dict[str, Any]], None]] = []
        self._frames = StateUpdates()
        self.swarm = swarm
        self.brakes = Brakes(swarm)
        self.shields = ShieldWatch(swarm, say) if isinstance(swarm, AuditedSwarm) else None
        self.work = WorkWatch(swarm) if isinstance(swarm, WorkingSwarm) else None
        self._longest_route = swarm.longest_route if isinstance(swarm, RouteLimited) else vocabulary.MAX_WAYPOINTS
        self.missions = MissionWatch(swarm, say) if isinstance(swarm, OnMission) else None
        self._lately: dict[str, tuple[float, SharedAnswer]] = {}
        self._next_update = 0
        self._reloaded_at_s = 0.0
        for link in links:
            self._register(link)

    def _register(self, link: Link) -> None:
        for name, handler in (
            ("move_raw", self._move_raw),
            ("rgb_led", self._rgb_led),
            ("waypoints", self._waypoints),
            ("clear_position_history", self._clear_history),
        ):
            link.on_command(name)(self._checked(handler))
        link.on_request(vocabulary.REQUEST_ROBOTS)(self._tell_robots)
        link.on_request(vocabulary.REQUEST_AREA)(self._tell_area)
        if missions := self.missions:
            link.on_request(vocabulary.REQUEST_WALLS)(lambda _: self._shared("walls", missions.walls))
            link.on_request(vocabulary.REQUEST_LIT)(lambda _: self._shared("lit", missions.lit))

    def watch(self, tell: Callable[[dict[str, Any]], None]) -> Callable[[], None]:
        """Call `tell` with the current state of the swarm, then with every update; call the result to unsubscribe."""
        # In the form of answers to visitors.
        answers: dict[int, Any] = {vocabulary.REQUEST_AREA: self._area(), vocabulary.REQUEST_ROBOTS: self._list()}
        if self.missions:
            answers |= {vocabulary.REQUEST_WALLS: self.missions.walls(), vocabulary.REQUEST_LIT: self.missions.lit()}
        for number, data in answers.items():
            tell({"request": number, "data": data})
        self._watchers.append(tell)
        return lambda: self._watchers.remove(tell)

    async def run(self) -> None:
        """Send updates to visitors, and stop robots whose driver is silent, until cancelled."""
        with self.brakes:
            await self._tell()

    def _checked(self, handler: Callable[[str, Command], None]) -> Callable[[Command], None]:
        def handle(command: Command) -> None:
            if command.topic.application != vocabulary.APPLICATION:
                raise Unknown(f"no application {command.topic.application}")
            address = command.address.upper()
            # Sessions check their visitors themselves. Visitors with the shared code are anonymous and have no robot.
            if command.by is None and self._is_driven(address):
                raise Busy("a visitor of a session drives this robot")
            if command.by is not None:
                self._end_route_by_code(address)
            if command.is_stop:
                self.brakes.stop(address)
            else:
                handler(address, command)

        return handle

    def _move_raw(self, address: str, command: Command) -> None:
        move = vocabulary.parse_move_raw(command.payload)
        if not (move.left_pct or move.right_pct):  # a stop is never too late
            self.brakes.drive(address, 0, 0)
            return
        self._refuse_late(command)
        # The 300 ms start when the command arrived, not when it is handled: under load it may have waited here
        # while the visitor let go.
        if command.waited_s > EXPIRES_S:
            raise Late(f"waited {command.waited_s:.1f} s")
        self.brakes.drive(address, move.left_pct, move.right_pct)
        self.drivers.drives(address, command.by or "", time.monotonic())

    def _refuse_late(self, command: Command) -> None:
        """Refuse a delayed command, as from a broker that was paused. Raises: Late."""
        if command.waited_s > LATE_S:
            raise Late(f"waited {command.waited_s:.1f} s")

    def _rgb_led(self, address: str, command: Command) -> None:
        self._refuse_late(command)
        self.swarm.set_led(address, vocabulary.parse_rgb_led(command.payload))

    def _waypoints(self, address: str, command: Command) -> None:
        route = vocabulary.parse_waypoints(command.payload, self.swarm.area_mm, self._longest_route)
        if route.points:
            self._refuse_late(command)
            self.brakes.refuse_if_held()
        self.swarm.follow(address, route.points, route.threshold_mm)
        self.brakes.end_joystick(address)
        if command.by is None:
            self._routes_by_code.add(address)

    def _end_route_by_code(self, address: str) -> None:
        """End the route that a visitor with the shared code sent: another visitor has the robot now."""
        if address in self._routes_by_code:
            self.brakes.drive(address, 0, 0)  # not `stop`, which could take effect after the next command
            self._routes_by_code.discard(address)

    def _clear_history(self, address: str, command: Command) -> None:
        self._refuse_late(command)
        self.swarm.clear_history(address)

    def _tell_robots(self, request: Request) -> SharedAnswer:
        if self._is_published(request):
            return self._shared("published", self._published_list)
        return self._shared("robots", self._list)

    def _shared(self, what: str, make: Callable[[], Any]) -> SharedAnswer:
        # Many requests must not build many lists: the stop of a joystick would wait for them.
        made_at_s, told = self._lately.get(what, (-LIST_FOR_S, SharedAnswer(None)))
        if time.monotonic() - made_at_s >= LIST_FOR_S:
            told = SharedAnswer(make())
            self._lately[what] = (time.monotonic(), told)
        return told

    def _published_list(self) -> list[dict[str, Any]]:
        return vocabulary.robots_json(self.swarm.robots(), time.time(), OLDER_ANSWER_BYTES, self._answer_bytes - 1024)

    def _list(self) -> list[dict[str, Any]]:
        robots, now_s = self.swarm.robots(), time.time()
        # The trails are limited: in a large swarm they would be a megabyte.
        trail = min(TRAIL_POINTS, TRAIL_POINTS_IN_ALL // max(1, len(robots)))
        # So are the routes: with 64 points each they were nine tenths of the answer.
        with_routes = sum(len(robot.route) for robot in robots) <= ROUTE_POINTS_IN_ALL
        shields = self.shields.in_list(self._frames.number) if self.shields else {}
        walks = self.missions.in_list() if self.missions else {}
        drivers = self.drivers.in_list()
        return [
            vocabulary.robot_json(robot if with_routes else robot._replace(route=()), now_s, trail)
            | {"n": self._frames.number(robot.address), "mode": int(bool(robot.route))}
            | shields.get(robot.address, {})
            | walks.get(robot.address, {})
            | drivers.get(robot.address, {})
            for robot in robots
        ]

    def _tell_area(self, request: Request) -> dict[str, Any]:
        self._is_published(request)
        return self._area()

    def _area(self) -> dict[str, Any]:
        width, height = self.swarm.area_mm
        told: dict[str, Any] = {"width": width, "height": height}
        if self.shields:
            told |= self.shields.in_area()
        elif self.unprotected:
            told["unprotected"] = self.unprotected
        if isinstance(self.swarm, RouteLimited):
            told["most_waypoints"] = self._longest_route
        return told | (self.missions.in_area() if self.missions else {})

    @property
    def unprotected(self) -> str:
        """Return why the robots do not audit each other, if visitors may expect it; or ""."""
        return "" if self.shields else str(getattr(self.swarm, "unprotected", ""))

    def _is_published(self, request: Request) -> bool:
        """Return whether a client of mode qrkey sent the request, and note that it is active."""
        if request.client_id:
            self.visitors.asked(request.client_id, time.monotonic())
        return bool(request.client_id)

    async def _tell(self) -> None:
        due_s = time.monotonic()
        while True:
            try:
                await self._tell_tick()
            except Exception as error:
                log.exception("sending the swarm's state failed (%s), retrying", type(error).__name__)
                await asyncio.sleep(1)
            # Late ticks are skipped: visitors need the newest state, not every state.
            due_s = max(due_s + TICK_S, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())

    async def _tell_tick(self) -> None:
        # A cached list from before this tick must not be sent after its update.
        self._lately.clear()
        robots = self.swarm.robots()
        watches = [watch for watch in (self.shields, self.missions, self.work, self.drivers) if watch]
        more = {name: told for w in watches for name, told in w.news(self._frames.number, time.monotonic()).items()}
        tick = self._frames.next(robots, time.time(), time.monotonic(), more, held=self.brakes.held)
        for tell in self._watchers:
            tell(tick.frame)
        for link in self._links:
            if not link.is_published:
                await self._notify(link, tick.frame)
        if self.visitors.are_there(time.monotonic()):
            await self._tell_published(robots, tick)

    async def _tell_published(self, robots: Sequence[Robot], tick: Tick) -> None:
        now_s, uptime_s = time.time(), time.monotonic()
        for robot in tick.joined:
            await self._tell_one(Notice.NEW_ROBOT, vocabulary.robot_json(robot, now_s, 0))
        stale_s = uptime_s - self._reloaded_at_s
        # A reload makes every page request everything, so at most one a second.
        if stale_s >= RELOAD_EVERY_S or ((tick.changed or tick.left) and stale_s >= 1):
            self._reloaded_at_s = uptime_s
            await self._tell_one(Notice.RELOAD)
        for _ in range(min(UPDATES_PER_TICK, len(robots))):
            self._next_update = (self._next_update + 1) % len(robots)
            await self._tell_one(Notice.UPDATE, vocabulary.tell_update(robots[self._next_update]))

    async def _tell_one(self, notice: Notice, data: dict[str, Any] | None = None) -> None:
        await asyncio.sleep(APART_S)
        for link in self._links:
            if link.is_published:
                await self._notify(link, {"cmd": int(notice)} | ({"data": data} if data is not None else {}))

    async def _notify(self, link: Link, payload: dict[str, Any]) -> None:
        try:
            await link.notify(payload)
        except UsageError as error:
            # One invalid update must not end the updates that follow.
            log.error("update not sent: %s", error)  # noqa: TRY400  # the traceback adds nothing
