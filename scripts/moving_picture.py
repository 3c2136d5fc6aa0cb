"""Record docs/img/phalanx.webp from the real pages: phones drive, one robot lies, its neighbours stop it.

    python scripts/moving_picture.py [--out docs/img/phalanx.webp]

A gateway runs with twelve simulated robots and the shields on. Two phones and the operator's map are photographed four
times a second and played at twice that speed. Each caption appears when the gateway reports the event that it names.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import json
import math
import sys
import tempfile
import time
from asyncio import StreamReader
from pathlib import Path

import matplotlib as mpl
from PIL import Image, ImageDraw, ImageFont
from playwright.async_api import FloatRect, Page, async_playwright

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "kit"))
from chromium import CHROMIUM, FLAGS, PHONE

ROOT = Path(__file__).parent.parent
GATEWAY = [sys.executable, "-m", "phalanx", "up", "--events", "--port", "0", "--seed", "6", "--duration", "240"]
LIAR = "Fay"
TURNS = (0.9, 1.6)
HOLD_S = 2.0
EVERY_S = 0.25
FASTER = 2
FRAME = (960, 600)
PHONE_PX = (250, 541)
MAP_PX = (400, 541)
MAP_BOX = """() => {
  document.querySelector(".map").scrollIntoView();
  const { x, y, width, height } = document.querySelector(".map").getBoundingClientRect();
  return { x, y, width, height };
}"""
MOST_BYTES = 3_000_000
FONT = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"


class Film:
    """Pictures of pages, or of the given part of one, side by side with a caption below."""

    def __init__(self, pages: list[tuple[Page, tuple[int, int], FloatRect | None]]) -> None:
        self._pages = pages
        self._font = ImageFont.truetype(str(FONT), 22)
        self.frames: list[Image.Image] = []
        self.caption = ""

    async def record(self, seconds: float) -> None:
        """Photograph the pages for so long."""
        until_s = time.monotonic() + seconds
        while (began_s := time.monotonic()) < until_s:
            await self._take()
            await asyncio.sleep(max(0.0, began_s + EVERY_S - time.monotonic()))

    async def record_until(self, event: asyncio.Task[object]) -> None:
        """Photograph the pages until the gateway has reported it."""
        while not event.done():
            await self.record(EVERY_S)

    async def _take(self) -> None:
        shots = await asyncio.gather(*(page.screenshot(clip=clip) for page, _, clip in self._pages))
        frame = Image.new("RGB", FRAME, "white")
        x = 10
        for shot, (_, size, _) in zip(shots, self._pages, strict=True):
            picture = Image.open(io.BytesIO(shot)).convert("RGB")
            picture.thumbnail(size, Image.Resampling.LANCZOS)
            frame.paste(picture, (x, 8 + (size[1] - picture.height) // 2))
            x += size[0] + 20
        ImageDraw.Draw(frame).text((FRAME[0] / 2, FRAME[1] - 24), self.caption, "black", self._font, anchor="mm")
        self.frames.append(frame)

    def save(self, path: Path) -> None:
        """Write an animated WebP that repeats."""
        first, *others = self.frames
        shown_ms = round(1000 * EVERY_S / FASTER)
        first.save(path, save_all=True, append_images=others, duration=shown_ms, loop=0, quality=55, method=6)


async def next_event(lines: StreamReader, kind: str) -> dict[str, object]:
    """Return the gateway's next event of this kind."""
    while True:
        event: dict[str, object] = json.loads(await lines.readline())
        if event["event"] == kind:
            return event


async def joined(page: Page, url: str, name: str, robot: int) -> None:
    """Join under a name and choose a robot by its place in the list."""
    await page.goto(url)
    await page.get_by_test_id("nickname").fill(name)
    await page.get_by_test_id("join").click()
    select = page.get_by_test_id("robot-select")
    await select.locator("option").nth(robot).wait_for(state="attached")
    await select.select_option(index=robot)


async def drive(page: Page, turn: float) -> None:
    """Hold the joystick and lead it round, until cancelled."""
    box = await page.get_by_test_id("joystick").bounding_box()
    assert box is not None
    x, y, radius = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, box["width"] * 0.35
    began_s = held_s = time.monotonic()
    while True:
        if time.monotonic() >= held_s:  # a page lets go when another one is clicked
            await page.mouse.up()
            await page.mouse.move(x, y)
            await page.mouse.down()
            held_s = time.monotonic() + HOLD_S
        angle = turn * math.sin((time.monotonic() - began_s) / 1.5)
        await page.mouse.move(x + radius * math.sin(angle), y - radius * math.cos(angle))
        await asyncio.sleep(0.2)


async def recorded(state: str) -> Film:
    """Return the film of a gateway with this state folder."""
    gateway = await asyncio.create_subprocess_exec(*GATEWAY, "--state", state, stdout=asyncio.subprocess.PIPE)
    assert gateway.stdout is not None
    try:
        ready = await next_event(gateway.stdout, "ready")
        async with async_playwright() as playwright:
            chromium = await playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, "--no-sandbox"])
            phones = [await (await chromium.new_context(**PHONE)).new_page() for _ in range(2)]
            desk = await chromium.new_page(viewport={"width": 1280, "height": 720})
            await joined(phones[0], str(ready["qr_url"]), "Grace", 2)
            await joined(phones[1], str(ready["qr_url"]), "Linus", 5)
            await desk.goto(str(ready["operator_url"]))
            await desk.locator(".map").wait_for()
            box = await desk.evaluate(MAP_BOX)
            film = Film([*((phone, PHONE_PX, None) for phone in phones), (desk, MAP_PX, box)])
            driving = [asyncio.create_task(drive(*each)) for each in zip(phones, TURNS, strict=True)]
            film.caption = "Visitors scan a code and drive."
            await film.record(7)
            await desk.get_by_test_id("victim").select_option(label=LIAR)
            await desk.get_by_test_id("attack").select_option(label="hijack")
            await desk.get_by_test_id("compromise-button").click()
            film.caption = f"{LIAR} is taken over and drives where it likes."
            await film.record_until(asyncio.create_task(next_event(gateway.stdout, "audit")))
            film.caption = f"Its neighbours replay its log and refuse to vouch for {LIAR}."
            await film.record_until(asyncio.create_task(next_event(gateway.stdout, "safe_mode")))
            film.caption = f"{LIAR} is stopped. All others go on."
            await film.record(6)
            for each in driving:
                each.cancel()
            await chromium.close()
    finally:
        gateway.terminate()
        await gateway.wait()
    return film


def main() -> int:
    """Record and save; return 1 if the file is too large."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "img" / "phalanx.webp")
    out: Path = parser.parse_args().out
    with tempfile.TemporaryDirectory() as state:
        film = asyncio.run(recorded(state))
    film.save(out)
    size = out.stat().st_size
    print(f"{out}: {len(film.frames)} pictures, {size / 1e6:.2f} MB")
    return int(size > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
