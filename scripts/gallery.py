"""Take the pictures of docs/gallery.md from `phalanx sim view`: `python scripts/gallery.py`."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

IMG = Path(__file__).parent.parent / "docs" / "img"
VIEW = [sys.executable, "-m", "phalanx", "sim", "view"]
# Name, command, and time of the picture, s.
PICTURES = (
    ("refused", ("bti-fig9", "--duration", "40"), 18.3),
    ("stopped", ("bti-fig9", "--duration", "40"), 40),
    ("undefended", ("bti-fig8", "--duration", "40"), 40),
    ("warehouse", ("warehouse", "--duration", "40"), 40),
)
ZOOMS = {"refused": 3}  # scale: these robots stand close together

with sync_playwright() as playwright:
    chromium = playwright.chromium.launch(
        executable_path=shutil.which("chromium-headless-shell") or shutil.which("chromium"),
        args=["--no-sandbox", "--disable-gpu"],
    )
    for name, words, at_s in PICTURES:
        with subprocess.Popen([*VIEW, *words], stdout=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None
            page = chromium.new_page(viewport={"width": 390, "height": 844})
            page.goto(running.stdout.readline().strip())
            page.get_by_text("s are here").wait_for(timeout=600_000)
            page.get_by_role("button", name="Pause").click()
            page.get_by_label("Time").fill(str(at_s))
            if name in ZOOMS:  # the robots are in the lower corner
                page.mouse.move(100, 350)
                page.keyboard.down("Control")
                page.mouse.wheel(0, -75 * ZOOMS[name])
                page.keyboard.up("Control")
            page.wait_for_timeout(700)
            page.locator(".map").screenshot(path=IMG / f"gallery-{name}.png")
            page.close()
            running.send_signal(signal.SIGINT)
    chromium.close()
