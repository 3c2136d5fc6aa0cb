"""Take the pictures of the pages in docs/img from a running gateway: `python scripts/screenshots.py`."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
from asyncio import StreamReader
from pathlib import Path

from playwright.async_api import async_playwright

IMG = Path(__file__).parent.parent / "docs" / "img"
GATEWAY = [sys.executable, "-m", "phalanx", "up", "--events", "--port", "0", "--seed", "6", "--duration", "180"]
LIAR = "Fay"


async def next_event(lines: StreamReader, kind: str) -> dict[str, object]:
    """Return the gateway's next event of this kind."""
    while True:
        event: dict[str, object] = json.loads(await lines.readline())
        if event["event"] == kind:
            return event


async def main() -> None:
    """Photograph a phone and the operator's page while robots patrol and one of them is compromised."""
    gateway = await asyncio.create_subprocess_exec(*GATEWAY, stdout=asyncio.subprocess.PIPE)
    assert gateway.stdout is not None
    ready = await next_event(gateway.stdout, "ready")
    try:
        async with async_playwright() as p:
            chromium = await p.chromium.launch(
                executable_path=shutil.which("chromium-headless-shell") or shutil.which("chromium"),
                args=["--no-sandbox", "--disable-gpu"],
            )
            phone = await chromium.new_page(
                viewport={"width": 390, "height": 844}, device_scale_factor=2, has_touch=True
            )
            await phone.goto(str(ready["qr_url"]))
            await phone.get_by_test_id("nickname").fill("Grace")
            await phone.get_by_test_id("join").click()
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
