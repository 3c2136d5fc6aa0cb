"""`phalanx link connect`: visit a swarm without a browser."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from phalanx.errors import Unavailable, UsageError, did_you_mean
from phalanx.link import Pin, QrUrl, parse_qr_url
from phalanx.link.session import is_session_url
from phalanx.link.topics import is_address
from phalanx.net import Login, parse_broker_url
from phalanx.net.broker_url import BrokerUrl

from .credentials import read_login
from .run import run
from .terminal import count_of, plain, print_json, talk
from .visiting import Visitor, qrkey_visitor, refusals_for_people, session_visitor

STATUS = ("active", "quiet", "lost")
OURS = {"name", "lh2_position", "battery", "status"}
MILLION = 1_000_000


def connect(
    qr_url: str | None,
    pin: str | None,
    broker: str | None,
    root: str,
    broker_login: Path | None,
    drive: str | None,
    unlisted: bool,
    left: int | None,
    right: int | None,
    for_s: float | None,
    watch: bool,
    timeout: float,
    name: str,
    keep: Path | None,
    as_json: bool,
) -> None:
    """Visit a swarm: list its robots, drive one, or print its notifications."""
    if drive is None and (left, right, for_s) != (None, None, None):
        raise UsageError("--left, --right and --for without a robot to drive", "add --drive ROBOT")
    if drive is not None and watch:
        raise UsageError("--drive with --watch", "give one of the two, or use two terminals")
    if unlisted and drive is None:
        raise UsageError("--unlisted without a robot to drive", "add --drive ADDRESS")
    if unlisted and not is_address(drive):
        raise UsageError(f"{drive!r} is not an address", "use at most 64 letters, digits, - and _")
    visitor = _visitor(qr_url, pin, broker, root, broker_login, name, keep, timeout)

    async def visit() -> None:
        with refusals_for_people():
            async with visitor:
                if watch:
                    async for payload in visitor.notifications():
                        print_json(payload)
                elif drive is not None:
                    robots = _Robots(visitor, unlisted)
                    wheels_pct = (left or 0, right or 0)
                    await _drive(robots, drive, wheels_pct, 1.0 if for_s is None else for_s, as_json)
                else:
                    _show_robots(await _Robots(visitor).listed(), as_json)

    if not run(visit()) and not watch:
        raise KeyboardInterrupt


def _visitor(
    qr_url: str | None,
    pin: str | None,
    broker: str | None,
    root: str,
    broker_login: Path | None,
    name: str,
    keep: Path | None,
    timeout_s: float,
) -> Visitor:
    if qr_url == "-":
        qr_url = sys.stdin.readline().strip()
    if qr_url and is_session_url(qr_url):
        if pin or broker or broker_login:
            raise UsageError("a session link with a pin, broker or login", "leave them out: the link contains all")
        return session_visitor(qr_url, name, keep, timeout_s)
    if name or keep:
        raise UsageError("--name and --keep without a session link", "give a link with #j=")
    login = read_login(broker_login)
    return qrkey_visitor(*_destination(qr_url, pin, broker, root, login), login, timeout_s)


def _destination(
    qr_url: str | None, pin: str | None, broker: str | None, root: str, login: Login | None
) -> tuple[QrUrl, BrokerUrl | None]:
    address = parse_broker_url(broker, login) if broker else None
    if qr_url:
        if pin:
            raise UsageError("a link with --pin", "leave out --pin: the link contains it")
        return parse_qr_url(qr_url, root), address
    if not pin or address is None:
        raise UsageError("no swarm to visit", "give the link under the QR code, or --pin and --broker")
    return QrUrl(Pin(pin), "ws://unused.invalid/mqtt", root), address


@dataclass(frozen=True, slots=True)
class _Robots:
    """Robots of a swarm, found by address or name; with `unlisted`, any address is accepted."""

    visitor: Visitor
    unlisted: bool = False

    async def listed(self) -> list[dict[str, Any]]:
        """Return the listed robots that have an address; report other items of the list on stderr."""
        answer = await self.visitor.robots()
        if not isinstance(answer, list):
            raise Unavailable("the swarm's answer is not a list of robots", "use --unlisted to drive an address anyway")
        robots = [{"address": robot} if isinstance(robot, str) else robot for robot in answer]
        known = [robot for robot in robots if isinstance(robot, dict) and is_address(robot.get("address"))]
        if others := [plain(robot) for robot in robots if robot not in known]:
            talk(f"not robots, but in the list: {', '.join(others[:5])}{', …' if others[5:] else ''}")
        return [{key: value for key, value in robot.items() if key != "position_history"} for robot in known]

    async def find(self, name: str) -> dict[str, Any]:
        """Return the robot with this address or name."""
        return {"address": name} if self.unlisted else _find(await self.listed(), name)


def _find(robots: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return the robot with this address, or else the only one with this name; case is ignored."""
    for key in ("address", "name"):
        found = [robot for robot in robots if str(robot.get(key) or "").upper() == name.upper()]
        if len(found) > 1:
            raise UsageError(f"{len(found)} robots are called {name}", "give an address instead")
        if found:
            return found[0]
    names = [str(robot.get(key)) for robot in robots for key in ("address", "name") if robot.get(key)]
    raise Unavailable(
        f"no robot {name} in this swarm",
        f"{did_you_mean(name, names)}phalanx link connect QR_URL lists robots; --unlisted drives any address",
    )


def _show_robots(robots: list[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        print_json({"robots": robots})
        return
    if not robots:
        talk("the swarm lists no robots")
    for robot in robots:
        click.echo(_row(robot))


def _row(robot: dict[str, Any]) -> str:
    """Return one line for a robot: in columns if it has our fields, otherwise all its fields."""
    if not OURS & robot.keys():
        fields = (f"{plain(key)}={plain(value)}" for key, value in robot.items() if key != "address")
        return "  ".join((f"{plain(robot['address']):16}", *fields))
    return (
        f"{plain(robot['address']):16}  {plain(robot.get('name') or ''):8}  {_place(robot.get('lh2_position'))}  "
        f"{_number(robot.get('battery') or None, '5.2f', ' V')}  {_status(robot.get('status'))}"
    )


def _place(at: object) -> str:
    x, y = (at.get("x"), at.get("y")) if isinstance(at, dict) else (None, None)
    return f"{_number(x, '7.0f')} {_number(y, '7.0f', ' mm')}"


def _number(value: object, form: str, unit: str = "") -> str:
    width = int(form.split(".", maxsplit=1)[0]) + len(unit)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MILLION:  # NaN too
        return " " * width
    return f"{value:{form}}{unit}"


def _status(value: object) -> str:
    return STATUS[value] if isinstance(value, int) and 0 <= value < len(STATUS) else "?"


async def _drive(robots: _Robots, name: str, wheels_pct: tuple[int, int], for_s: float, as_json: bool) -> None:
    before = await robots.find(name)
    address, application = before["address"], str(before.get("application", 0))
    sent = await robots.visitor.drive(address, application, wheels_pct, for_s)
    after = await robots.find(address)
    if as_json:
        places = {"from": before.get("lh2_position"), "to": after.get("lh2_position")}
        print_json({"address": address, "commands": sent} | places)
    elif robots.unlisted:
        click.echo(f"{count_of(sent, 'command')} to {plain(address)}; it is not known whether such a robot exists")
    else:
        click.echo(f"before  {_row(before)}\nafter   {_row(after)}")
