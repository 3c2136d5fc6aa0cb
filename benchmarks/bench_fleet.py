"""A thousand robots in motion before two hundred visitors: what it costs the gateway, and whether it arrives.

The gateway is `phalanx up` as people run it. One visitor is the page in chromium; the others, in one program, open
every message by the library of the pages (fleet_visitors.mts). Everything shares this machine's cores, but real
visitors bring their own: so these work with Node's cryptography, and yield to the gateway, the broker and the page.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import statistics
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from playwright.async_api import Page, async_playwright
from processes import children, cpu_s, in_line_s, machine_s, name, rss_mb
from rows import Row

from phalanx.gateway import pages_are_built
from phalanx.gateway.gateway import TICK_S

HERE = Path(__file__).parent
TSX = HERE.parent / "web" / "node_modules" / "tsx" / "dist" / "loader.mjs"
YIELDING = ("nice", "-n", "5")
IMPORTS = ("--import", str(TSX), "--import", str(HERE / "native_jwe.mjs"))
VISITORS = (*YIELDING, "node", *IMPORTS, str(HERE / "fleet_visitors.mts"))
MOST_CORES = 0.5
LEAST_FPS = 30.0
LEAST_TICKS_HZ = 9.5
MOST_OTHERS = 0.3
LEAST_CHANGES_HZ = 5.0
MOST_GROWTH = 0.05
# Shorter soaks say nothing about memory.
JUDGE_MEMORY_S = 300.0
MINUTE_S = 60.0
# A visitor keeps up if nothing is missed, and nothing older than this when it is opened.
FRESH_S = 2.0
ROUTES_PER_S = 100
# As phones see it: an address that browsers do not take for secure, and so without their own cryptography.
HOST = "swarm.test"
CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
FLAGS = ["--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update"]
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
# Counts animation frames by second, and ten times a second whether the map looks different and the badge says live.
WATCH = """() => {
  const seen = window.__seen = {frames: [], samples: 0, changes: 0, live: 0, robots: 0};
  const began = performance.now();
  const count = () => {
    const second = Math.floor((performance.now() - began) / 1000);
    while (seen.frames.length <= second) seen.frames.push(0);
    seen.frames[second] += 1;
    requestAnimationFrame(count);
  };
  requestAnimationFrame(count);
  const small = new OffscreenCanvas(96, 96).getContext("2d", {willReadFrequently: true});
  const map = [...document.querySelectorAll("canvas")].at(-1);
  let before = "";
  setInterval(() => {
    small.clearRect(0, 0, 96, 96);
    small.drawImage(map, 0, 0, 96, 96);
    const picture = small.getImageData(0, 0, 96, 96).data.join();
    const badge = document.querySelector("[data-testid=badge]");
    seen.samples += 1;
    seen.changes += picture !== before ? 1 : 0;
    seen.live += badge?.dataset.state === "live" ? 1 : 0;
    seen.robots = parseInt(badge?.innerText.match(/\\d+/)?.[0] ?? "0", 10);
    before = picture;
  }, 100);
}"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """How large.

    Args:
        robots: simulated ones.
        visitors: programs; the page comes on top.
        join_per_s: visitors per second.
        warm_up_s: from the last robot's departure to the first measurement.
    """

    robots: int
    visitors: int
    join_per_s: float
    warm_up_s: float


FULL = Fleet(robots=1000, visitors=199, join_per_s=16, warm_up_s=20)
QUICK = Fleet(robots=20, visitors=4, join_per_s=50, warm_up_s=0.5)
# Trails grow for about as long, robot by robot, until each is as long as it may be.
TRAILS_FULL_S = 150.0


class Child:
    """A program that talks JSON by lines."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.pid = process.pid
        self._process = process

    async def hear(self, timeout_s: float = 60.0) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = await asyncio.wait_for(self._process.stdout.readline(), timeout_s)
        if not line:
            raise RuntimeError("a child of the benchmark ended")
        words: dict[str, Any] = json.loads(line)
        return words

    async def hear_no_more(self) -> None:
        assert self._process.stdout is not None
        while await self._process.stdout.read(1 << 16):
            pass

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")


@contextlib.asynccontextmanager
async def a_child(*command: str) -> AsyncIterator[Child]:
    process = await asyncio.create_subprocess_exec(
        *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=1 << 24
    )
    try:
        yield Child(process)
    finally:
        if process.returncode is None:
            process.terminate()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), 5)
            if process.returncode is None:
                process.kill()
                await process.wait()


@contextlib.asynccontextmanager
async def a_page(url: str) -> AsyncIterator[Page]:
    """The visitors' page in chromium, live."""
    flags = [*FLAGS, f"--host-resolver-rules=MAP {HOST} 127.0.0.1", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        try:
            page = await (await browser.new_context(**PHONE)).new_page()
            await page.goto(url.replace("http://127.0.0.1", f"http://{HOST}", 1))
            await page.locator("[data-testid=badge][data-state=live]").wait_for(timeout=30_000)
            yield page
        finally:
            await browser.close()


class Usage:
    """CPU by group of processes, and what the gateway had of processors and memory, while the fleet runs."""

    def __init__(self, gateway: int, groups: dict[str, Callable[[], list[int]]]) -> None:
        self._gateway = gateway
        self._groups = groups
        self._began: dict[str, dict[int, float]] = {}
        self._at = self._machine_s = self._in_line_s = 0.0
        self.cores: dict[str, float] = {}
        self.in_line = 0.0
        self.memory: list[tuple[float, float]] = []

    def begin(self) -> None:
        self._at, self._machine_s = time.monotonic(), machine_s()
        self._began = {group: {pid: cpu_s(pid) for pid in pids()} for group, pids in self._groups.items()}
        self._in_line_s = in_line_s(self._gateway)

    def end(self) -> None:
        elapsed_s = time.monotonic() - self._at
        for group, began in self._began.items():
            self.cores[group] = sum(cpu_s(pid) - before for pid, before in began.items()) / elapsed_s
        self.in_line = (in_line_s(self._gateway) - self._in_line_s) / elapsed_s
        self.cores["all else here"] = (machine_s() - self._machine_s) / elapsed_s - sum(self.cores.values())

    async def watch_memory(self) -> None:
        began = time.monotonic()
        while True:
            self.memory.append((time.monotonic() - began, rss_mb(self._gateway)))
            await asyncio.sleep(1)


async def bench_fleet(fleet: Fleet, soak_s: float, say: Callable[[str], None]) -> list[Row]:
    if not pages_are_built() or not CHROMIUM or not TSX.exists():
        raise RuntimeError("the pages, their tools or chromium are missing: make setup-dev")
    say(f"{fleet.robots} robots, {fleet.visitors} visitors and a page")
    up = (sys.executable, "-m", "phalanx", "up", "--broker", "mosquitto", "--qrkey", "--events", "--port", "0")
    up = (*up, "--robots", str(fleet.robots))
    async with contextlib.AsyncExitStack() as stack:
        gateway = await stack.enter_async_context(a_child(*up))
        ready = await gateway.hear()
        background = [asyncio.create_task(gateway.hear_no_more())]
        crowd = await stack.enter_async_context(a_child(*VISITORS))
        order = {
            "qr": ready["qr_url"],
            "visitors": fleet.visitors,
            "join_per_s": fleet.join_per_s,
            "routes_per_s": ROUTES_PER_S,
        }
        crowd.say(json.dumps(order))
        await crowd.hear(120)
        page = await stack.enter_async_context(a_page(ready["qr_url"]))
        say("everybody is there; every robot gets a route")
        crowd.say("go")
        await crowd.hear()
        await asyncio.sleep(fleet.robots / ROUTES_PER_S)
        warm_up_s = TRAILS_FULL_S if soak_s >= JUDGE_MEMORY_S else fleet.warm_up_s
        say(f"warming up for {warm_up_s:g} s, then measuring for {soak_s:g} s")
        await asyncio.sleep(warm_up_s)
        usage = Usage(
            gateway.pid,
            {
                "gateway": lambda: [gateway.pid],
                "mosquitto": lambda: [pid for pid in children(gateway.pid) if name(pid) == "mosquitto"],
                "visitors": lambda: [crowd.pid],
                "page": lambda: [pid for pid in children(os.getpid()) if name(pid).startswith("chrom")],
            },
        )
        usage.begin()
        crowd.say("begin")
        await crowd.hear()
        await page.evaluate(WATCH)
        background.append(asyncio.create_task(usage.watch_memory()))
        await asyncio.sleep(soak_s)
        usage.end()
        crowd.say("end")
        # A crowd that lags reads what it was sent before it reads this.
        report = await crowd.hear(300)
        seen = await page.evaluate("window.__seen")
        for task in background:
            task.cancel()
    if (others := usage.cores["all else here"]) > MOST_OTHERS:
        say(f"something else on this machine used {others:.2f} cores: what was measured is not its best")
    return _rows(fleet, soak_s, usage, report, seen)


def _rows(fleet: Fleet, soak_s: float, usage: Usage, report: dict[str, Any], seen: dict[str, Any]) -> list[Row]:
    cores = usage.cores
    beside = ", ".join(f"{group} {used:.2f}" for group, used in cores.items() if group != "gateway")
    seconds = sorted(seen["frames"][1:-1] or seen["frames"])
    return [
        Row(
            section=3,
            what=f"gateway, {fleet.robots} robots and {fleet.visitors + 1} visitors",
            measured=cores["gateway"],
            unit="cores",
            limit=MOST_CORES,
            note=f"over {soak_s:g} s; beside it {beside}; of {os.cpu_count()}",
        ),
        Row(
            section=3,
            what="page: animation frames, all but the worst 5 % of seconds",
            measured=seconds[len(seconds) // 20],
            unit="/s",
            limit=LEAST_FPS,
            at_least=True,
            note=f"median {statistics.median(seconds):g}, worst second {seconds[0]}",
        ),
        Row(
            section=3,
            what="page: the map looks different",
            measured=10 * seen["changes"] / seen["samples"],
            unit="/s",
            limit=LEAST_CHANGES_HZ,
            at_least=True,
            note=f"looked at 10 times a second; badge live in {seen['live']} of {seen['samples']}, "
            f"{seen['robots']} robots",
        ),
        *_visitor_rows(fleet, report),
        Row(
            section=0,
            what="gateway had work and waited for a core",
            measured=100 * usage.in_line,
            unit="% of time",
            note="what a machine with more cores would spare it",
        ),
        Row(
            section=0,
            what="a visitor's work with a message",
            measured=1e6 * report["cpu_s"] / max(1, report["messages"]),
            unit="µs",
            note="in Node, AES-GCM and base64url by Node itself; at a lower priority than all the rest",
        ),
        *_memory_rows(soak_s, usage.memory),
    ]


def _visitor_rows(fleet: Fleet, report: dict[str, Any]) -> list[Row]:
    # Its own clock: a crowd that lags hears of the end late.
    each, elapsed_s = report["each"], report["elapsed_s"]
    kept_up = sum(got > 0 and missed == 0 and worst_age_s <= FRESH_S for got, missed, worst_age_s, _ in each)
    frames, missed, rejected = report["frames"], report["missed"], report["rejected"]
    ages_ms = sorted(Counter({int(age): count for age, count in report["ages_ms"].items()}).elements()) or [0]
    return [
        Row(
            section=3,
            what="updates of the whole swarm, as visitors saw them",
            measured=statistics.median(ticks for _, _, _, ticks in each) / elapsed_s,
            unit="/s",
            limit=LEAST_TICKS_HZ,
            at_least=True,
            note=f"planned {1 / TICK_S:g}; {report['messages'] / elapsed_s / len(each):.1f} messages/s to each",
        ),
        Row(
            section=3,
            what="visitors that opened every frame within 2 s",
            measured=kept_up,
            unit=f"of {fleet.visitors}",
            limit=fleet.visitors,
            at_least=True,
            note=f"{frames / elapsed_s:.0f} frames/s opened, {100 * missed / max(1, frames + missed):.2f} % missed "
            f"in {report['gaps']} gaps, {report['cut_off']} cut off",
        ),
        Row(
            section=0,
            what="age of a frame when opened, p50",
            measured=statistics.median(ages_ms),
            unit="ms",
            note=f"p95 {ages_ms[len(ages_ms) * 95 // 100]}, worst {ages_ms[-1]}",
        ),
        Row(
            section=0,
            what="rejected by visitors",
            measured=sum(rejected.values()),
            unit="",
            note=", ".join(f"{count} {reason}" for reason, count in rejected.items())
            or f"the list of robots was asked {report['asked']} times and answered {report['answered']}",
        ),
    ]


def _memory_rows(soak_s: float, memory: list[tuple[float, float]]) -> list[Row]:
    first = statistics.fmean([mb for at, mb in memory if at <= MINUTE_S])
    last = statistics.fmean([mb for at, mb in memory if at >= memory[-1][0] - MINUTE_S])
    slope = statistics.linear_regression(*zip(*memory, strict=True)).slope if len(memory) > 2 else 0.0
    judged = soak_s >= JUDGE_MEMORY_S
    why_not = f"; judged from {JUDGE_MEMORY_S / 60:g} minutes on: --soak-minutes 10"
    return [
        Row(
            section=3,
            what="gateway's memory, last minute over first",
            measured=last / first,
            unit="times",
            limit=1 + MOST_GROWTH if judged else None,
            note=f"{first:.1f} MB to {last:.1f} MB, {slope * 60:+.2f} MB a minute{'' if judged else why_not}",
        )
    ]
