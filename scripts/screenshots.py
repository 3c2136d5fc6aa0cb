"""Takes the pictures of the pages in docs/img from a running gateway: `python scripts/screenshots.py`."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
from asyncio import StreamReader
from pathlib import Path

from playwright.async_api import async_playwright

from phalanx.link import QrkeyClient

IMG = Path(__file__).parent.parent / "docs" / "img"
GATEWAY = [sys.executable, "-m", "phalanx", "up", "--events", "--port", "0", "--seed", "6", "--duration", "90"]
LIAR = "Fay"


def corner(i: int, n: int) -> dict[str, float]:
    """Where robot i of n goes: a loose ring."""
    places = [(500, 450), (1000, 350), (1500, 450), (1600, 1000), (1500, 1550), (1000, 1650), (500, 1550), (400, 1000)]
    x, y = places[(i * 3) % len(places)]
    return {"x": x + 40 * (i // len(places)) + i % n, "y": y, "z": 0}


async def next_event(lines: StreamReader, kind: str) -> dict[str, object]:
    """The gateway's next event of this kind."""
    while True:
        event: dict[str, object] = json.loads(await lines.readline())
        if event["event"] == kind:
            return event


async def main() -> None:
    """One gateway, a few robots on their way, one of them compromised; a phone and an operator's screen."""
    gateway = await asyncio.create_subprocess_exec(*GATEWAY, stdout=asyncio.subprocess.PIPE)
    assert gateway.stdout is not None
    ready = await next_event(gateway.stdout, "ready")
    try:
        async with QrkeyClient(str(ready["qr_url"])) as client, async_playwright() as p:
            robots = await client.request(0)
            for i, robot in enumerate(robots[:8]):
                route = {"threshold": 60, "waypoints": [corner(i, 12), corner(i + 3, 12)]}
                await client.command(robot["address"], "waypoints", route)
            chromium = await p.chromium.launch(
                executable_path=shutil.which("chromium-headless-shell") or shutil.which("chromium"),
                args=["--no-sandbox", "--disable-gpu"],
            )
            phone = await chromium.new_page(
                viewport={"width": 390, "height": 844}, device_scale_factor=2, has_touch=True
            )
            await phone.goto(str(ready["qr_url"]))
            await phone.get_by_test_id("robot-select").select_option(index=3)
            desk = await chromium.new_page(viewport={"width": 1280, "height": 720})
            await desk.goto(str(ready["operator_url"]))
            await asyncio.sleep(9)
            await desk.get_by_test_id("victim").select_option(label=LIAR)
            await desk.get_by_test_id("attack").select_option(label="hijack")
            await desk.get_by_test_id("compromise-button").click()
            await next_event(gateway.stdout, "audit")
            await asyncio.sleep(0.6)
            await phone.screenshot(path=IMG / "visitor.png")
            await next_event(gateway.stdout, "safe_mode")
            await asyncio.sleep(1.5)
            await desk.screenshot(path=IMG / "operator.png")
            await chromium.close()
    finally:
        gateway.terminate()
        await gateway.wait()


asyncio.run(main())
