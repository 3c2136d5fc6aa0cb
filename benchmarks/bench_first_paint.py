"""How soon a phone on slow Wi-Fi shows something, and then the live map.

    python benchmarks/bench_first_paint.py [--runs 5] [--robots 12]

A real browser opens the visitors' page of a running gateway through a proxy that carries everything, the websocket
too, at 400 kbit/s in each direction with 300 ms for a round trip. Each run starts with an empty cache.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Browser, sync_playwright
from rows import Row, print_table

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "kit"))
from chromium import CHROMIUM, FLAGS, PHONE, insecure

BYTES_PER_S = 400_000 / 8
ROUND_TRIP_S = 0.3
PIECE_BYTES = 1460
FIRST_PAINT_S, LIVE_S = 1.0, 3.5
PAINTED = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
# In the page itself: Playwright looks again after up to half a second. Times are since the page was asked for.
JOIN_AND_WATCH = """
window.liveAt = new Promise((resolve) => {
  const look = () => {
    const join = document.querySelector("[data-testid=join]");
    if (join && !window.hasJoined) {
      window.hasJoined = true;
      join.click();
    }
    if (document.querySelector("[data-testid=badge][data-state=live]")) resolve(performance.now());
  };
  new MutationObserver(look).observe(document, { subtree: true, childList: true, attributes: true });
});
"""


class Direction:
    """One direction of the line, shared by all connections: bytes wait for those before them, then for the way."""

    def __init__(self) -> None:
        self._free_at_s = 0.0

    def arrival_s(self, count: int) -> float:
        """Return when so many bytes that are sent now arrive."""
        self._free_at_s = max(self._free_at_s, time.monotonic()) + count / BYTES_PER_S
        return self._free_at_s + ROUND_TRIP_S / 2


async def carry(reading: asyncio.StreamReader, writing: asyncio.StreamWriter, direction: Direction) -> None:
    """Carry one direction of a connection until it ends."""
    pieces: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(16)

    async def deliver() -> None:
        while (piece := await pieces.get())[1]:
            await asyncio.sleep(piece[0] - time.monotonic())
            if not writing.is_closing():
                writing.write(piece[1])
        writing.close()

    delivering = asyncio.create_task(deliver())
    with contextlib.suppress(ConnectionError):
        while data := await reading.read(PIECE_BYTES):
            await pieces.put((direction.arrival_s(len(data)), data))
    await pieces.put((0.0, b""))
    await delivering


@contextlib.contextmanager
def a_gateway(robots: str):
    """Yield the "ready" event of a gateway in a process of its own."""
    with (
        tempfile.TemporaryDirectory() as state,
        subprocess.Popen(
            (sys.executable, "-m", "phalanx", "up", "--events", "--port", "0", "--robots", robots, "--state", state),
            stdout=subprocess.PIPE,
            text=True,
        ) as gateway,
    ):
        try:
            yield next(event for line in gateway.stdout if (event := json.loads(line))["event"] == "ready")
        finally:
            gateway.terminate()


@contextlib.contextmanager
def slow_line(port: int):
    """Yield the port of a proxy to `port`, in a thread of its own: Playwright blocks this one."""
    up, down, its_port, over = Direction(), Direction(), Future[int](), threading.Event()

    async def connection(reading: asyncio.StreamReader, writing: asyncio.StreamWriter) -> None:
        await asyncio.sleep(ROUND_TRIP_S)  # loopback shook hands at once
        there = await asyncio.open_connection("127.0.0.1", port)
        with contextlib.suppress(asyncio.CancelledError):  # the end of the run
            await asyncio.gather(carry(reading, there[1], up), carry(there[0], writing, down))

    async def serve() -> None:
        server = await asyncio.start_server(connection, "127.0.0.1", 0)
        its_port.set_result(server.sockets[0].getsockname()[1])
        await asyncio.to_thread(over.wait)

    with ThreadPoolExecutor(1) as elsewhere:
        elsewhere.submit(asyncio.run, serve())
        try:
            yield its_port.result()
        finally:
            over.set()


def opened(browser: Browser, url: str) -> tuple[float, float]:
    """Return seconds to the first paint and to the live map of a page with an empty cache, joined at once."""
    context = browser.new_context(**PHONE)
    try:
        context.add_init_script(JOIN_AND_WATCH)
        page = context.new_page()
        page.goto(url, wait_until="commit")
        live_ms = page.evaluate("window.liveAt")
        return page.evaluate(PAINTED) / 1000, live_ms / 1000
    finally:
        context.close()


def main() -> int:
    """Print both times beside their limits; ends with 1 if one is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--robots", default="12")
    options = parser.parse_args()
    with a_gateway(options.robots) as ready, sync_playwright() as playwright:
        at = urlsplit(ready["qr_url"])
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, "--no-sandbox"])
        with slow_line(at.port) as port:
            url = insecure(at._replace(netloc=f"127.0.0.1:{port}").geturl())
            times = [opened(browser, url) for _ in range(options.runs)]
        browser.close()
    line = f"median of {options.runs}; 400 kbit/s, 300 ms round trip"
    rows = [
        Row(section=0, what=what, measured=statistics.median(each), unit="s", limit=limit, note=line)
        for what, each, limit in zip(
            ("first paint", "live map"), zip(*times, strict=True), (FIRST_PAINT_S, LIVE_S), strict=True
        )
    ]
    print_table(rows)
    return int(not all(row.holds for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
