"""`phalanx sim view`: serve a page that plays a recording, or shows a run in progress."""

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
from phalanx.net.site import serve_in_thread
from phalanx.recording.recorded import is_recording
from phalanx.scenarios.own import mistakes_in
from phalanx.world.scenarios.play import STEP_S, run_scenario
from phalanx.world.scenarios.run import Run
from phalanx.world.scenarios.scenes import MOST_VALUES, Live, lines_of

from .run import run
from .sim import Chosen, choose, print_cautions, progress
from .terminal import end_status_line, stdout_to_stderr, talk

Put = Callable[[dict[str, Any] | None], None]


def view(source: str, port: int, **options: Any) -> int:
    """Serve the page until it is stopped."""
    if not pages_are_built("viewer"):
        raise UsageError("the page is not built", "run make setup")
    if not is_recording(Path(source)):
        chosen = choose(source, **options)
        print_cautions(chosen.scenario)
        each = 2 + chosen.scenario.bti.tokens_needed
        seen = each * chosen.scenario.robots * chosen.scenario.duration_s / STEP_S
        if seen > MOST_VALUES:
            count = chosen.scenario.robots
            raise UsageError(f"{count} robots for so long exceed the page's memory", "use a shorter --duration")
        run(_served(port, lambda put, check: _live(chosen, put, check)))
        return 0
    if any(value not in (None, ()) for value in options.values()):
        raise UsageError(f"{source} is a recording, which options cannot change", "use these options with a SCENARIO")
    lines = lines_of(Path(source))
    run(_served(port, lambda put, _: deque(map(put, [*lines, None]))))
    return 0


def _live(chosen: Chosen, put: Put, check: Callable[[], None]) -> None:
    live = Live(chosen.scenario, put)
    show_progress = progress(chosen.scenario.duration_s)

    def on_step(run: Run) -> None:
        check()
        live.write(run, run.new_verdicts())
        show_progress(run)

    with stdout_to_stderr(), mistakes_in(*chosen.files):
        run_scenario(chosen.scenario, None, on_step, chosen.controller, planner=chosen.planner)
    live.end()
    put(None)
    end_status_line()


async def _served(port: int, fill: Callable[[Put, Callable[[], None]], object]) -> None:
    """Serve the page, and fill it in a thread, so that Ctrl-C does not wait for a step."""
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
        except BaseException as error:  # noqa: BLE001 - also errors of a user's file: raised in the main thread
            loop.call_soon_threadsafe(filled.set_exception, error)

    async with serve_in_thread(ViewPages(port)) as pages:
        click.echo(f"http://{LOOPBACK}:{pages.port}/")
        talk("open this address in a browser on this machine; Ctrl-C ends it")
        threading.Thread(target=work, args=(pages.put,), name="run", daemon=True).start()
        try:
            await filled  # until cancelled, or the thread fails
        finally:
            stopped = True
