"""A page in a real browser, on an insecure origin as phones see it (the fixture `browser` is in conftest.py)."""

from __future__ import annotations

import re
import shutil
from contextlib import contextmanager
from pathlib import Path

# Not 127.0.0.1: browsers count that as secure, and a phone that opens http://192.168.1.7 has no WebCrypto.
HOST = "swarm.test"
# The shell has the same engine and no windows: a page takes half of the processor time.
CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
FLAGS = [
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--host-resolver-rules=MAP {HOST} 127.0.0.1",
]
# Pixels of one of the map's layers that have the colour of a variable of the stylesheet.
COUNT = """([layer, name]) => {
  const colour = getComputedStyle(document.body).getPropertyValue(name).trim();
  const wanted = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  const canvas = document.querySelectorAll("canvas.map-layer")[layer];
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3] > (layer ? 60 : 200) && wanted.every((value, k) => Math.abs(data[i + k] - value) <= 4)) count += 1;
  }
  return count;
}"""
STOP = dict.fromkeys(("left_x", "left_y", "right_x", "right_y"), 0)  # in a session it has no payload
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
BUZZED = "window.buzzed = []; navigator.vibrate = (pattern) => { window.buzzed.push(pattern); return true; };"
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@contextmanager
def a_page(browser, *scripts: str, **options):
    """A page of its own browser context that fails the test if it logs an error or breaks its policy.

    It draws no motion, half of what a browser computes, unless `reduced_motion="no-preference"` is among the options.
    """
    context = browser.new_context(**({"reduced_motion": "reduce"} | (options or PHONE)))
    for script in scripts:
        context.add_init_script(script)
    page = context.new_page()
    trouble: list[str] = []
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on(
        "console",
        lambda message: (
            trouble.append(message.text)
            if message.type == "error" and not re.search("WebSocket connection|ERR_|status of 401", message.text)
            else None
        ),
    )
    try:
        yield page
        assert not trouble
    finally:
        context.close()


def insecure(url: str) -> str:
    return url.replace("http://127.0.0.1", f"http://{HOST}", 1)


def join(page, url: str, name: str = "") -> None:
    """Scan a session's code, and take this nickname or the one that is proposed."""
    page.goto(insecure(url))
    if name:
        page.get_by_test_id("nickname").fill(name)
    page.get_by_test_id("join").click()


def badge(page, state: str, timeout_s: float = 15) -> str:
    found = page.locator(f"[data-testid=badge][data-state={state}]")
    found.wait_for(timeout=timeout_s * 1000)
    return found.inner_text()


def choose(page, name: str) -> None:
    select = page.get_by_test_id("robot-select")
    select.locator("option").nth(1).wait_for(state="attached")  # the first frame may come before the list of robots
    select.select_option(
        label=next(text for text in select.locator("option").all_inner_texts() if text.startswith(name))
    )


def moves(up, address_end: str = "") -> list[dict]:
    return [
        e["payload"] or STOP
        for e in up.events("command")
        if e["name"] == "move_raw" and e["address"].endswith(address_end)
    ]


def barriers(page, *rules: str) -> list[str]:
    """What axe finds on the page as it is: what keeps people from using it who see, hear or move otherwise.

    Of all rules, or of these alone.
    """
    if not page.evaluate("'axe' in window"):
        page.evaluate("source => void window.eval(source)", AXE.read_text())
    asked = {"resultTypes": ["violations"]} | ({"runOnly": [*rules]} if rules else {})
    found = page.evaluate("asked => axe.run(document, asked)", asked)["violations"]
    return [f"{each['id']}: {node['html'][:120]}" for each in found for node in each["nodes"]]


def barriers_in_both_schemes(page) -> list[str]:
    """The same, dark; and light, by the rules that look at colours: all of them take four times as long."""
    page.emulate_media(color_scheme="dark")
    found = barriers(page)
    page.emulate_media(color_scheme="light")
    return found + barriers(page, "color-contrast", "link-in-text-block")


def pixels(page, layer: int, name: str) -> int:
    """Of that colour on the map's canvas, in the scheme that has fewer: light or dark."""
    counts = []
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme)
        page.wait_for_timeout(150)  # it is drawn anew
        counts.append(page.evaluate(COUNT, [layer, name]))
    return min(counts)


def qr_in(picture: Path) -> str:
    """Return what the QR code of a screenshot says."""
    import numpy as np
    import zxingcpp
    from PIL import Image

    (found,) = zxingcpp.read_barcodes(np.asarray(Image.open(picture).convert("L")))
    return found.text
