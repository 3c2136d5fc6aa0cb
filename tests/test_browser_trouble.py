"""What both pages say, and where, when something is wrong."""

from __future__ import annotations

import pytest

from chromium import a_page, badge, barriers_in_both_schemes, choose, join
from commands import a_gateway
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]


@pytest.fixture(scope="module")
def gateway():
    with a_gateway() as (up, ready):
        yield up, ready


def test_what_is_said_of_trouble_moves_no_joystick(browser, tmp_path):
    with a_gateway() as (up, ready), a_page(browser) as visitor:
        join(visitor, ready["qr_url"])
        badge(visitor, "live")
        choose(visitor, "Ada")
        before = visitor.get_by_test_id("joystick").bounding_box()
        up.stop()
        badge(visitor, "offline")
        visitor.get_by_test_id("leave").wait_for()
        assert visitor.get_by_test_id("joystick").bounding_box() == before
        visitor.screenshot(path=tmp_path / "offline.png")


def test_zoom_brings_the_chosen_robot_into_the_middle(browser, gateway):
    with a_page(browser) as visitor:
        join(visitor, gateway[1]["qr_url"])
        badge(visitor, "live")
        picker = visitor.get_by_test_id("robot-select")
        choose(visitor, "Ada")
        ada = picker.input_value()
        for _ in range(5):
            visitor.get_by_test_id("zoom-in").click()
        picker.select_option("")
        visitor.get_by_test_id("map").click()
        wait_until(lambda: picker.input_value() == ada)


def test_the_operator_sees_who_drives_and_no_old_complaint(browser, gateway):
    with a_page(browser, viewport={"width": 1280, "height": 720}) as page, a_page(browser) as visitor:
        page.goto(gateway[1]["operator_url"])
        join(visitor, gateway[1]["qr_url"])
        badge(visitor, "live")
        choose(visitor, "Ada")
        visitor.get_by_test_id("joystick").focus()
        visitor.keyboard.down("KeyD")
        drives = page.locator("tr", has_text="Ada").get_by_test_id("mode").get_by_text("driven by ")
        drives.wait_for()
        name = drives.inner_text().removeprefix("driven by ")
        page.get_by_test_id("session-table").get_by_text(name).wait_for()
        visitor.keyboard.up("KeyD")
        drives.wait_for(state="detached")
        page.route("**/api/stop", lambda route: route.abort())
        page.get_by_test_id("stop-all").click()
        page.get_by_role("alert").get_by_text("does not answer").wait_for()
        page.unroute("**/api/stop")
        page.get_by_role("alert").wait_for(state="detached")


@pytest.mark.parametrize("size", [(1280, 720), (1280, 600), (1024, 480), (844, 380), (390, 844)])
def test_the_code_alone_is_readable_on_a_low_screen(browser, gateway, size, tmp_path):
    with a_page(browser, viewport={"width": size[0], "height": size[1]}) as page:
        page.goto(gateway[1]["operator_url"])
        page.get_by_role("button", name="QR only").click()
        page.get_by_role("button", name="Back to the overview").wait_for()
        page.screenshot(path=tmp_path / "qr.png")
        sizes = "nodes => nodes.filter((n) => n.innerText?.trim()).map((n) => parseFloat(getComputedStyle(n).fontSize))"
        assert min(page.locator(".invitation *").evaluate_all(sizes)) >= 14
        assert page.locator(".page-url").evaluate("n => parseFloat(getComputedStyle(n).fontSize)") >= 18
        qr = page.get_by_test_id("qr").bounding_box()
        assert qr["width"] >= 0.45 * min(size)
        assert page.evaluate("document.documentElement.scrollHeight <= innerHeight")
        assert not barriers_in_both_schemes(page)
