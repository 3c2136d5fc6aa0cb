"""What both pages say, and where, when something is wrong."""

from __future__ import annotations

import subprocess

import pytest

from chromium import a_page, badge, barriers_in_both_schemes, choose, insecure, wait_until
from conftest import a_gateway, bare_mosquitto
from ports import free_port

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]


@pytest.fixture(scope="module")
def gateway():
    with a_gateway() as (up, ready):
        yield up, ready


def test_what_is_said_of_trouble_moves_no_joystick(browser, tmp_path):
    with a_gateway() as (up, ready), a_page(browser) as visitor:
        visitor.goto(insecure(ready["qr_url"]))
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
        visitor.goto(insecure(gateway[1]["qr_url"]))
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
        visitor.goto(insecure(gateway[1]["qr_url"]))
        badge(visitor, "live")
        choose(visitor, "Ada")
        visitor.get_by_test_id("joystick").focus()
        visitor.keyboard.down("KeyD")
        drives = page.locator("tr", has_text="Ada").get_by_test_id("mode").get_by_text("driven by ")
        drives.wait_for()
        name = drives.inner_text().removeprefix("driven by ")
        assert [v for v in page.locator(".visitor-id").all_inner_texts() if v.endswith(name)]
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


def test_a_broker_that_wants_a_login_of_visitors(browser, tmp_path):
    """The page says that it is missing, or wrong; and whoever types the pin types it too."""
    tcp, ws, users = free_port(), free_port(), tmp_path / "users"
    subprocess.run(["mosquitto_passwd", "-c", "-b", users, "all", "secret"], check=True)
    (tmp_path / "login").write_text("all:secret\n")
    guarded = ("allow_anonymous false", f"password_file {users}", "user root")
    there = f"ws://127.0.0.1:{ws}/mqtt"
    with bare_mosquitto(tcp, ws, tmp_path, *guarded) as (start, _), a_page(browser) as visitor:
        start()
        options = ("--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", there, "--broker-login", tmp_path / "login")
        with a_gateway(*map(str, options)) as (_, ready):
            visitor.goto(insecure(f"{ready['qr_url']}&user=all&password=wrong"))
            visitor.get_by_test_id("badge").get_by_text("name or password is wrong").wait_for()
            visitor.get_by_test_id("leave").click()
            visitor.get_by_text("pin instead").click()
            for field, said in (("pin", ready["pin"]), ("broker", there), ("user", "all"), ("password", "secret")):
                visitor.get_by_test_id(field).fill(said)
            visitor.screenshot(path=tmp_path / "typed.png", full_page=True)
            visitor.get_by_test_id("typed-join").click()
            badge(visitor, "live")
