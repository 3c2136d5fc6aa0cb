"""`phalanx doctor`: what is here, what is missing, what to do about it."""

from __future__ import annotations

import asyncio
import importlib.util
import shutil
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from phalanx.config import LinkConfig
from phalanx.errors import PhalanxError, UsageError
from phalanx.experiments.figure import MATPLOTLIB_HINT
from phalanx.gateway import pages_are_built
from phalanx.gateway.up import DEFAULT_PORT
from phalanx.io import Server, parse_broker_url
from phalanx.io.broker import AMQTT_LACKS, BROKER_HINT, for_browsers, has_amqtt
from phalanx.io.mosquitto import find_mosquitto
from phalanx.io.phones import PhonesDoor
from phalanx.io.ports import LOOPBACK, is_free, lan_address

from .login import read_login, visitors_login_in
from .terminal import print_json

RELEASED_S = 1_767_225_600  # 2026-01-01: a clock before this is wrong
SYNCHRONIZED = Path("/run/systemd/timesync/synchronized")


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what was looked at, whether it is well, and what to do if not."""

    what: str
    ok: bool
    found: str
    fix: str = ""


def doctor(
    broker: str | None,
    broker_ws: str,
    root: str,
    broker_login: Path | None,
    visitors_login: Path | None,
    as_json: bool,
) -> int:
    """Prints a line for each finding; 1 if something has to be mended."""
    if not broker and (broker_ws or broker_login or visitors_login):
        raise UsageError("no broker to try", "--broker URL")
    login = read_login(broker_login) if broker else None
    url = parse_broker_url(broker, login) if broker else None
    visitors = visitors_login_in(visitors_login, login)
    findings = [_python(), _broker(), _pages(), _figures(), *_ports(), _address(), _clock()]
    if url:
        config = LinkConfig(root=root)
        websocket = for_browsers(broker_ws)
        server = Server(url, config=config, broker_for_visitors=websocket, login_for_visitors=visitors)
        findings += asyncio.run(_reach(server, str(url)))
    if as_json:
        print_json({"findings": [asdict(finding) for finding in findings]})
    else:
        for finding in findings:
            click.echo(
                f"{'ok ' if finding.ok else 'fix'}  {finding.what:22} {finding.found}"
                + (f"  →  {finding.fix}" if finding.fix else "")
            )
    return 0 if all(finding.ok for finding in findings) else 1


def _python() -> Finding:
    ok = sys.version_info >= (3, 11)
    return Finding("python", ok, ".".join(map(str, sys.version_info[:3])), "" if ok else "3.11 or newer")


def _broker() -> Finding:
    path = find_mosquitto()
    if path:
        return Finding("embedded broker", True, f"mosquitto at {path}")
    if has_amqtt():
        return Finding("embedded broker", True, f"amqtt, {AMQTT_LACKS}", "apt-get install mosquitto")
    return Finding("embedded broker", False, "none: phalanx up needs --broker URL", BROKER_HINT)


def _pages() -> Finding:
    built = pages_are_built()
    return Finding(
        "pages", built, "built" if built else "not built", "" if built else "make setup (needs node 20.19 and npm)"
    )


def _figures() -> Finding:
    there = importlib.util.find_spec("matplotlib") is not None
    found = "matplotlib" if there else "no matplotlib: phalanx reproduce measures and draws nothing, mission draw fails"
    return Finding("figures", True, found, "" if there else MATPLOTLIB_HINT)


def _ports() -> list[Finding]:
    uses = {DEFAULT_PORT: "visitors' page", 1883: "broker", 9001: "broker, websocket"}
    return [
        Finding(
            f"port {port}",
            True,
            f"free ({use})" if is_free(port) else f"in use ({use}): another one will be taken",
        )
        for port, use in uses.items()
    ]


def _address() -> Finding:
    address = lan_address()
    if address == LOOPBACK:
        return Finding(
            "address", True, "no network: only this machine can visit", "connect it, then phalanx up --host 0.0.0.0"
        )
    return Finding("address", True, f"{address}: phones reach it with phalanx up --host 0.0.0.0")


def _clock() -> Finding:
    now = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    if time.time() < RELEASED_S:
        return Finding("clock", False, now, "set it: messages more than 30 s off are refused")
    if SYNCHRONIZED.exists():
        return Finding("clock", True, f"{now}, synchronized")
    keeper = next((name for name in ("chronyc", "ntpq") if shutil.which(name)), None)
    if keeper:
        return Finding("clock", True, f"{now}, kept by {keeper}")
    return Finding("clock", True, f"{now}, not known to be synchronized: messages more than 30 s off are refused")


async def _reach(server: Server, url: str) -> list[Finding]:
    """The broker for the gateway, and for phones; what they say is answered, if the gateway is in."""
    door = PhonesDoor(server)
    try:
        async with server:
            await server.wait_connected(3)
            here = Finding("broker", True, f"{url} answers, MQTT {'5' if server.qr().mqtt == 5 else '3.1.1'}")
            return [here, await _phones(server, door)]
    except TimeoutError:
        here = Finding(
            "broker", False, f"{url}: {server.trouble or 'no answer'}", "check host, port, firewall, TLS or not"
        )
    except PhalanxError as error:
        here = Finding("broker", False, str(error), getattr(error, "hint", ""))
    return [here, await _phones(server, door)]


async def _phones(server: Server, door: PhonesDoor) -> Finding:
    trouble, hint = await door.trouble()
    through = "what they say and are told gets through" if server.connected else "what gets through was not tried"
    well = f"{server.broker_for_visitors} lets them in; {through}"
    return Finding("broker, for phones", not trouble, trouble or well, hint)
