"""The operator's page in a real browser, against a real gateway."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import zxingcpp

from chromium import a_page, badge, choose, insecure, wait_until
from conftest import a_gateway

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]


class TestOperator:
    def test_its_code_scans_its_numbers_move_and_the_token_is_gone_from_the_address(self, browser, tmp_path):
        with a_gateway() as (_, ready), a_page(browser, viewport={"width": 1280, "height": 800}) as page:
            page.goto(ready["operator_url"])
            page.get_by_test_id("fleet-table").get_by_text("Lou").wait_for()
            assert "token" not in page.url
            picture = tmp_path / "operator.png"
            page.screenshot(path=picture)
            assert qr_in(picture) == ready["qr_url"]
            assert ready["pin"] not in page.locator("body").inner_text()
            with a_page(browser) as visitor:
                visitor.goto(insecure(ready["qr_url"]))
                badge(visitor, "live")
                choose(visitor, "Ada")
                visitor.get_by_test_id("joystick").focus()
                visitor.keyboard.down("KeyW")
                page.get_by_test_id("visitors").get_by_text("phalanx_").wait_for()
                wait_until(
                    lambda: int(re.search(r"\d+", page.locator("[data-counter=commands]").inner_text()).group()) > 5
                )
                visitor.keyboard.up("KeyW")
            page.reload()
            page.get_by_test_id("fleet-table").get_by_text("Lou").wait_for()

    def test_without_the_token_it_shows_nothing(self, browser):
        with a_gateway() as (_, ready):
            for url in (ready["operator_url"].split("#")[0], ready["operator_url"][:-1] + "x"):
                with a_page(browser, viewport={"width": 1280, "height": 800}) as page:
                    page.goto(url)
                    page.get_by_test_id("no-token").wait_for()
                    assert page.get_by_test_id("qr").count() == 0

    def test_after_a_rotation_the_code_on_the_screen_is_the_new_one(self, browser, tmp_path):
        with (
            a_gateway("--rotate-s", "10", "--overlap-s", "1") as (up, ready),
            a_page(browser, viewport={"width": 1920, "height": 1080}) as page,
        ):
            page.goto(ready["operator_url"])
            page.get_by_test_id("qr").wait_for()
            url = up.wait_for("rotation")["qr_url"]

            def shown() -> str:
                page.screenshot(path=tmp_path / "operator.png")
                return qr_in(tmp_path / "operator.png")

            wait_until(lambda: shown() == url, 7)


def qr_in(picture: Path) -> str:
    import matplotlib.image
    import numpy as np

    pixels = matplotlib.image.imread(picture)
    grey = (pixels[..., :3].mean(axis=-1) * 255).astype(np.uint8)
    (found,) = zxingcpp.read_barcodes(np.ascontiguousarray(grey))
    return found.text
