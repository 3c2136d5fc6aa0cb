"""The visitors' page in a real browser, against a real gateway."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import threading
import time

import pytest

from chromium import PHONE, a_page, badge, choose, insecure, join, moves
from commands import a_gateway
from phalanx.net import Client
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]


@pytest.fixture(scope="module")
def gateway():
    """For those that read, or drive and look at nothing but what comes of it."""
    with a_gateway() as (up, ready):
        yield up, ready


class TestVisitor:
    @pytest.mark.alone
    def test_a_phone_scans_and_drives_by_touch_and_the_robot_stops_when_it_lets_go(self, browser):
        with a_gateway("--robots", "4") as (up, ready), a_page(browser) as page:
            join(page, ready["qr_url"])
            assert "4 robots" in badge(page, "live")
            assert page.evaluate("window.isSecureContext") is False
            assert page.evaluate("crypto.subtle === undefined")
            assert "#" not in page.url
            choose(page, "Bo ")
            box = page.get_by_test_id("joystick").bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            touch = page.context.new_cdp_session(page)

            def finger(kind: str, *points):
                touch.send(
                    "Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": a, "y": b} for a, b in points]}
                )

            finger("touchStart", (x, y))
            finger("touchMove", (x, y - box["height"] * 0.45))
            wait_until(lambda: len(moves(up, "2")) >= 8)
            began, began_s = len(moves(up, "2")), time.monotonic()
            page.wait_for_timeout(2000)
            rate_hz = (len(moves(up, "2")) - began) / (time.monotonic() - began_s)
            assert 5 <= rate_hz <= 11.5, "every 100 ms, or a little less often on a busy machine"
            assert all(move["left_y"] > 50 and move["right_y"] > 50 for move in moves(up, "2")[2:])
            finger("touchEnd")
            wait_until(
                lambda: moves(up, "2")[-1].items() >= {"left_x": 0, "left_y": 0, "right_x": 0, "right_y": 0}.items()
            )
            page.wait_for_timeout(400)
            count = len(moves(up, "2"))
            page.wait_for_timeout(400)
            assert len(moves(up, "2")) == count
            assert not moves(up, "1"), "only the chosen robot"

    def test_keys_drive_it_and_hiding_the_page_stops_it(self, browser):
        with (
            a_gateway("--robots", "2") as (up, ready),
            a_page(browser, viewport={"width": 1280, "height": 800}) as page,
        ):
            join(page, ready["qr_url"])
            badge(page, "live")
            # The first state update may come before the list of robots.
            page.get_by_test_id("robot-select").locator("option").nth(1).wait_for(state="attached")
            for _ in range(12):
                page.keyboard.press("Tab")
                if page.evaluate("document.activeElement.dataset.testid") == "robot-select":
                    break
            page.keyboard.press("ArrowDown")
            for _ in range(12):
                page.keyboard.press("Tab")
                if page.evaluate("!!document.activeElement.closest('[data-testid=joystick]')"):
                    break
            page.keyboard.down("ArrowUp")
            wait_until(lambda: len(moves(up)) >= 5)
            assert moves(up)[-1]["left_y"] == moves(up)[-1]["right_y"] > 0
            page.keyboard.down("ArrowRight")
            wait_until(lambda: moves(up)[-1]["left_y"] > moves(up)[-1]["right_y"])
            page.evaluate(
                "Object.defineProperty(document, 'visibilityState', {value: 'hidden', configurable: true});"
                "Object.defineProperty(document, 'hidden', {value: true, configurable: true});"
                "document.dispatchEvent(new Event('visibilitychange'))"
            )
            wait_until(lambda: moves(up)[-1]["left_y"] == moves(up)[-1]["right_y"] == 0)
            count = len(moves(up))
            page.wait_for_timeout(500)
            assert len(moves(up)) == count

    def test_a_phone_that_dies_while_driving_leaves_no_robot_running(self, browser):
        with a_gateway("--robots", "1") as (up, ready):
            with a_page(browser) as page:
                join(page, ready["qr_url"])
                badge(page, "live")
                choose(page, "Ada")
                page.get_by_test_id("joystick").focus()
                page.keyboard.down("KeyW")
                wait_until(lambda: len(moves(up)) >= 5)
                page.close(run_before_unload=False)
            time.sleep(0.5)
            watch = subprocess.run(
                [sys.executable, "-m", "phalanx", "link", "connect", ready["qr_url"], "--json"],
                capture_output=True,
                text=True,
                check=True,
            )
            time.sleep(0.5)
            again = subprocess.run(watch.args, capture_output=True, text=True, check=True)
            places = [json.loads(done.stdout)["robots"][0]["lh2_position"] for done in (watch, again)]
            assert places[0] == places[1]

    def test_colour_route_and_trail(self, browser):
        with a_gateway("--robots", "3", "--seed", "4") as (up, ready), a_page(browser) as page:
            join(page, ready["qr_url"])
            badge(page, "live")
            choose(page, "Cleo")
            page.get_by_role("button", name=re.compile("red", re.IGNORECASE)).first.click()
            led = wait_until(lambda: [e for e in up.events("command") if e["name"] == "rgb_led"])[0]
            assert led["payload"]["red"] > led["payload"]["blue"]
            page.get_by_test_id("route-toggle").click()
            box = page.get_by_test_id("map").bounding_box()
            for across, down in ((0.3, 0.3), (0.7, 0.3), (0.7, 0.7)):
                page.touchscreen.tap(box["x"] + box["width"] * across, box["y"] + box["height"] * down)
                page.wait_for_timeout(100)
            page.get_by_test_id("threshold").fill("80")
            page.get_by_test_id("route-start").click()
            route = wait_until(lambda: [e for e in up.events("command") if e["name"] == "waypoints"])[0]["payload"]
            assert route["threshold"] == 80
            corners = [(point["x"], point["y"]) for point in route["waypoints"]][-3:]
            assert all(300 < x < 1700 and 300 < y < 1700 for x, y in corners)
            assert corners[0][0] < corners[1][0]
            assert corners[1][1] < corners[2][1]
            page.wait_for_timeout(1500)
            page.get_by_test_id("route-clear").click()
            wait_until(lambda: [e for e in up.events("command") if e["payload"] == {"threshold": 80, "waypoints": []}])
            page.get_by_test_id("trail-clear").click()
            wait_until(lambda: [e for e in up.events("command") if e["name"] == "clear_position_history"])
            assert not up.events("rejected")

    def test_a_phone_that_joins_a_large_swarm_on_its_way_sees_it_move(self, browser):
        with a_gateway("--robots", "500") as (_, ready):
            corners = [{"x": x, "y": y, "z": 0} for x in (300, 1700) for y in (300, 1700)] * 8

            async def set_out():
                async with Client(ready["qr_url"]) as client:
                    for robot in await client.robots():
                        await client.command(robot["address"], "waypoints", {"threshold": 60, "waypoints": corners})

            apart = threading.Thread(target=lambda: asyncio.run(set_out()))  # here a loop is running already
            apart.start()
            apart.join()
            with a_page(browser) as page:
                join(page, ready["qr_url"])
                page.get_by_test_id("badge").get_by_text("500 robots").wait_for(timeout=30_000)
                seen = set()
                for _ in range(5):
                    page.wait_for_timeout(400)
                    seen.add(page.get_by_test_id("map").screenshot())
                assert len(seen) == 5, "it moves"
                assert "500 robots" in badge(page, "live")

    def test_light_and_dark_follow_what_the_phone_is_set_to(self, browser, gateway):
        shades = {}
        _, ready = gateway
        for scheme in ("light", "dark"):
            with a_page(browser, **PHONE, color_scheme=scheme) as page:
                page.goto(insecure(ready["page_url"]))
                badge(page, "nocode")
                colour = page.evaluate("getComputedStyle(document.body).backgroundColor")
                shades[scheme] = sum(map(int, re.findall(r"\d+", colour)[:3]))
        assert shades["light"] > 600 > 200 > shades["dark"]

    def test_without_a_code_it_asks_for_one(self, browser, gateway):
        _, ready = gateway
        with a_page(browser) as page:
            page.goto(insecure(ready["page_url"]))
            badge(page, "nocode")
            page.get_by_test_id("link").fill("hello")
            page.get_by_test_id("link-join").click()
            page.get_by_role("alert").get_by_text("not the link under a QR code").wait_for()
            page.get_by_test_id("link").fill(ready["qr_url"])
            page.get_by_test_id("link-join").click()
            page.get_by_test_id("join").click()
            badge(page, "live")

    def test_it_looks_like_the_picture_in_the_readme(self, browser, gateway, tmp_path):
        """Not pixel by pixel: the same layout at phone size, nothing beside the screen, text of a readable size."""
        _, ready = gateway
        with a_page(browser) as page:
            join(page, ready["qr_url"])
            badge(page, "live")
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            for name in ("map", "joystick", "robot-select", "badge"):
                box = page.get_by_test_id(name).bounding_box()
                assert box["x"] >= 0
                assert box["x"] + box["width"] <= 390
            small = page.evaluate(
                "[...document.querySelectorAll('button, select, input')].filter(e => e.offsetParent)"
                ".map(e => [e.dataset.testid || e.textContent, e.getBoundingClientRect()])"
                ".filter(([, r]) => r.height < 24 || r.width < 24).map(([n]) => n)"
            )
            assert not small

    def test_it_fits_the_narrowest_phone(self, browser, gateway):
        _, ready = gateway
        with a_page(browser, **PHONE | {"viewport": {"width": 320, "height": 568}}) as page:
            for state in ("nocode", "live"):
                page.goto(insecure(ready["page_url"])) if state == "nocode" else join(page, ready["qr_url"])
                badge(page, state)
                beside = page.evaluate(
                    "[...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > 320.5)"
                    ".map(e => e.outerHTML.slice(0, 80))"
                )
                assert not beside
                assert page.evaluate("document.documentElement.scrollWidth") == 320
