"""`phalanx up`."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Any

import click

from phalanx.config import LinkConfig
from phalanx.errors import UsageError
from phalanx.gateway import pages_are_built
from phalanx.gateway.simulated import DEFENCES
from phalanx.gateway.up import Running, UpOptions
from phalanx.gateway.up import up as run_gateway

from .options import broker_options, link_options, read_login
from .run import run
from .terminal import EventLines, end_status_line, qr_text, status_line


@click.command(epilog="Example: phalanx up --host 0.0.0.0 --robots 20")
@link_options
@click.option("--robots", type=int, default=12, show_default=True, help="Simulated robots.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the robots' places and batteries.")
@click.option(
    "--defence",
    type=click.Choice(DEFENCES),
    help="What robots do about liars among them: audit each other (bound), as the paper has it, or nothing."
    "  [default: bound, for up to 100 robots]",
)
@click.option(
    "--f-max",
    type=click.IntRange(1, 15),
    help="Liars that are tolerated at a time.  [default: 3, or what so few robots allow]",
)
@broker_options
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on for visitors; 0.0.0.0 for all."
)
@click.option("--port", type=click.IntRange(0, 65535), help="Of the visitors' page.  [default: 8080, or any free one]")
@click.option("--page-url", default="", help="Where visitors find our page, if not here: behind an https proxy, say.")
@click.option("--frontend", default="", help="Send visitors to this page of the published kind instead of ours.")
@click.option("--duration", type=click.FloatRange(min=0, min_open=True), help="End after so many seconds.")
@click.option("--events", is_flag=True, help="Print one JSON object a line instead of a QR code; the first is 'ready'.")
def up(
    mode: str,  # noqa: ARG001  # one value until the session mode exists
    pin_digits: int,
    rotate_s: float,
    overlap_s: float,
    root: str,
    robots: int,
    seed: int,
    defence: str | None,
    f_max: int | None,
    broker: str,
    broker_ws: str,
    broker_login: Path | None,
    host: str,
    port: int | None,
    page_url: str,
    frontend: str,
    duration: float | None,
    events: bool,
) -> None:
    """Run a gateway: an embedded broker, a simulated swarm, the visitors' page and its QR code.

    Ctrl-C ends it.
    """
    if seed < 0:
        raise UsageError(f"seed {seed} is negative", "0 or more")
    options = UpOptions(
        robots=robots,
        seed=seed,
        defence=defence,
        f_max=f_max,
        broker=broker,
        broker_ws=broker_ws,
        login=read_login(broker_login),
        host=host,
        port=port,
        page_url=page_url,
        frontend=frontend,
        duration_s=duration,
        link=LinkConfig(root=root, pin_digits=pin_digits, rotate_s=rotate_s, overlap_s=overlap_s),
    )
    if not pages_are_built():
        click.echo("phalanx: warning: the pages are not built, phones will find nothing; run: make setup", err=True)
    if events:
        lines = EventLines()
        try:
            run(run_gateway(options, lines, talk=_talk))
        finally:
            lines.close()
    else:
        _run_for_people(options)


def _talk(words: str) -> None:
    click.echo(f"phalanx: {words}", err=True)


def _run_for_people(options: UpOptions) -> None:
    watch: list[asyncio.Task[None]] = []

    def say(event: dict[str, Any]) -> None:
        match event["event"]:
            case "ready":
                click.echo(f"operator  {event['operator_url']}")
                alone = options.host in ("127.0.0.1", "localhost")
                _show_code("visitors (phones need --host 0.0.0.0)" if alone else "visitors", event["qr_url"])
            case "waiting":
                click.echo(f"waiting for the broker at {event['broker']} ({event['trouble'] or 'no answer'})", err=True)
            case "rotation":
                end_status_line()
                click.echo("a new code; the old one works for a while yet")
                _show_code("visitors", event["qr_url"])

    def started(running: Running) -> None:
        watch.append(asyncio.ensure_future(_keep_status(running)))

    run(run_gateway(options, say, started, talk=_talk))
    end_status_line()


def _show_code(what: str, url: str) -> None:
    # One line above it, two of link, twenty of code and the status line below: a terminal of 24 by 80.
    click.echo(f"{what}  {url}\n{qr_text(url, colour=sys.stdout.isatty(), border=1)}")


async def _keep_status(running: Running) -> None:
    while True:
        now = running.summary()
        minutes, seconds = divmod(int(now["rotates_in_s"]), 60)
        status_line(
            f"{now['robots']} robots   {now['visitors']} visitors   {now['commands']} commands   "
            f"{now['rejected']} refused   new code in {minutes}:{seconds:02d}"
            + ("" if now["connected"] else "   broker away, trying again")
        )
        await asyncio.sleep(1)
