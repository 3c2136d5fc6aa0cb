"""`phalanx up`: run a gateway from the options of the command line."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import click

from phalanx.bridges.dotbots import DotbotSwarm, DotbotUrl, parse_dotbot_url
from phalanx.config import LinkConfig
from phalanx.errors import PhalanxError, UsageError
from phalanx.gateway import pages_are_built
from phalanx.gateway.demo import Plan, mission_swarm, plan_swarm, simulated_swarm
from phalanx.gateway.projector import Wifi
from phalanx.gateway.running import Running
from phalanx.gateway.session_link import EventSink
from phalanx.gateway.tour import tour as run_tour
from phalanx.gateway.up import UpOptions
from phalanx.gateway.up import up as run_gateway
from phalanx.mission import BuildOptions, build
from phalanx.mission.landmarks import FloorPlan
from phalanx.net.keyring import open_keyring
from phalanx.robot import Swarm
from phalanx.world.building.floorplan import DEFAULT, load_floorplan
from phalanx.world.missions.orders import Orders, orders_of, orders_of_files
from phalanx.world.swarms.protected import SwarmKeys

from .codes import qr_text
from .commands.up import ROBOTS, ROBOTS_ON_MISSION
from .credentials import kept_token, login_for, passphrase_of, read_signing_key
from .gateway_of import default_state
from .mission.files import Wanted
from .options import link_config
from .run import needs_ros2, run
from .terminal import EventLines, end_status_line, plain, read_stop_commands, status_line, talk

log = logging.getLogger(__name__)

TOUR_MISSION = "office"
TABLET_S = 600
Started = Callable[[Running], None]


def up(
    robots: int | None,
    swarm_url: str | None,
    protocol: str | None,
    seed: int,
    missions: tuple[str, ...],
    furnish: str | None,
    world: str | None,
    start_key: Path | None,
    trust: tuple[str, ...],
    defence: str | None,
    f_max: int | None,
    keys: Path | None,
    passphrase_file: Path | None,
    broker_login: Path | None,
    operator_token_file: Path | None,
    state: Path | None,
    events: bool,
    wifi_ssid: str | None,
    wifi_password_file: Path | None,
    tour: bool,
    **served: Any,
) -> None:
    """Run a gateway until it is stopped."""
    if seed < 0:
        raise UsageError(f"seed {seed} is negative", "use 0 or more")
    on_mission = bool(missions) or world is not None
    if swarm_url is not None:
        simulated = {"robots": robots, "scenario": protocol, "mission": missions, "world": world}
        _refuse_beside_real_robots(**simulated, defence=defence, f_max=f_max, keys=keys)
    count = robots if robots is not None else ROBOTS_ON_MISSION if on_mission else ROBOTS
    token = kept_token(operator_token_file) if operator_token_file else ""
    link = link_config(served)
    login = login_for(served["broker"], broker_login)
    _refuse_without_broker(link, served, broker_login)
    options = UpOptions(
        link=link,
        login=login,
        state=state or default_state(),
        state_is_optional=state is None,
        operator_token=token,
        wifi=_wifi(wifi_ssid, wifi_password_file),
        stop_file=operator_token_file and operator_token_file.with_name(f"{operator_token_file.name}.stopped"),
        **served,
    )
    if not pages_are_built():
        click.echo("phalanx: warning: the pages are not built, so phones get none; run: make setup", err=True)
    if keys is None and passphrase_file is not None:
        raise UsageError("--passphrase-file without --keys", "give both, or neither")
    if keys is not None and on_mission:
        raise UsageError("--keys with --mission", "leave one out: robots on a mission create their own keys")
    if protocol is not None and on_mission:
        raise UsageError("--scenario with --mission", "leave one out: robots on a mission have no other task")
    if tour:
        fixed = {"swarm": swarm_url, "mission": missions, "world": world, "keys": keys, "scenario": protocol}
        _refuse_with_tour(fixed | {"duration": options.duration_s, "qrkey": options.qrkey, "revive": options.revive_s})
        plan = plan_swarm(count, defence, f_max)
        if plan.defence == "none":
            raise UsageError("--tour needs robots that audit each other", "use at least 5 robots")
        driven = partial(_simulated, plan, seed)
        office = partial(_on_mission, Wanted((TOUR_MISSION,), None, None, (), "--start-key"), seed)
        _run_for(options, events, lambda report, started: run_tour(options, report, started, driven, office))
        return
    wanted = Wanted(missions, furnish, start_key, trust, "--start-key")
    with (
        _real_robots(swarm_url, options.wait_s)
        if swarm_url is not None
        else _robots(wanted, world, count, seed, defence, f_max) as mission_robots
    ):
        swarm: Callable[[], Swarm]
        if mission_robots is None:
            plan = plan_swarm(count, defence, f_max, protocol or "")
            # After all other checks, as it uses up a mission number.
            owned = None if keys is None else keys_for_next_mission(keys, passphrase_file, plan)
            swarm = partial(simulated_swarm, plan, seed, talk, owned)
        else:
            swarm = partial(_as_is, mission_robots)
        _run_for(options, events, lambda report, started: run_gateway(options, report, started, swarm=swarm))


def _refuse_without_broker(link: LinkConfig, served: dict[str, Any], broker_login: Path | None) -> None:
    """Refuse options that need --broker or --qrkey if it is missing. Raises: UsageError."""
    default = LinkConfig()
    changed = {name: getattr(link, name) != getattr(default, name) for name in ("pin_digits", "rotate_s", "overlap_s")}
    of_qrkey = {"frontend": served["frontend"], **changed}
    of_broker = {"broker_ws": served["broker_ws"], "broker_login": broker_login, "root": link.root != default.root}
    for needed, given in (("broker", of_broker), ("qrkey", of_qrkey)):
        for name, value in given.items():
            if value and not served[needed]:
                option = f"--{name.replace('_', '-')}"
                hint = "leave it out, as visitors connect to this machine directly; or add --broker mosquitto|URL"
                raise UsageError(f"{option} without --{needed}", hint + " --qrkey" * (needed == "qrkey"))


def _wifi(ssid: str | None, password_file: Path | None) -> Wifi | None:
    """Return the visitors' Wi-Fi network. Raises: UsageError: invalid, or its password file is unreadable."""
    if ssid is None:
        if password_file is not None:
            raise UsageError("--wifi-password-file without --wifi", "add the network's name: --wifi SSID")
        return None
    if password_file is None:
        return Wifi(ssid)
    hint = "use a file with the password in its first line"
    try:
        password = password_file.read_text().partition("\n")[0].rstrip("\r")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "not text"
        raise UsageError(f"cannot read {plain(password_file)}: {why}", hint) from error
    if not password:
        raise UsageError(f"{plain(password_file)} is empty", hint)
    return Wifi(ssid, password)


def _as_is(swarm: Swarm) -> Swarm:
    return swarm


def _refuse_beside_real_robots(**options: Any) -> None:
    for name, value in options.items():
        if value not in (None, ()):
            raise UsageError(
                f"--swarm with --{name.replace('_', '-')}",
                "leave one out: real robots have their own number, controllers and protection",
            )


def keys_for_next_mission(file: Path, passphrase_file: Path | None, plan: Plan) -> SwarmKeys:
    """Return the keys of its robots; uses up a mission number. Raises: UsageError: a robot has none."""
    robots = plan.robots
    if plan.defence == "none":
        raise UsageError("--keys without audits", "leave it out: robots need keys only to audit each other")
    with open_keyring(file, passphrase_of(file, passphrase_file)) as keys:
        masters = {robot: keys.master(robot) for robot in range(1, robots + 1)}
        number, sealed = keys.issue()
        for robot in sorted(masters.keys() - sealed.keys()):
            raise UsageError(
                f"robot {robot} was retired on {keys.robots[robot].retired}", f"use --robots {robot - 1}, or other keys"
            )
        boards = [(master, sealed[robot]) for robot, master in masters.items()]
    talk(f"mission {number} of {keys.name}")
    return SwarmKeys(number, boards, keys.signer("orders"), keys.signer("stops"))


def _real_robots(words: str, wait_s: float) -> AbstractContextManager[Swarm]:
    if words == "ros2":
        return _ros2(wait_s)
    if Path(words).suffix not in (".yaml", ".yml"):
        return _dotbots(parse_dotbot_url(words), wait_s)
    from phalanx.daemon.swarm import RobotSwarm  # noqa: PLC0415 - slow to import
    from phalanx.daemon.swarm_file import read_swarm  # noqa: PLC0415

    settings = read_swarm(Path(words))
    folder, entries = settings.path.parent, settings.said
    keys = read_signing_key(folder / entries.gateway), read_signing_key(folder / entries.operator)
    swarm = RobotSwarm(settings, *keys)
    if swarm.unchecked:
        talk(swarm.unchecked)
    return swarm


@contextlib.contextmanager
def _ros2(wait_s: float) -> Iterator[Swarm]:
    """Return the robots of a ROS domain, once the first of them is discovered."""
    with needs_ros2():
        from phalanx.bridges.ros2.swarm import RosSwarm  # noqa: PLC0415 - an extra
    with RosSwarm(wait_s) as swarm:
        talk(swarm.unprotected)
        yield swarm


@contextlib.contextmanager
def _dotbots(controller: DotbotUrl, wait_s: float) -> Iterator[Swarm]:
    """Return the DotBots, once their controller has reported them."""
    if not controller.is_here:
        log.warning(
            "anybody who reaches %s can drive the robots without this gateway: its API has no login; hint: let it"
            " listen on 127.0.0.1, and run phalanx up on that machine",
            controller,
        )
    with DotbotSwarm(controller, wait_s) as swarm:
        routes = f"routes have at most {swarm.longest_route} points, and continue if this process is killed"
        talk(f"{swarm.unprotected}; {routes}")
        yield swarm


@contextlib.contextmanager
def _robots(
    wanted: Wanted, world: str | None, count: int, seed: int, defence: str | None, f_max: int | None
) -> Iterator[Swarm | None]:
    """Return robots for missions, which have started the first one if it exists; None if no mission is wanted."""
    if not wanted.sources and world is None:
        wanted.read()  # refuses options of mission files
        yield None
        return
    plan, orders = _orders(wanted, world)
    with mission_swarm(plan, orders, count, seed, defence, f_max, talk) as swarm:
        yield swarm


def _orders(wanted: Wanted, world: str | None) -> tuple[FloorPlan, Orders | None]:
    files, plain = wanted.read()
    plan = load_floorplan(world or (plain.floor_plan if plain else "") or DEFAULT)
    if files:
        return plan, orders_of_files(Path(wanted.sources[0]).stem, files, plan, plain)
    return plan, orders_of(plain, build(plain, BuildOptions(), os.urandom), plan) if plain else None


def _refuse_with_tour(options: dict[str, Any]) -> None:
    for name, value in options.items():
        if value not in (None, (), False):
            raise UsageError(f"--tour with --{name}", "leave one out: the tour has a fixed program")


@contextlib.contextmanager
def _simulated(plan: Plan, seed: int) -> Iterator[Swarm]:
    yield simulated_swarm(plan, seed, talk)


@contextlib.contextmanager
def _on_mission(wanted: Wanted, seed: int) -> Iterator[Swarm]:
    with _robots(wanted, None, ROBOTS_ON_MISSION, seed, None, None) as swarm:
        assert swarm is not None, "a mission is wanted"
        yield swarm


def _run_for(options: UpOptions, events: bool, make: Callable[[EventSink, Started], Coroutine[Any, Any, None]]) -> None:
    """Run a gateway that prints events for programs, or a display for people."""
    if not events:
        _run_for_people(options, make)
        return
    lines = EventLines()
    try:
        run(make(lines, partial(_start, [], reads_stdin=True)))
    finally:
        lines.close()


def _start(newest: list[Running], running: Running, *, reads_stdin: bool, shows_tablet: bool = False) -> None:
    """Keep the newest gateway in `newest`: a tour starts one each minute.

    With `reads_stdin`, commands on stdin stop and release its robots. With `shows_tablet`, another command shows a code
    for an operator's tablet. Only one thread reads stdin: a second one would take some of its lines.
    """

    def hold(held: bool) -> None:
        newest[0].hold(held)

    is_first = not newest
    newest[:] = [running]
    if is_first and reads_stdin:
        loop = asyncio.get_running_loop()
        tablet = partial(loop.call_soon_threadsafe, lambda: _show_tablet_code(newest[0]))
        read_stop_commands(hold, {"tablet": tablet} if shows_tablet else {})


def _run_for_people(options: UpOptions, make: Callable[[EventSink, Started], Coroutine[Any, Any, None]]) -> None:
    status: asyncio.Task[None] | None = None
    newest: list[Running] = []
    # Input that is not from a terminal is not meant for us.
    started = partial(_start, newest, reads_stdin=sys.stdin.isatty(), shows_tablet=True)

    def report(event: dict[str, Any]) -> None:
        nonlocal status
        _print_event(options, event)
        if event["event"] == "ready":
            if status:
                status.cancel()
            status = asyncio.ensure_future(_keep_status(newest[0]))

    try:
        run(make(report, started))
    except PhalanxError:
        status_line("")  # the error replaces the status
        raise
    end_status_line()


def _print_event(options: UpOptions, event: dict[str, Any]) -> None:
    match event["event"]:
        case "waiting":
            status_line(f"Enter: stop all  waiting for {event['broker']} ({event['trouble'] or 'no answer'})")
        case "ready":
            status_line("")
            click.echo(f"operator  {event['operator_url']}")
            if event["unreachable"]:
                talk(event["unreachable"] + " Connect it to a network, and start the command again.")
            if options.wifi:
                name = plain(options.wifi.ssid)
                click.echo(f"Wi-Fi  {name}\n{qr_text(options.wifi.code, colour=sys.stdout.isatty(), border=1)}")
            if options.qrkey and not options.frontend:
                click.echo(f"programs  {event['qrkey_url']}")
            alone = options.host in ("127.0.0.1", "localhost")
            _show_code("visitors (phones need --host 0.0.0.0)" if alone else "visitors", event["qr_url"])
        case "rotation" if options.qrkey and not options.frontend and "qrkey_url" in event:
            end_status_line()
            click.echo(f"programs  {event['qrkey_url']}")
        case "rotation":
            end_status_line()
            click.echo("a new code; the old one works for a while")
            _show_code("visitors", event["qr_url"])
        case "mission" if event["what"] != "decoded":
            end_status_line()
            click.echo(_mission_line(event))


def _mission_line(event: dict[str, Any]) -> str:
    match event["what"]:
        case "begun":
            return f"mission {plain(event['name'])}: {event['nodes']} nodes, all still encrypted"
        case "completed":
            return f"{event['who']} completed the mission"
        case _:
            return f"{event['who']} did not find the next landmark: {event['reason']}"


def _show_code(what: str, url: str) -> None:
    # One line above, two of link, twenty of code and the status line fit a terminal of 24 by 80.
    click.echo(f"{what}  {url}\n{qr_text(url, colour=sys.stdout.isatty(), border=1)}")


def _show_tablet_code(running: Running) -> None:
    """Print a code that makes one tablet an operator's."""
    ticket = running.desk.do("invite", {"role": "operate", "valid_s": TABLET_S})
    end_status_line()
    _show_code("operator's tablet (one, within ten minutes)", ticket["url"])


async def _keep_status(running: Running) -> None:
    while True:
        now = running.summary()
        minutes, seconds = divmod(int(now["rotates_in_s"]), 60)
        status_line(
            "ALL STOPPED: go and Enter releases them" if now["held"] else "Enter: stop all",
            *([] if now["connected"] else ["broker unreachable, retrying"]),
            f"new code {minutes}:{seconds:02d}",
            *(f"{now[what]} {what}" for what in ("visitors", "refused", "robots", "commands")),
            "tablet and Enter: code for the operator's tablet",
        )
        await asyncio.sleep(1)
