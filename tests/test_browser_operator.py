"""The operator's page in a real browser, against a real gateway."""

from __future__ import annotations

import re

import pytest

from chromium import a_page, badge, barriers, barriers_in_both_schemes, choose, join, qr_in
from commands import a_gateway
from ports import free_port
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]

PUBLISHED = ("--frontend", "https://dotbots.example/PyDotBot")
PROJECTOR = {"viewport": {"width": 1280, "height": 720}}


@pytest.fixture(scope="module")
def gateway():
    with a_gateway(*PUBLISHED, qrkey=True) as (up, ready):
        yield up, ready


class TestOperator:
    def test_its_code_scans_its_numbers_move_and_the_token_is_gone_from_the_address(self, browser, tmp_path):
        with a_gateway() as (_, ready), a_page(browser, **PROJECTOR) as page:
            page.goto(ready["operator_url"])
            page.get_by_test_id("fleet-table").get_by_text("Lou").wait_for()
            assert "token" not in page.url
            picture = tmp_path / "operator.png"
            page.screenshot(path=picture)
            assert qr_in(picture) == ready["qr_url"]
            assert ready["qr_url"].partition("#")[2] not in page.locator("body").inner_text()
            assert not barriers(page)
            with a_page(browser) as visitor:
                join(visitor, ready["qr_url"], "Grace")
                badge(visitor, "live")
                choose(visitor, "Ada")
                visitor.get_by_test_id("joystick").focus()
                visitor.keyboard.down("KeyW")
                page.locator("[data-present=true]").get_by_text("Grace").wait_for()
                wait_until(
                    lambda: int(re.search(r"\d+", page.locator("[data-counter=commands]").inner_text()).group()) > 5
                )
                visitor.keyboard.up("KeyW")
                visitor.close(run_before_unload=True)
                page.locator("[data-present=true]", has_text="Grace").wait_for(state="detached")
            page.reload()
            page.get_by_test_id("fleet-table").get_by_text("Lou").wait_for()

    def test_without_the_token_it_shows_nothing(self, browser, gateway):
        _, ready = gateway
        for url in (ready["operator_url"].split("#")[0], ready["operator_url"][:-1] + "x"):
            with a_page(browser, **PROJECTOR) as page:
                page.goto(url)
                page.get_by_test_id("no-token").wait_for()
                assert page.get_by_test_id("qr").count() == 0
                assert not barriers(page)

    def test_words_that_are_not_plain_are_explained_to_pointer_and_keyboard(self, browser, gateway):
        _, ready = gateway
        with a_page(browser, **PROJECTOR, color_scheme="dark") as page:
            page.goto(ready["operator_url"])
            page.locator(".term", has_text="Fleet").hover()
            page.locator(".tip").get_by_text("All robots that the gateway knows").wait_for()
            assert not barriers(page)
            page.keyboard.press("Escape")
            page.locator(".tip").wait_for(state="detached")
            page.locator(".term", has_text="Broker").scroll_into_view_if_needed()
            page.locator(".term", has_text="Broker").focus()
            page.locator(".tip").get_by_text("passes messages").wait_for()
            box = page.locator(".tip").bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 1280

    def test_a_new_code_comes_at_a_click_visitors_stay_in_and_the_next_one_has_to_wait(self, browser, gateway):
        up, ready = gateway
        with a_page(browser, **PROJECTOR) as page, a_page(browser) as visitor:
            join(visitor, ready["session_url"])
            badge(visitor, "live")
            page.goto(ready["operator_url"])
            page.get_by_test_id("new-code").click()
            assert up.wait_for("rotation")["qr_url"] != ready["qr_url"]
            page.locator("[data-testid=new-code]:disabled").wait_for()
            assert not barriers_in_both_schemes(page)
            page.get_by_test_id("countdown").get_by_text("The previous code works").wait_for()
            choose(visitor, "Ada")
            visitor.get_by_role("button", name=re.compile("red")).first.click()
            wait_until(lambda: [e for e in up.events("command") if e["name"] == "rgb_led"])
            assert len(up.events("rotation")) == 1

    def test_after_a_rotation_the_code_on_the_screen_is_the_new_one(self, browser, tmp_path):
        with (
            a_gateway("--rotate-s", "10", "--overlap-s", "1", *PUBLISHED, qrkey=True) as (up, ready),
            a_page(browser, viewport={"width": 1920, "height": 1080}) as page,
        ):
            page.goto(ready["operator_url"])
            page.get_by_test_id("qr").wait_for()
            url = up.wait_for("rotation")["qr_url"]

            def shown() -> str:
                page.screenshot(path=tmp_path / "operator.png")
                return qr_in(tmp_path / "operator.png")

            wait_until(lambda: shown() == url, 7)

    def test_a_restart_with_the_same_port_and_token_does_not_strand_the_page(self, browser, tmp_path):
        kept = tmp_path / "token"
        options = ["--operator-port", str(free_port()), "--operator-token-file", str(kept)]
        with a_page(browser, **PROJECTOR) as page, a_page(browser) as visitor:
            with a_gateway(*options) as (up, ready):
                page.goto(ready["operator_url"])
                page.get_by_test_id("fleet-table").wait_for()
                join(visitor, ready["session_url"])
                badge(visitor, "live")
                assert kept.read_text().strip() in ready["operator_url"]
                assert kept.stat().st_mode & 0o777 == 0o600
                up.stop()
            page.get_by_test_id("banner").wait_for()
            assert "No connection to the swarm" in badge(visitor, "offline")
            assert not barriers_in_both_schemes(page) + barriers_in_both_schemes(visitor)
            with a_gateway(*options, "--robots", "3") as (_, again):
                assert again["operator_url"] == ready["operator_url"]
                page.get_by_test_id("banner").wait_for(state="detached")
                page.get_by_label("Map with 3 robots").wait_for()
