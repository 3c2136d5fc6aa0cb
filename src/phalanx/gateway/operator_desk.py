"""Operators' requests about visitors: from the operator's page, a terminal, or a visitor with an operator's ticket.

Every request has an object as payload and answer (docs/spec/vocabulary.md#over-a-session), and is recorded in the
trail. The caller has checked that an operator sent it.
"""

from __future__ import annotations

import io
import os
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import segno

from phalanx.errors import BadPayload, PeerError, Unknown, UsageError
from phalanx.link.session import Kind, Role, Secret, Ticket
from phalanx.link.session.nickname import NICKNAME_CHARACTERS, clean_nickname
from phalanx.link.session.secret import INVITATION_BYTES
from phalanx.robot import Swarm

from .brakes import Brakes
from .payloads import check_words
from .session_link import SessionLink, now

PAGE = 0  # id of an operator without a session: the page or a terminal on this machine
VALID_S = 7 * 24 * 3600  # default validity of a ticket
VALID_MOST_S = 366 * 24 * 3600
USES_MOST = 1000
ROLES = {role.name.lower(): role for role in Role}

Act = Callable[[dict[str, Any], int], dict[str, Any] | None]
Slow = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


def refuse_revival(_: str) -> None:
    """Refuse to revive a robot of a swarm without audits. Raises: Unknown."""
    raise Unknown("these robots do not audit each other: none is stopped")


class OperatorDesk:
    """Answers operators' requests.

    Attributes:
        acts: handlers of requests that are answered at once, by name; other modules add theirs.
        slow: handlers of slow requests, which are not recorded in the trail.

    Args:
        page_url: address of the visitors' page.
        hold: stops all robots, or lets them move again.
        revive: restarts a stopped robot.
    """

    def __init__(
        self,
        link: SessionLink,
        swarm: Swarm,
        brakes: Brakes,
        page_url: str,
        hold: Callable[[bool], None],
        revive: Callable[[str], None] = refuse_revival,
    ) -> None:
        self._revive_robot = revive
        self._link, self._swarm, self._brakes, self._page_url, self._hold = link, swarm, brakes, page_url, hold
        self._qr = ("", "")
        self.slow: dict[str, Slow] = {}
        self.acts: dict[str, Act] = {
            "visitors": self._list,
            "remove": self._remove,
            "everybody_out": self._everybody_out,
            "new_code": self._new_code,
            "code": self._code,
            "room": self._room,
            "door": self._door,
            "approve": self._approve,
            "role": self._role,
            "give": self._give,
            "take": self._take,
            "swap": self._swap,
            "revive": self._revive,
            "invite": self._invite,
            "stop": lambda _, by: self._stop(held=True, by=by),
            "go": lambda _, by: self._stop(held=False, by=by),
        }

    def do(self, request: str, words: Any, by: int = PAGE) -> dict[str, Any]:
        """Answer a request of visitor `by`.

        Raises: Unknown: no such request or visitor; BadPayload; NotAllowed: no such robot; UsageError.
        """
        act = self.acts.get(request)
        if act is None:
            raise Unknown(f"no request {request[:64]!r}")
        return act(check_words(words), by) or {}

    async def ask(self, request: str, words: Any) -> dict[str, Any]:
        """Answer a request from a terminal. Raises: as `do`, and errors of slow requests."""
        slow = self.slow.get(request)
        return await slow(check_words(words)) if slow else self.do(request, words)

    def operate(self, request: str, words: dict[str, Any], by: int) -> dict[str, Any] | Awaitable[dict[str, Any]]:
        """Answer a visitor's request, for `SessionLink`. Raises: PeerError: any error."""
        if slow := self.slow.get(request):
            return slow(words)
        try:
            return self.do(request, words, by)
        except UsageError as error:
            raise BadPayload(str(error)) from error

    @property
    def code_url(self) -> str:
        """Return the URL of the current open code."""
        return self._page_url + "#" + self._link.invitation.fragment()

    def qr_svg(self, url: str) -> str:
        """Return the QR code of a URL."""
        if self._qr[0] != url:
            self._qr = url, qr_svg(url)
        return self._qr[1]

    def visitors(self) -> list[dict[str, Any]]:
        """Return all visitors who can resume, connected ones first."""
        server, now_ms = self._link.server, now().ms
        told = []
        for each in server.visitors:
            connection = server.connections.of_visitor(each.id)
            told.append(
                {
                    "visitor": each.id,
                    "name": each.name,
                    "role": each.role.name.lower(),
                    "waiting": each.waiting,
                    "present": connection is not None,
                    "present_s": round((now_ms - connection.opened_ms) / 1000, 1) if connection else None,
                    "silent_s": round((now_ms - connection.heard_ms) / 1000, 1) if connection else None,
                    "robot": server.assignment.robot_of(each.id) or "",
                    "robots": sorted(each.robots),
                    "place": server.assignment.place_of(each.id),
                }
            )
        return sorted(told, key=lambda each: (not each["present"], each["visitor"]))

    # --- requests ----------------------------------------------------------------------------------------------------

    def _list(self, _: dict[str, Any], __: int) -> dict[str, Any]:
        door_open = not self._link.server.visitors.approval
        return {"visitors": self.visitors(), "open": door_open, "assign": self._link.config.assign}

    def _remove(self, words: dict[str, Any], by: int) -> None:
        visitor = self._visitor(words)
        driven = self._driven({visitor})
        events = self._link.operations.remove(visitor, now())  # stored on return
        self._link.trail.write("removed", visitor=visitor, by=by, durable=True)
        self._link.carry(events)
        self._stop_robots(driven)

    def _everybody_out(self, _: dict[str, Any], by: int) -> None:
        gone = {each.id for each in self._link.server.visitors if each.role is not Role.OPERATE}
        driven = self._driven(gone)
        events = self._link.operations.everybody_out(now())
        self._link.trail.write("everybody_out", visitors=sorted(gone), by=by, durable=True)
        self._link.carry(events)
        self._stop_robots(driven)

    def _new_code(self, _: dict[str, Any], by: int) -> dict[str, Any]:
        self._link.operations.new_code(now())
        self._link.trail.write("new_code", by=by)
        self._link.say({"event": "rotation"})
        return {"url": self.code_url}

    def _code(self, _: dict[str, Any], __: int) -> dict[str, Any]:
        door, url = self._link.server.door, self.code_url
        return {
            "url": url,
            "svg": self.qr_svg(url),
            "left_s": round(door.left_ms(now().ms) / 1000, 1),
            "overlap_s": self._link.config.code_overlap_ms / 1000,
            "room": door.room,
        }

    def _room(self, words: dict[str, Any], by: int) -> dict[str, Any]:
        shown, door = _flag(words, "show"), self._link.server.door
        if shown:
            door.show_room()
        else:
            door.hide_room()
        self._link.trail.write("room", shown=shown, by=by)
        return {"room": door.room}

    def _door(self, words: dict[str, Any], by: int) -> None:
        is_open = _flag(words, "open")
        if is_open:
            self._link.operations.open_door()
        else:
            self._link.operations.close_door()
        self._link.trail.write("door", open=is_open, by=by)

    def _approve(self, words: dict[str, Any], by: int) -> None:
        visitor = self._visitor(words)
        self._link.carry(self._link.operations.approve(visitor, now()))
        self._link.trail.write("approved", visitor=visitor, by=by)

    def _role(self, words: dict[str, Any], by: int) -> None:
        visitor, role = self._visitor(words), _role(words)
        driven = self._driven({visitor}) if role is Role.WATCH else []
        self._link.carry(self._link.operations.set_role(visitor, role, now()))
        self._link.trail.write("role", visitor=visitor, role=role.name.lower(), by=by)
        self._stop_robots(driven)

    def _give(self, words: dict[str, Any], by: int) -> None:
        visitor, robot = self._visitor(words), self._robot(words.get("robot"))
        self._link.carry(self._link.operations.give(robot, visitor, now()))
        self._stop_robots([robot])
        self._link.trail.write("given", visitor=visitor, robot=robot, by=by)

    def _take(self, words: dict[str, Any], by: int) -> None:
        robot = self._robot(words.get("robot"))
        self._link.carry(self._link.operations.take(robot, now()))
        self._link.trail.write("taken", robot=robot, by=by)

    def _swap(self, words: dict[str, Any], by: int) -> None:
        robots = words.get("robots")
        if not isinstance(robots, list) or len(robots) != 2:
            raise BadPayload("'robots' are two")
        first, second = map(self._robot, robots)
        self._link.carry(self._link.operations.swap(first, second, now()))
        self._link.trail.write("swapped", robots=[first, second], by=by)

    def _revive(self, words: dict[str, Any], by: int) -> None:
        robot = self._robot(words.get("robot"))
        self._revive_robot(robot)
        self._link.trail.write("revived", robot=robot, by=by)

    def _invite(self, words: dict[str, Any], by: int) -> dict[str, Any]:
        role, name = _role(words), words.get("name", "")
        uses, valid_s = _number(words, "uses", 1, USES_MOST, 1), _number(words, "valid_s", 1, VALID_MOST_S, VALID_S)
        if not isinstance(name, str) or clean_nickname(name) != name:
            raise BadPayload(f"'name' has at most {NICKNAME_CHARACTERS} characters, all of them visible")
        robots = words.get("robots", [])
        if not isinstance(robots, list):
            raise BadPayload("'robots' is a list")
        named = frozenset(map(self._robot, robots))
        secret = Secret(Kind.TICKET, os.urandom(INVITATION_BYTES))
        unix_s = now().unix_s
        self._link.server.door.add_ticket(Ticket(secret, role, uses, unix_s + valid_s, name, named), unix_s)
        words = {"role": role.name.lower(), "uses": uses, "valid_s": valid_s, "name": name, "robots": sorted(named)}
        self._link.trail.write("invited", **words, ticket=secret.id.hex(), by=by)
        page = self._page_url.rstrip("/") + "/operator/" if role is Role.OPERATE else self._page_url
        url = page + "#" + replace(self._link.invitation, secret=secret).fragment()
        return {"url": url, "svg": qr_svg(url)}

    def _stop(self, *, held: bool, by: int) -> None:
        self._hold(held)
        self._link.trail.write("stopped_all" if held else "released_all", by=by)

    # --- fields -------------------------------------------------------------------------------------------------------

    def _visitor(self, words: dict[str, Any]) -> int:
        visitor = _number(words, "visitor", 1, (1 << 32) - 1)
        if self._link.server.visitors.find(visitor) is None:
            raise Unknown(f"no visitor {visitor}")
        return visitor

    def _robot(self, name_or_address: Any) -> str:
        """Return a robot's address, given its address or name."""
        if not isinstance(name_or_address, str):
            raise BadPayload("a robot is a string")
        robots = self._swarm.robots()
        for robot in robots:
            if robot.address == name_or_address.upper():
                return robot.address
        found = [robot.address for robot in robots if robot.name.casefold() == name_or_address.casefold()]
        if len(found) != 1:
            raise Unknown(f"{'no robot' if not found else f'{len(found)} robots'} {name_or_address[:64]!r}")
        return found[0]

    def _driven(self, visitors: set[int]) -> list[str]:
        """Return the robots that these visitors drive now."""
        assignment, now_ms = self._link.server.assignment, now().ms
        return [
            robot.address for robot in self._swarm.robots() if assignment.driver_of(robot.address, now_ms) in visitors
        ]

    def _stop_robots(self, robots: list[str]) -> None:
        # A robot would continue its route without the visitor.
        for robot in robots:
            try:
                self._brakes.stop(robot)
            except PeerError:
                continue  # it has left


def qr_svg(url: str) -> str:
    """Return the QR code of a URL, as SVG for a page."""
    out = io.BytesIO()
    segno.make_qr(url, error="m").save(out, kind="svg", xmldecl=False, svgns=True, omitsize=True)
    return out.getvalue().decode()


def _flag(words: dict[str, Any], key: str) -> bool:
    value = words.get(key)
    if not isinstance(value, bool):
        raise BadPayload(f"{key!r} is true or false")
    return value


def _number(words: dict[str, Any], key: str, low: int, high: int, default: int | None = None) -> int:
    value = words.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise BadPayload(f"{key!r} is a whole number, {low} to {high}")
    return value


def _role(words: dict[str, Any]) -> Role:
    value = words.get("role")
    if not isinstance(value, str) or value not in ROLES:
        raise BadPayload(f"'role' is one of {', '.join(ROLES)}")
    return ROLES[value]
