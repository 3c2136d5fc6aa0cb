"""What a visitor on a phone is shown and told, in a real browser, against a real gateway that all tests share."""

from __future__ import annotations

import re
import signal
from contextlib import contextmanager

import pytest

from chromium import (
    BUZZED,
    PHONE,
    a_page,
    badge,
    barriers,
    barriers_in_both_schemes,
    choose,
    insecure,
    join,
    moves,
)
from commands import a_gateway
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.browser, pytest.mark.timeout(120)]

DESK = {"viewport": {"width": 1280, "height": 720}}
SIDEWAYS = PHONE | {"viewport": {"width": 844, "height": 390}}


@pytest.fixture(scope="module")
def gateway():
    with a_gateway("--robots", "6", "--seed", "4") as (up, ready):
        yield up, ready


@contextmanager
def a_visitor(browser, ready, name: str = "", *scripts: str, **options):
    with a_page(browser, *scripts, **options) as page:
        join(page, ready["qr_url"])
        badge(page, "live")
        if name:
            choose(page, name)
        yield page


def controls(page):
    return page.locator(".swatch, .any-colour, [data-testid=route-toggle], [data-testid=trail-clear]")


def outside(page, *names: str) -> list[str]:
    """Which of these are not wholly on the screen."""
    width, height = page.viewport_size.values()
    boxes = {name: page.get_by_test_id(name).bounding_box() for name in names}
    return [
        name
        for name, box in boxes.items()
        if box["x"] < 0 or box["y"] < 0 or box["x"] + box["width"] > width or box["y"] + box["height"] > height
    ]


def covered_px(page) -> float:
    """How much of the map's height what the badge says covers."""
    badge_, map_ = page.get_by_test_id("badge").bounding_box(), page.get_by_test_id("map").bounding_box()
    return badge_["y"] + badge_["height"] - map_["y"]


def tap(page, across: float, down: float) -> None:
    box = page.get_by_test_id("map").bounding_box()
    page.touchscreen.tap(box["x"] + box["width"] * across, box["y"] + box["height"] * down)


def test_without_frames_the_controls_are_off_and_they_return_with_the_frames(browser, gateway):
    up, ready = gateway
    with a_visitor(browser, ready, "Ada", BUZZED) as page:
        assert all(each.is_enabled() for each in controls(page).all())
        touch = page.context.new_cdp_session(page)
        box = page.get_by_test_id("joystick").bounding_box()
        at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + 20}
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [at]})
        wait_until(lambda: moves(up))
        up.process.send_signal(signal.SIGSTOP)
        try:
            assert "Controls are off" in badge(page, "late", timeout_s=2)  # 800 ms after the last frame
            assert page.get_by_test_id("joystick").get_attribute("aria-disabled") == "true"
            assert page.get_by_test_id("joystick").get_attribute("data-held") == "false"
            assert controls(page).count() == 11
            assert not any(each.is_enabled() for each in controls(page).all())
            assert page.evaluate("window.buzzed.length") == 1, "the thumb is told that it drives nothing"
            page.context.set_offline(True)
            assert "no network" in badge(page, "offline", timeout_s=2)
            assert covered_px(page) < 10
            assert not barriers_in_both_schemes(page)
            page.context.set_offline(False)
        finally:
            up.process.send_signal(signal.SIGCONT)
        badge(page, "live")
        assert all(each.is_enabled() for each in controls(page).all())
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_while_the_operator_holds_all_robots_a_phone_says_so_and_its_controls_are_off(browser):
    with a_gateway("--robots", "6", "--seed", "4") as (up, ready), a_page(browser, **DESK) as desk:
        desk.goto(ready["operator_url"])
        with a_visitor(browser, ready, "Ada", BUZZED) as page:
            touch = page.context.new_cdp_session(page)
            box = page.get_by_test_id("joystick").bounding_box()
            at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + 20}
            touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [at]})
            wait_until(lambda: moves(up))
            desk.get_by_test_id("stop-all").click()
            assert "the operator holds all robots" in badge(page, "held", timeout_s=2)
            assert covered_px(page) < 10
            assert page.get_by_test_id("joystick").get_attribute("aria-disabled") == "true"
            assert page.get_by_test_id("joystick").get_attribute("data-held") == "false"
            assert not any(each.is_enabled() for each in controls(page).all())
            assert page.evaluate("window.buzzed.length") == 1, "the thumb is told that it drives nothing"
            desk.get_by_text("All robots are stopped").wait_for()
            assert not barriers_in_both_schemes(page) + barriers_in_both_schemes(desk)
            desk.get_by_test_id("let-go").click()
            badge(page, "live")
            assert all(each.is_enabled() for each in controls(page).all())


@pytest.mark.parametrize("size", [(390, 664), (412, 732), (375, 548), (360, 640), (320, 568), (568, 320), (844, 390)])
def test_a_thumb_reaches_the_joystick_on_a_phone_whose_browser_has_bars(browser, gateway, size):
    upright = size[0] < size[1]
    with a_visitor(browser, gateway[1], "Ada", viewport={"width": size[0], "height": size[1]}) as page:
        assert not outside(page, "map", "joystick", "robot-select", "route-toggle")
        page.get_by_test_id("route-toggle").click()
        assert not outside(page, "map", "route-start", "route-undo", *(["threshold"] if upright else []))


def test_a_route_is_drawn_and_begun_without_scrolling_and_its_end_is_announced(browser, gateway, tmp_path):
    up, ready = gateway
    with a_visitor(browser, ready, "Cleo", BUZZED) as page:
        assert not outside(page, "map", "joystick", "robot-select", "route-toggle")
        page.get_by_test_id("route-toggle").click()
        assert not outside(page, "map", "route-start", "route-undo", "threshold", "route-toggle")
        page.get_by_test_id("threshold").fill("500")
        for _ in range(2):
            tap(page, 0.5, 0.5)
            page.get_by_text(re.compile(r"Route: \d point")).wait_for()
        page.get_by_test_id("route-undo").click()
        page.get_by_text("Route: 1 point").wait_for()
        page.get_by_test_id("route-start").click()
        page.get_by_test_id("joystick").wait_for()
        assert page.evaluate("window.scrollY") == 0
        page.get_by_test_id("news").get_by_text("Cleo has arrived").wait_for()
        page.screenshot(path=tmp_path / "arrived.png")
        assert not barriers_in_both_schemes(page)
        assert page.get_by_test_id("news").get_attribute("role") == "status"
        assert page.evaluate("window.buzzed.length") == 1
        (route,) = [e["payload"] for e in up.events("command") if e["name"] == "waypoints"]
        assert len(route["waypoints"]) == 1


def test_who_shares_a_robot_is_told_and_so_is_who_only_looks(browser, gateway):
    up, ready = gateway
    with (
        a_visitor(browser, ready, "Dot") as one,
        a_visitor(browser, ready, "Dot") as other,
    ):
        before = len(moves(up))
        one.get_by_test_id("joystick").focus()
        one.keyboard.down("KeyW")
        other.get_by_text("drives it").wait_for()
        assert not barriers_in_both_schemes(other)
        assert len(moves(up)) > before
        assert one.get_by_test_id("others").count() == 0, "nobody else"
        one.keyboard.up("KeyW")
        other.get_by_test_id("others").wait_for(state="detached")


def test_two_fingers_enlarge_the_map_and_a_tap_still_means_what_it_shows(browser, gateway):
    up, ready = gateway
    with a_visitor(browser, ready, "Bo") as page:
        assert page.get_by_test_id("zoom-out").count() == 0
        box = page.get_by_test_id("map").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        touch = page.context.new_cdp_session(page)

        def fingers(kind: str, *apart: float):
            points = [{"x": x + side * half, "y": y, "id": i} for half in apart for i, side in enumerate((-1, 1))]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        fingers("touchStart", 30)
        for half in (40, 60, 90, 120):
            fingers("touchMove", half)
        fingers("touchEnd")
        page.get_by_test_id("zoom-out").wait_for()
        assert page.evaluate("visualViewport.scale") == 1, "the map alone"
        assert not barriers_in_both_schemes(page)
        given = len([e for e in up.events("command") if e["name"] == "waypoints"])
        page.get_by_test_id("route-toggle").click()
        for across in (0.5, 0.75):
            tap(page, across, 0.5)
        page.get_by_test_id("route-start").click()
        routes = wait_until(lambda: [e for e in up.events("command") if e["name"] == "waypoints"][given:])
        start, end = routes[0]["payload"]["waypoints"]
        assert start["x"] == pytest.approx(1000, abs=60)
        assert 60 < end["x"] - start["x"] < 300, "a quarter of the frame is a sixteenth of the area, or so"
        page.get_by_test_id("route-clear").click()
        page.get_by_test_id("map").focus()
        page.keyboard.press("0")
        page.get_by_test_id("zoom-out").wait_for(state="detached")


# Where the halo of the chosen robot is on the map: parts of its width and height.
HALO = """() => {
  const canvas = document.querySelectorAll("canvas.map-layer")[1];
  const { data, width, height } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const wanted = [1, 3, 5].map((i) => parseInt(getComputedStyle(document.body).getPropertyValue("--accent").slice(i, i + 2), 16));
  const at = [];
  for (let i = 0; i < width * height; i += 1) {
    if (data[4 * i + 3] > 200 && wanted.every((value, k) => Math.abs(data[4 * i + k] - value) <= 4)) at.push(i);
  }
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  return at.length < 50 ? null : [mean(at.map((i) => i % width)) / width, mean(at.map((i) => Math.floor(i / width))) / height];
}"""


def test_ones_own_robot_is_found_among_a_hundred_and_stays_in_sight(browser):
    with a_gateway("--robots", "100", "--seed", "4") as (up, ready), a_visitor(browser, ready, "Cleo") as page:
        page.get_by_test_id("zoom-out").wait_for()
        page.get_by_test_id("joystick").focus()
        page.keyboard.down("KeyW")
        wait_until(lambda: len(moves(up)) > 20)
        page.keyboard.up("KeyW")
        across, down = wait_until(lambda: page.evaluate(HALO))
        assert 0.1 < across < 0.9
        assert 0.1 < down < 0.9
        page.get_by_test_id("map").focus()
        page.keyboard.press("0")
        page.get_by_test_id("zoom-out").wait_for(state="detached")
        page.get_by_role("button", name="Find my robot").click()
        page.get_by_test_id("zoom-out").wait_for()
        assert not barriers_in_both_schemes(page)


def test_a_phone_turned_sideways_shows_map_and_joystick_at_once(browser, gateway):
    _, ready = gateway
    with a_visitor(browser, ready, "Ada", **SIDEWAYS) as page:
        assert not outside(page, "map", "joystick", "robot-select", "route-toggle", "led-colour")
        page.get_by_test_id("route-toggle").click()
        assert not outside(page, "map", "route-start", "threshold")
        assert page.evaluate("document.documentElement.scrollWidth") == 844
        assert not barriers_in_both_schemes(page)


def test_who_prefers_german_reads_german_on_every_page(browser, gateway):
    _, ready = gateway
    with a_page(browser, **PHONE, locale="de-AT") as page, a_page(browser, **DESK) as desk:
        page.goto(insecure(ready["page_url"]))
        page.get_by_role("heading", name="Scanne den QR-Code").wait_for()
        assert page.evaluate("document.documentElement.lang") == "de"
        join(page, ready["qr_url"])
        assert badge(page, "live").startswith("Live · 6 Roboter")
        desk.goto(ready["operator_url"].replace("#", "?lang=de#"))
        desk.get_by_role("button", name="Alle Roboter stoppen").wait_for()
        assert desk.title() == "Phalanx: Leitung"
        assert not barriers_in_both_schemes(page) + barriers_in_both_schemes(desk)


def test_axe_finds_no_barrier_in_any_state(browser, gateway):
    up, ready = gateway
    with a_page(browser) as page:
        page.goto(insecure(ready["page_url"]))
        badge(page, "nocode")
        assert not barriers_in_both_schemes(page)
        page.get_by_test_id("link").fill("hello")
        page.get_by_test_id("link-join").click()
        page.get_by_text("That did not work").wait_for()
        assert not barriers_in_both_schemes(page)
        join(page, ready["qr_url"])
        badge(page, "live")
        assert not barriers_in_both_schemes(page)
        choose(page, "Ada")
        assert not barriers_in_both_schemes(page)
        page.get_by_test_id("route-toggle").click()
        tap(page, 0.5, 0.5)
        assert not barriers_in_both_schemes(page)
        up.process.send_signal(signal.SIGSTOP)
        try:
            badge(page, "late")
            assert not barriers_in_both_schemes(page)
        finally:
            up.process.send_signal(signal.SIGCONT)
        badge(page, "live")
        page.evaluate("document.querySelector('[data-testid=robot-select]').removeAttribute('aria-label')")
        assert any(each.startswith("select-name") for each in barriers(page)), "it would find one"
