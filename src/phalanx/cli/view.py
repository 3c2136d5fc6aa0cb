"""`phalanx sim view`: a page that plays a recording, or a run that goes on."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from phalanx.errors import UsageError
from phalanx.gateway import pages_are_built
from phalanx.gateway.serve_view import ViewPages
from phalanx.net.ports import LOOPBACK
from phalanx.net.site import beside
from phalanx.recording.recorded import is_recording
from phalanx.scenarios.own import mistakes_in
from phalanx.world.scenarios.play import STEP_S, play
from phalanx.world.scenarios.run import Run
from phalanx.world.scenarios.scenes import MOST_TOLD, Live, lines_of

from .run import run
from .sim import Chosen, choose, progress, warn
from .terminal import end_status_line, said_aside, talk

Put = Callable[[dict[str, Any] | None], None]


def view(source: str, port: int, **said: Any) -> int:
    """Serves the page until it is stopped."""
    if not pages_are_built("viewer"):
        raise UsageError("the page is not built", "make setup")
    if not is_recording(Path(source)):
        chosen = choose(source, **said)
        warn(chosen.scenario)
        each = 2 + chosen.scenario.bti.tokens_needed
        seen = each * chosen.scenario.robots * chosen.scenario.duration_s / STEP_S
        if seen > MOST_TOLD:
            raise UsageError(f"{chosen.scenario.robots} robots for so long are more than a page keeps", "--duration")
        run(_served(port, lambda put, check: _live(chosen, put, check)))
        return 0
    if any(value not in (None, ()) for value in said.values()):
        raise UsageError(f"{source} is a recording, and plays as it was", "these options are for a SCENARIO")
    lines = lines_of(Path(source))
    run(_served(port, lambda put, _: deque(map(put, [*lines, None]))))
    return 0


def _live(chosen: Chosen, put: Put, check: Callable[[], None]) -> None:
    live = Live(chosen.scenario, put)
    tell = progress(chosen.scenario.duration_s)

    def on_step(run: Run) -> None:
        check()
        live.write(run, run.new_verdicts())
        tell(run)

    with said_aside(), mistakes_in(*chosen.files):
        play(chosen.scenario, None, on_step, chosen.controller, planner=chosen.planner)
    live.end()
    put(None)
    end_status_line()


async def _served(port: int, fill: Callable[[Put, Callable[[], None]], object]) -> None:
    """The page, and its run: filled in a thread of its own, so that Ctrl-C need not wait for a step."""
    loop = asyncio.get_running_loop()
    filled: asyncio.Future[None] = loop.create_future()
    stopped = False

    def check() -> None:
        if stopped:
            raise KeyboardInterrupt

    def work(put: Put) -> None:
        try:
            fill(put, check)
        except KeyboardInterrupt:
            return
        except BaseException as error:  # noqa: BLE001 - also what a researcher's file raises: told where people see it
            loop.call_soon_threadsafe(filled.set_exception, error)

    async with beside(ViewPages(port)) as pages:
        click.echo(f"http://{LOOPBACK}:{pages.port}/")
        talk("open it in a browser of this machine; Ctrl-C ends it")
        threading.Thread(target=work, args=(pages.put,), name="run", daemon=True).start()
        try:
            await filled  # for ever, if all goes well
        finally:
            stopped = True
